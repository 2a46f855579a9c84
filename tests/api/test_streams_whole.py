"""A reader hears every event, and each once: also of a twin that is taken up, tells much, or has an id anew."""

from __future__ import annotations

import asyncio
import json
import threading
from dataclasses import replace

import pytest

from api.twins.broadcast import Broadcast
from api.twins.stream import StreamCursor, begin, stream
from tests.api.reopened import kill, request
from tests.waiting import awaited, wait_until

UNSTORED = 4
"""Events that the first epoch tells after its last checkpoint: their numbers are given again."""

PATIENCE_S = 20.0
"""For what a stream tells."""


class Reader:
    """Reads streams of the twin `t` one after the other, as a browser does that comes again."""

    def __init__(self):
        self.events = []
        self.last = ""
        self.broadcast = Broadcast()

    @property
    def place(self):
        """Where it stands."""
        return StreamCursor.parse(self.last)

    def listen(self, twins, count, place=None):
        """Hear a stream until it ends or has told so many events in all."""
        awaited(self._listen(twins, count, begin(twins, "t", self.place) if place is None else place))

    async def _listen(self, twins, count, place):
        async with asyncio.timeout(PATIENCE_S):
            async for part in self.opened(twins, place):
                self.hear(part)
                if len(self.events) >= count:
                    return

    def opened(self, twins, place):
        """A stream, not read yet."""
        return stream(twins, "t", place, self.broadcast, threading.Event())

    def hear(self, part):
        """Note what a part of a stream tells."""
        for message in part.decode().split("\n\n"):
            fields = dict(line.split(": ", 1) for line in message.split("\n") if ": " in line)
            if "id" in fields:
                self.last = fields["id"]
            if fields.get("event") == "event":
                self.events.append(json.loads(fields["data"]))


@pytest.fixture
def heard(opened):
    """A twin that was killed, opened and not yet taken up, and who has heard all it told."""
    twins, reader = opened(checkpoint_s=60), Reader()
    twins.observers.append(reader.broadcast)
    twins.start(request(at_end="repeat", speed=200))
    wait_until(lambda: twins._store.get("t").events > 0)
    stored = twins._store.get("t").events
    reader.listen(twins, stored + UNSTORED)
    kill(twins)
    assert twins._store.get("t").events == stored
    twins = opened()
    twins.observers.append(reader.broadcast)
    return twins, reader


def test_a_twin_taken_up_between_a_look_and_its_events_tells_them_once(heard, monkeypatch):
    twins, reader = heard
    place, last, running = begin(twins, "t", reader.place), reader.events[-1]["seq"], twins.running

    def behind_the_times(twin_id):
        monkeypatch.undo()
        seen = running(twin_id)
        twins.resume_all()
        wait_until(lambda: twins.events("t", last, 1))
        return seen

    monkeypatch.setattr(twins, "running", behind_the_times)
    told = len(reader.events)
    reader.listen(twins, told + 3, place)
    reader.listen(twins, told + 6)
    _is_whole(reader, twins)


def test_a_twin_opened_but_not_yet_living_is_told_from_its_beginning(heard, monkeypatch):
    twins, reader = heard
    places = []
    go_on = twins._go_on

    def slowly(*given):
        places.append(begin(twins, "t", reader.place))
        go_on(*given)

    monkeypatch.setattr(twins, "_go_on", slowly)
    twins.resume_all()
    told = len(reader.events)
    reader.listen(twins, told + 3, places[0])
    reader.listen(twins, told + 3)
    _is_whole(reader, twins)


@pytest.fixture
def live(opened):
    """A twin that tells some events a second, and who reads."""
    twins, reader = opened(), Reader()
    twins.observers.append(reader.broadcast)
    twins.start(request(controller="logic", at_end="repeat", speed=50))
    return twins, reader


def test_who_reads_the_store_while_more_is_told_is_told_it_nevertheless(live, monkeypatch):
    twins, reader = live
    read, reads = twins.events, []

    def slowly(twin_id, after, limit):
        reads.append(after)
        assert len(reads) <= 10
        wait_until(lambda: twins.state("t").events > after + 1)  # there is always one more than was read
        return read(twin_id, after, limit)

    monkeypatch.setattr(twins, "events", slowly)
    reader.listen(twins, 20)
    assert [event["seq"] for event in reader.events] == list(range(len(reader.events)))


def test_a_reader_of_a_twin_whose_id_another_has_now_is_sent_away_and_its_news_are_forgotten(live):
    twins, late = live
    anew = Reader()
    anew.broadcast = late.broadcast

    async def listen():
        parts = late.opened(twins, begin(twins, "t", None))
        while len(late.events) < 5:
            late.hear(await anext(parts))
        twins.stop("t")
        wait_until(lambda: not twins.running("t"))
        twins.remove("t")
        twins.start(request(controller="logic", at_end="repeat", speed=50))
        told = list(late.events)
        await anew._listen(twins, 5, begin(twins, "t", None))
        async with asyncio.timeout(PATIENCE_S):
            async for part in parts:
                late.hear(part)
        assert late.events == told

    awaited(listen())
    assert anew.events == twins.events("t", -1, len(anew.events))
    assert anew.events[0]["seq"] == 0


def _is_whole(reader, twins):
    seen = [(event["epoch"], event["seq"]) for event in reader.events]
    assert len(seen) == len(set(seen))
    last = max(event["seq"] for event in reader.events if event["epoch"] == 2)
    kept = [(event["epoch"], event["seq"]) for event in twins.events("t", -1, last + 1)]
    assert {epoch for epoch, _ in kept} == {1, 2}
    kept = [each for each in kept if each >= min(seen)]  # what was told before anybody listened is in no stream
    assert set(kept) <= set(seen)


@pytest.mark.slow
def test_a_store_that_does_not_answer_keeps_neither_samples_nor_heartbeats(live, monkeypatch):
    twins, reader = live
    frozen = threading.Event()
    read = twins.events

    def hung(*given):
        frozen.wait(PATIENCE_S)
        return read(*given)

    monkeypatch.setattr(twins, "events", hung)

    async def listening():
        told, last = [], begin(twins, "t", None)
        async with asyncio.timeout(PATIENCE_S):
            async for part in reader.opened(twins, replace(last, event=-1)):
                told += [line for line in part.decode().split("\n") if line.startswith("event: ")]
                if told.count("event: heartbeat") >= 3 and told.count("event: sample") >= 3:
                    frozen.set()
                if "event: event" in told:
                    break
        return told[: told.index("event: event")]

    try:
        assert awaited(listening()).count("event: heartbeat") >= 3
    finally:
        frozen.set()
