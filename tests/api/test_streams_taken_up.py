"""A reader that comes while a twin is just being taken up hears every event, and each once."""

from __future__ import annotations

import json
import threading

import pytest

from api.twins.broadcast import Broadcast
from api.twins.stream import Place, begin, stream
from tests.api.reopened import kill, request
from tests.waiting import awaited, wait_until

UNSTORED = 4
"""Events that the first epoch tells after its last checkpoint: their numbers are given again."""


class Reader:
    """Reads streams of the twin `t` one after the other, as a browser does that comes again."""

    def __init__(self):
        self.events = []
        self.last = ""
        self.broadcast = Broadcast()

    @property
    def place(self):
        """Where it stands."""
        return Place.parse(self.last)

    def listen(self, twins, count, place=None):
        """Hear a stream until it ends or has told so many events in all."""
        awaited(self._listen(twins, count, begin(twins, "t", self.place) if place is None else place))

    async def _listen(self, twins, count, place):
        async for part in stream(twins, "t", place, self.broadcast, threading.Event()):
            for message in part.decode().split("\n\n"):
                fields = dict(line.split(": ", 1) for line in message.split("\n") if ": " in line)
                if "id" in fields:
                    self.last = fields["id"]
                if fields.get("event") == "event":
                    self.events.append(json.loads(fields["data"]))
            if len(self.events) >= count:
                return


@pytest.fixture
def heard(opened):
    """A twin that was killed, opened and not yet taken up, and who has heard all it told."""
    twins, reader = opened(checkpoint_s=60), Reader()
    twins.listeners.append(reader.broadcast)
    twins.start(request(at_end="repeat", speed=200))
    wait_until(lambda: twins._store.get("t").events > 0)
    stored = twins._store.get("t").events
    reader.listen(twins, stored + UNSTORED)
    kill(twins)
    assert twins._store.get("t").events == stored
    twins = opened()
    twins.listeners.append(reader.broadcast)
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


def _is_whole(reader, twins):
    seen = [(event["epoch"], event["seq"]) for event in reader.events]
    assert len(seen) == len(set(seen))
    last = max(event["seq"] for event in reader.events if event["epoch"] == 2)
    kept = [(event["epoch"], event["seq"]) for event in twins.events("t", -1, last + 1)]
    assert {epoch for epoch, _ in kept} == {1, 2}
    assert set(kept) <= set(seen)
