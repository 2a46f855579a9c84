"""Streams and histories of live twins that are read while the store writes, fails or has lost the end."""

from __future__ import annotations

import threading
import time
from dataclasses import replace

import pytest

from api.twins.broadcast import Broadcast
from api.twins.stream import begin, stream
from tests.api.reopened import away, kill, request
from tests.waiting import awaited, wait_until


@pytest.mark.slow
def test_a_stream_goes_on_behind_the_last_event_it_told(opened):
    twins = opened(checkpoint_s=60)
    twins.start(request(speed="max", at_end="repeat"))
    wait_until(lambda: twins._store.get("t").events > 200, 180.0)
    wait_until(lambda: twins.observers[0].events[-1].seq > twins._store.get("t").events)
    kill(twins)
    told = twins.observers[0].events
    again = opened()
    again.resume_all()
    wait_until(lambda: again.state("t").events > told[-1].seq + 20)
    again.close()
    kept = again.events("t", -1, 100_000)
    for last in (told[0], told[100], told[-60], told[-1]):  # the last of them were lost, and their numbers given anew
        place = begin(again, "t", replace(begin(again, "t", None), epoch=1, event=last.seq))
        behind = [event for event in kept if event["seq"] > place.event]
        assert behind == [event for event in kept if event["epoch"] > 1 or event["seq"] > last.seq]
    assert begin(again, "t", None).event == len(kept) - 51


def test_samples_go_on_while_events_wait_for_the_store(opened, monkeypatch):
    twins = opened()
    twins.start(request(speed=50, at_end="repeat"))
    wait_until(lambda: twins._store.get("t").events > 3)

    async def heard():
        broadcast = Broadcast()
        twins.live("t")._observers += (broadcast,)
        news = stream(twins, "t", replace(begin(twins, "t", None), event=-1), broadcast, threading.Event())
        with monkeypatch.context() as broken:
            broken.setattr(twins._store, "events", away)
            before = b"".join([await anext(news) for _ in range(3)])
        return before, await anext(news)

    before, after = awaited(heard())
    assert before.count(b"event: sample") >= 3
    assert b"event: event" not in before
    assert b'"kind":"started"' in after


@pytest.mark.slow
def test_history_has_no_hole_and_no_double_while_it_is_written(opened):
    twins = opened()
    twins.start(request(at_end="repeat"))
    wrong, ending = [], threading.Event()

    def read():
        while not ending.is_set():
            end = twins.samples("t")
            found = [sample.seq for sample in twins.history("t", max(0, end - 900), 900)]
            if found and found != list(range(found[0], found[0] + len(found))):
                wrong.append(found)
            numbers = [event["seq"] for event in twins.events("t", max(-1, twins.state("t").events - 300), 200)]
            if numbers and numbers != list(range(numbers[0], numbers[0] + len(numbers))):
                wrong.append(numbers)

    readers = [threading.Thread(target=read) for _ in range(2)]
    for reader in readers:
        reader.start()
    time.sleep(3)
    wait_until(lambda: twins.samples("t") > 1000)
    ending.set()
    for reader in readers:
        reader.join(30)
    assert wrong == []
