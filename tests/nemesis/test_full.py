"""A SQLite store that is full (`max_page_count`), at every page: nothing half-written, all of it when there is room."""

from __future__ import annotations

import threading
import time

import pytest
import sqlalchemy as sa

from api.comparisons.job import COMPARISON, comparison_spec
from api.settings import Settings
from api.store.database import Database, StoreError
from api.store.jobs import JobRepository
from api.store.records import ChunkResult, JobKind
from api.store.twins import TwinRepository
from api.twins.schemas import TwinRequest
from api.twins.service import Twins
from station import load_scenario

ROOM = 2**30
"""Pages of a store that is not full."""


class Limited:
    """A database whose file may have so many pages."""

    def __init__(self, folder):
        self.database = Database(f"sqlite:///{folder / 'hrs.db'}")
        self.database.migrate()
        self.pages = ROOM
        sa.event.listen(self.database.engine, "begin", self._limit)

    def _limit(self, connection):
        connection.exec_driver_sql(f"PRAGMA max_page_count = {self.pages}")

    def ask(self, query):
        with self.database.read() as connection:
            return connection.exec_driver_sql(query).scalar()

    def rows(self):
        names = ("jobs", "chunks", "results", "series", "twins", "twin_segments", "twin_events")
        return [self.ask(f"SELECT count(*) FROM {name}") for name in names]  # noqa: S608  # names of ours


@pytest.fixture
def limited(tmp_path):
    store = Limited(tmp_path)
    yield store
    store.pages = ROOM
    store.database.close()


def _full_at_every_page(store, act):
    """Let `act` run out of room one page later each time, until it does not; how often it did."""
    before, used = store.rows(), store.ask("PRAGMA page_count")
    for missed in range(200):
        store.pages = used + missed
        why = _refused(act)
        store.pages = ROOM
        if not why:
            assert store.rows() != before
            return missed
        assert "full" in why
        assert store.rows() == before
        assert store.ask("PRAGMA integrity_check") == "ok"
    raise AssertionError("it never had room enough")


def _refused(act):
    """Why the store does not take it; empty if it does."""
    try:
        act()
    except StoreError as error:
        return str(error)
    return ""


@pytest.mark.slow
def test_a_job_and_its_results_are_stored_whole_or_not_at_all(limited):
    jobs = JobRepository(limited.database)
    spec = comparison_spec([load_scenario("S1").model_copy(update={"name": "x" * 90})] * 40, ["logic"], 1, 0)
    job = []

    def submit():
        job[:] = [jobs.add(JobKind.COMPARISON, spec, COMPARISON.summarize(spec), COMPARISON.initial_chunks(spec), 9)]

    assert _full_at_every_page(limited, submit) > 5
    lease = jobs.claim("me", 60, 3)
    assert (
        _full_at_every_page(limited, lambda: jobs.complete(lease, ChunkResult(b"[" + b"1," * 200_000 + b"1]", 1))) > 5
    )
    assert len(jobs.results(job[0].id)) == 200_001


def test_twins_run_on_while_the_store_is_full_and_all_they_told_is_stored_later(limited):
    twins = Twins(TwinRepository(limited.database, "one"), Settings(checkpoint_s=0.1))
    refused = threading.Event()
    limited.database.on_error = refused.set
    try:
        twins.start(TwinRequest.model_validate({"id": "t", "scenario": "S1", "speed": 100, "at_end": "repeat"}))
        limited.pages = limited.ask("PRAGMA page_count")
        assert refused.wait(60)
        seen = twins.samples("t")
        until = time.monotonic() + 60
        while twins.samples("t") < seen + 200:
            assert time.monotonic() < until
            time.sleep(0.01)
        limited.pages = ROOM
    finally:
        twins.close(60)
    history = twins.history("t", 0, 10**6)
    assert [sample.seq for sample in history] == list(range(len(history)))
    assert len(history) >= seen + 200
    events = twins.events("t", -1, 10**6)
    assert [event["seq"] for event in events] == list(range(len(events)))
    assert limited.ask("SELECT samples FROM twins") == len(history)
