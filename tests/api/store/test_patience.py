"""How long callers wait for a store that does not answer, and what they are told."""

from __future__ import annotations

import sqlite3
import threading
import time
from contextlib import closing

import pytest

from api.store import keys as store_keys
from api.store import patience
from api.store.database import Database, SilentStoreError, StoreError
from api.store.keys import KeyRepository
from api.store.patience import Arrival, Breaker, Cap, Wait, arrival, patient
from tests.pace import slowness
from tests.waiting import wait_until


@pytest.fixture
def locked(tmp_path):
    """A SQLite database whose writer's lock another connection holds."""
    database = Database(f"sqlite:///{tmp_path / 'hrs.db'}")
    database.migrate()
    with closing(sqlite3.connect(tmp_path / "hrs.db", isolation_level=None)) as holder:
        holder.execute("BEGIN IMMEDIATE")
        yield database
        holder.execute("ROLLBACK")
        wait_until(lambda: not database.silent)
        with database.write():
            pass
    database.close()


def _took(act, error=StoreError):
    began = time.monotonic()
    with pytest.raises(error):
        act()
    return time.monotonic() - began


def _write(database):
    with database.write():
        pass


@pytest.mark.timed
def test_a_locked_file_is_waited_for_once_and_then_refused_at_once(locked):
    assert _took(lambda: _write(locked)) < patience.REQUEST_S + 1
    assert locked.silent
    assert _took(lambda: _write(locked), SilentStoreError) < 0.5 * slowness()
    with locked.read() as connection:
        assert connection.exec_driver_sql("SELECT count(*) FROM jobs").scalar() == 0


def test_a_short_lock_is_waited_for(tmp_path):
    """Nothing is refused because somebody else writes for a moment."""
    database = Database(f"sqlite:///{tmp_path / 'hrs.db'}")
    database.migrate()
    holds = threading.Event()

    def hold():
        with database.write():
            holds.set()
            time.sleep(0.4)

    thread = threading.Thread(target=hold)
    thread.start()
    assert holds.wait(10)
    _write(database)
    thread.join()
    database.close()


@pytest.mark.timed
def test_a_service_that_closes_waits_for_nothing(locked, monkeypatch):
    monkeypatch.setattr(patience, "OPEN_S", 60.0)
    threading.Timer(0.3, locked.end_waiting, (0.2,)).start()
    assert 0.3 < _took(lambda: _write(locked)) < 3
    locked._cap.at = float("inf")


def test_a_request_waits_from_its_arrival_and_a_moment_at_least():
    arrived = Arrival()
    held = arrival.set(arrived)
    try:
        assert patience.REQUEST_S - 0.2 < patience.left_s() <= patience.REQUEST_S
        arrived.at -= 100
        assert patience.left_s() == patience.LEAST_S
        wait = Wait(Cap())
        assert not wait.over
        wait._until = 0.0
        assert wait.over
        wait.answered()  # bytes came: a long answer is no silence
        assert not wait.over
        with patient(60.0):
            assert Wait(Cap())._until > time.monotonic() + 50
    finally:
        arrival.reset(held)


def test_a_long_wait_is_no_silence_where_a_probe_is_answered():
    """A lock on a row, or much to compute, keeps nobody else out."""
    asked = []
    breaker = Breaker(lambda: asked.append(1))
    wait = Wait(Cap(), breaker)
    wait._heard -= 10
    assert not wait.over
    wait_until(lambda: asked and breaker._suspected is None)
    assert not breaker.open


def test_a_breaker_opens_while_its_probe_waits_and_closes_with_the_answer(monkeypatch):
    monkeypatch.setattr(patience, "OPEN_S", 0.05)
    thaw = threading.Event()
    probes = []
    breaker = Breaker(lambda: (probes.append(1), thaw.wait(30)))
    for _ in range(100):
        breaker.suspect()
    wait_until(lambda: breaker.open)
    assert len(probes) == 1
    assert Wait(Cap(), breaker).over
    thaw.set()
    wait_until(lambda: not breaker.open)


def test_a_key_that_was_valid_is_taken_while_the_store_is_silent(database, monkeypatch):
    keys = KeyRepository(database)
    known, unknown = keys.create("ann"), keys.create("bob")
    assert keys.valid(known).name == "ann"

    def silent():
        raise StoreError("silent")

    with monkeypatch.context() as broken:
        broken.setattr(database, "read", silent)
        assert keys.valid(known).name == "ann"
        with pytest.raises(StoreError):
            keys.valid(unknown)
        broken.setattr(store_keys, "SEEN_S", 0.0)
        with pytest.raises(StoreError):
            keys.valid(known)
    keys.revoke("ann")
    with monkeypatch.context() as broken:
        broken.setattr(database, "read", silent)
        with pytest.raises(StoreError):
            keys.valid(known)
    assert keys.valid(known) is None
