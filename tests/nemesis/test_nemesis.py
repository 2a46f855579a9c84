"""A service at work under seeded faults, on both stores: nothing lost, nothing doubled, no repair by hand."""

from __future__ import annotations

import pytest

from tests.nemesis.arena import POSTGRESQL, SQLITE
from tests.nemesis.faults import KINDS, plan
from tests.nemesis.postgres import missing
from tests.nemesis.run import torment

STORES = [
    SQLITE,
    pytest.param(POSTGRESQL, marks=pytest.mark.skipif(bool(missing()), reason=missing() or "it is there")),
]

LATER = ("freeze-postgres", "lock-sqlite")
"""Faults that were not yet there when those seeds failed: with them a seed gives another plan."""

FAILED_SEEDS = [
    # Event streams took no Last-Event-ID: whoever came again was told events twice, or missed those before the last 50.
    (SQLITE, 1, range(6)),
    # A table that cannot grow is an InternalError to PostgreSQL, which counted as the job's fault: 39 jobs failed, and
    # checkpoints of twins were given up.
    pytest.param(POSTGRESQL, 2, range(28), marks=pytest.mark.full),
    # What was told while a checkpoint waited to be tried again was stored before what was told earlier: the store was
    # full at fault 144, and 63 events were missing.
    pytest.param(SQLITE, 7, range(140, 148), marks=pytest.mark.full),
    # A request that came just when a worker had died was answered 500: it woke a worker whose link was closed.
    (POSTGRESQL, 1, range(6)),
    # A twin that waited for a full store to go on was said to have been stopped, and went on. And on a slow machine: a
    # reader that came just before a twin was taken up was told its first events, and, coming again, once more.
    (SQLITE, 21, range(3)),
    # The fork server was killed while it made the first worker: the pool gave up, and no job was computed any more.
    (SQLITE, 21, range(36, 40)),
]
"""(store, seed, which faults of its plan) of runs that once failed, each with what was found."""


@pytest.mark.parametrize("faults", [pytest.param(20, marks=pytest.mark.slow), pytest.param(40, marks=pytest.mark.full)])
@pytest.mark.parametrize("store", STORES)
def test_nothing_is_lost_and_nothing_doubled(store, faults, tmp_path):
    report = torment(store, plan(store, faults, 11), 11, tmp_path)
    assert report.wrong == []
    assert report.figures["writes refused by a full store"] > 0
    assert report.faults.keys() == KINDS[store].keys()


@pytest.mark.full
@pytest.mark.parametrize(("store", "seed", "which"), FAILED_SEEDS)
def test_what_once_failed_does_so_no_more(store, seed, which, tmp_path):
    if store == POSTGRESQL and missing():
        pytest.skip(missing())
    report = torment(store, plan(store, which.stop, seed, without=LATER)[which.start :], seed, tmp_path)
    assert report.wrong == []


@pytest.mark.parametrize("store", [SQLITE, POSTGRESQL])
def test_a_plan_is_its_seeds(store):
    assert plan(store, 30, 5) == plan(store, 30, 5)
    assert plan(store, 30, 5) != plan(store, 30, 6)
    assert {fault.kind for fault in plan(store, len(KINDS[store]), 5)} == KINDS[store].keys()
