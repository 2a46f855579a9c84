"""Whatever fails at whatever statement: all of an operation is stored or nothing, and it can be repeated.

Every operation that writes is run once for each of its statements and commits, on both databases, with a fault before
and behind that step.
"""

from __future__ import annotations

import random
import secrets
import sys
import time
from pathlib import Path
from typing import Any

import pytest

import api
from api.store import idempotency, jobs, keys, measurements, scenarios, twins
from api.store.database import StoreError, open_database
from api.store.keys import KeyRepository
from tests.api.conftest import long_database_url, postgres_server, postgres_url  # noqa: F401  # fixtures
from tests.nemesis.operations import BY_NAME, OPERATIONS, fix
from tests.nemesis.statements import CRASHED, Copies, Fault, Statements, contents, crashes, decided, steps_of, writers

PLACES_MAX = 12
"""Of an operation with more steps (a migration, a restore) so many are drawn, the first and the last among them."""

PLACES_FEW = 3
"""With every run of the tests; all with the full ones."""

NOT_HERE = {
    "Database.write", "Database.read",  # what begins the transactions
    "Database.shrink",  # moves pages, and changes no row
    "_snapshot",  # a backup reads; its file is written elsewhere
}  # fmt: skip


@pytest.fixture(autouse=True)
def _unfixed():
    yield
    for module in (jobs, twins, keys, idempotency, scenarios, measurements):
        module.time = time
    for module in (jobs, keys):
        module.secrets = secrets


@pytest.mark.slow
def test_every_transaction_that_writes_is_tried():
    """Whoever adds one adds an operation to `operations.py`."""
    assert len(BY_NAME) == len(OPERATIONS)
    found = writers(Path(api.__file__).parent)
    assert found - NOT_HERE == {operation.of for operation in OPERATIONS}
    assert found >= NOT_HERE


def _act(name: str, url: str, prepared: Any, fault: Fault | None) -> None:
    """Run an operation in this process, which the fault may end."""
    fix(1)
    with open_database(url) as database:
        database.check()
        with Statements(database, fault).watched():
            BY_NAME[name].act(database, prepared)


def _faults(steps: list[str], places_max: int, *, sqlite: bool) -> list[Fault]:
    places = list(range(len(steps)))
    if len(places) > places_max:
        drawn = random.Random(7).sample(places[1:-1], places_max - 2)
        places = sorted({0, places[-1], decided(steps), *drawn})
    faults = [Fault(place, after, "error") for place in places for after in (False, True)]
    if sqlite:  # nothing lies between us and SQLite that could be lost
        return faults + [Fault(each.place, each.after, "crash") for each in faults]
    lost = [Fault(each.place, each.after, "lost") for each in faults]  # as PostgreSQL sees a process that crashes
    return faults + lost + [Fault(decided(steps), after, "crash") for after in (False, True)]


@pytest.mark.slow
@pytest.mark.parametrize("places", [PLACES_FEW, pytest.param(PLACES_MAX, marks=pytest.mark.full)])
@pytest.mark.parametrize("operation", OPERATIONS, ids=str)
def test_all_or_nothing_at_every_statement(operation, long_database_url, tmp_path, places):  # noqa: F811  # the fixture
    def prepare(database):
        fix(1)
        return operation.prepare(database, tmp_path)

    copies = Copies(long_database_url, tmp_path, prepare)
    prepared = copies.prepared
    with copies.another() as url, open_database(url) as database:
        database.check()
        fix(1)
        before = contents(url)
        steps, result = steps_of(database, lambda: operation.act(database, prepared))
        done = contents(url)
    assert before != done
    for fault in _faults(steps, places, sqlite=copies.sqlite):
        with copies.another() as url:
            _try(operation, url, prepared, fault, steps, (before, done, result))


def _try(operation, url, prepared, fault, steps, expected):
    before, done, result = expected
    about = f"{fault}: {steps[fault.place]:.60}"
    took_effect = (fault.place, fault.after) >= (decided(steps), True)
    with open_database(url) as database:
        if fault.kind == "crash":
            assert crashes(_act, str(operation), url, prepared, fault), about
        else:
            database.check()
            fix(1)
            if _went_well(operation, database, prepared, fault):  # SQLAlchemy looks at tables in more than one way
                assert steps[fault.place].startswith(("SELECT", "PRAGMA")), about
                assert contents(url) == done, about
                return
        assert contents(url) == (done if took_effect else before), about
        assert database.engine.pool.checkedout() == 0, about
        fix(2 if took_effect else 1)
        if not took_effect:
            assert operation.act(database, prepared) == result, about
            assert contents(url) == done, about
        elif isinstance(operation.again, tuple):
            operation.act(database, prepared)
            now = contents(url)
            assert {name for name in now if now[name] != done[name]} <= set(operation.again), about
            assert {name: len(rows) for name, rows in now.items()} == {name: len(done[name]) for name in done}, about
        else:
            with pytest.raises(operation.again):
                operation.act(database, prepared)
            assert contents(url) == done, about
        assert database.engine.pool.checkedout() == 0, about
        _sound(database)


def _went_well(operation, database, prepared, fault):
    with Statements(database, fault).watched():
        try:
            operation.act(database, prepared)
        except StoreError:
            return False
    return True


def _sound(database):
    """Connections can be taken, several at once, and written through."""
    fix(3)
    KeyRepository(database).create("afterwards")
    held = [database.engine.connect() for _ in range(3)]
    try:
        assert all(connection.exec_driver_sql("SELECT 1").scalar() == 1 for connection in held)
    finally:
        for connection in held:
            connection.close()


def test_a_fault_that_was_not_noticed_would_be_seen(tmp_path):
    """The harness: steps are counted, faults come where they are told to, crashes end the process."""
    url = f"sqlite:///{tmp_path / 'a.db'}"
    with open_database(url) as database:
        database.migrate()
        steps, _ = steps_of(database, lambda: KeyRepository(database).create("ann"))
    assert [step.split()[0] for step in steps] == ["INSERT", "COMMIT"]
    assert decided(steps) == 1
    assert not crashes(_act, "KeyRepository.create", f"{url}-none", None, None)  # it fails: there is no table
    assert CRASHED not in {0, 1}
    assert sys.modules["api.store.jobs"] is jobs
