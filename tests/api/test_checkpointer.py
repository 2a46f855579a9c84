"""The keeper's order: each twin's own, and nobody waits for an answer behind twins that are faster than the store."""

from __future__ import annotations

import threading
from types import SimpleNamespace

from api.packing import Basis
from api.store.database import StoreError
from api.store.records import Checkpoint
from api.twins import checkpointer as checkpointers
from api.twins.checkpointer import Checkpointer, PendingCheckpoint, Segment
from station import load_station
from tests.waiting import wait_until

BASIS = Basis.of(load_station("thesis-fit"))


class Gate:
    """A store that takes nothing until it is opened, and notes what it took."""

    def __init__(self):
        self.entered, self.open = threading.Event(), threading.Event()
        self.saved = []

    def save(self, twin, epoch, checkpoint):
        self.entered.set()
        assert self.open.wait(30)
        self.saved.append((twin, checkpoint.first_seq))


def _draft(twin, first, *, urgent=False):
    checkpoint = Checkpoint("running", {}, b"", first, 0, None)
    segment = Segment(first, BASIS, "thesis")
    return PendingCheckpoint(twin, 1, checkpoint, segment, lambda _: None, lambda: None, urgent=urgent)


def test_what_somebody_waits_for_goes_first_behind_what_its_twin_told_before():
    gate = Gate()
    checkpointer = Checkpointer(gate)
    checkpointer.keep(_draft("fast", 0))
    assert gate.entered.wait(30)
    for first in (1, 2, 3):
        checkpointer.keep(_draft("fast", first))
    checkpointer.keep(_draft("asked", 0))
    checkpointer.keep(_draft("asked", 1, urgent=True))
    checkpointer.keep(_draft("asked", 2))
    gate.open.set()
    checkpointer.close()
    checkpointer._thread.join(30)  # on a slow machine it is not waited for until then
    assert gate.saved[:3] == [("fast", 0), ("asked", 0), ("asked", 1)]
    for twin, count in (("fast", 4), ("asked", 3)):
        assert [first for name, first in gate.saved if name == twin] == list(range(count))


class FailingOnce:
    """A store that fails the first checkpoint, when it is told to."""

    def __init__(self):
        self.asked, self.failing, self.saved = threading.Event(), threading.Event(), []

    def save(self, twin_id, epoch, checkpoint):
        if not self.asked.is_set():
            self.asked.set()
            self.failing.wait(30)
            raise StoreError("full")
        self.saved.append([event["seq"] for event in checkpoint.events])


def test_checkpoints_behind_one_that_failed_are_stored_in_their_order(monkeypatch):
    monkeypatch.setattr(checkpointers, "RETRY_S", 0.5)
    store, segment = FailingOnce(), Segment(0, BASIS, "thesis")
    kept = Checkpointer(store)

    def keep(seq):
        checkpoint = Checkpoint("running", {}, b"", 0, 0, None, ({"seq": seq},))
        kept.keep(PendingCheckpoint("t", 1, checkpoint, segment, lambda _: None, lambda: None))

    keep(0)
    store.asked.wait(30)
    keep(1)  # behind the one that is being stored
    store.failing.set()
    wait_until(lambda: kept._saving is None)
    keep(2)  # while that waits to be tried again
    wait_until(lambda: not kept.behind)
    kept.close()
    kept._thread.join(30)
    assert store.saved == [[0], [1, 2]]


def test_what_fails_as_it_closes_is_tried_once_more():
    store = FailingOnce()
    checkpointer = Checkpointer(store)
    checkpointer.keep(_draft("t", 0))
    assert store.asked.wait(30)
    closing = threading.Thread(target=checkpointer.close)
    closing.start()
    wait_until(lambda: checkpointer._closing)
    store.failing.set()
    closing.join(30)
    checkpointer._thread.join(30)
    assert store.saved == [[]]


def test_the_lag_is_the_oldest_drafts_whatever_took_its_place(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(checkpointers, "time", SimpleNamespace(monotonic=lambda: now[0]))
    gate, segment = Gate(), Segment(0, BASIS, "thesis")
    kept = Checkpointer(gate)
    assert kept.lag == 0.0

    def keep(twin):
        checkpoint = Checkpoint("running", {}, b"", 0, 0, None)
        kept.keep(PendingCheckpoint(twin, 1, checkpoint, segment, lambda _: None, lambda: None, since=now[0]))

    keep("saved")
    assert gate.entered.wait(30)
    for now[0] in (101.0, 102.0, 103.0):  # each takes the place of the one before
        keep("t")
    assert (kept.lag, kept.behind) == (3.0, 2)
    assert kept._drafts[1].since == 101.0
    gate.open.set()
    wait_until(lambda: not kept.behind)
    assert kept.lag == 0.0
    kept.close()
