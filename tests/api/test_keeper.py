"""The keeper's order: each twin's own, and nobody waits for an answer behind twins that are faster than the store."""

from __future__ import annotations

import threading

from api.store.records import Checkpoint, KeptAnswer
from api.twins.keeper import Draft, Keeper, Segment


class Gate:
    """A store that takes nothing until it is opened, and notes what it took."""

    def __init__(self):
        self.entered, self.open = threading.Event(), threading.Event()
        self.saved = []

    def save(self, twin, epoch, checkpoint):
        self.entered.set()
        assert self.open.wait(30)
        self.saved.append((twin, checkpoint.first_seq))


def _draft(twin, first, answers=()):
    checkpoint = Checkpoint("running", {}, b"", first, 0, None, (), answers)
    return Draft(twin, 1, checkpoint, Segment(first), lambda _: None, lambda: None)


def test_what_somebody_waits_for_goes_first_behind_what_its_twin_told_before():
    gate = Gate()
    keeper = Keeper(gate)
    keeper.keep(_draft("fast", 0))
    assert gate.entered.wait(30)
    for first in (1, 2, 3):
        keeper.keep(_draft("fast", first))
    keeper.keep(_draft("asked", 0))
    keeper.keep(_draft("asked", 1, (KeptAnswer("", "key", b"", 0.0, 201, "", b""),)))
    keeper.keep(_draft("asked", 2))
    gate.open.set()
    keeper.close(30)
    assert gate.saved[:3] == [("fast", 0), ("asked", 0), ("asked", 1)]
    for twin, count in (("fast", 4), ("asked", 3)):
        assert [first for name, first in gate.saved if name == twin] == list(range(count))
