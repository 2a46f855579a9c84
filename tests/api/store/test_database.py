"""Migrations, twins and keys on both databases."""

from __future__ import annotations

import pytest
import sqlalchemy as sa

from api.scopes import USUAL
from api.store.database import Database, StoreError
from api.store.keys import KeyRepository
from api.store.records import Checkpoint, Conflict, Superseded
from api.store.twins import TwinRepository


def test_migrations_and_tables_tell_the_same_story(database):
    assert database.differences() == []
    database.migrate()
    assert database.differences() == []


def test_a_database_of_a_newer_version_is_left_alone(database):
    with database.write() as connection:
        connection.execute(sa.text("UPDATE alembic_version SET version_num = '9999'"))
    with pytest.raises(StoreError, match="newer version"):
        database.migrate()


def test_a_database_out_of_reach_is_named_without_its_password():
    database = Database("postgresql+psycopg://hrs:secret@127.0.0.1:1/hrs")
    with pytest.raises(StoreError) as caught:
        database.migrate()
    assert "127.0.0.1:1" in str(caught.value)
    assert "secret" not in str(caught.value)
    database.close()


def test_a_transaction_that_fails_leaves_nothing(database):
    def half() -> None:
        with database.write() as connection:
            connection.execute(sa.text("INSERT INTO keys (name, digest, created) VALUES ('x', 'y', 0)"))
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        half()
    assert KeyRepository(database).all() == []


@pytest.fixture
def twins(database):
    return TwinRepository(database, "one")


def _checkpoint(first, rows, events=()):
    return Checkpoint("running", {"speed": 2}, b"snap%d" % first, first, rows, b"%d" % first, events)


def test_a_twin_keeps_segments_events_and_its_last_snapshot(twins):
    assert twins.add("demo", {"speed": 1, "seed": 7}).epoch == 1
    with pytest.raises(Conflict):
        twins.add("demo", {})
    twins.save("demo", 1, _checkpoint(0, 10, ({"seq": 0, "kind": "started"},)))
    twins.save("demo", 1, _checkpoint(10, 5, ({"seq": 1, "kind": "arrival"}, {"seq": 2, "kind": "fill_start"})))
    stored = twins.get("demo")
    assert (stored.samples, stored.events, stored.settings, stored.state) == (15, 3, {"speed": 2, "seed": 7}, "running")
    twins.save("demo", 1, _checkpoint(10, 6))  # a segment that has grown
    assert twins.get("demo").samples == 16
    assert twins.segments("demo", 0, 100) == [(0, 1, b"0"), (10, 1, b"10")]
    assert twins.segments("demo", 0, 9) == [(0, 1, b"0")]
    assert twins.segments("demo", 10, 10) == [(10, 1, b"10")]
    assert [event["kind"] for event in twins.events("demo", 0, 10)] == ["arrival", "fill_start"]
    assert twins.open("demo") == (2, b"snap10")
    twins.save("demo", 2, _checkpoint(16, 1))
    assert twins.epochs("demo") == {1: 0, 2: 16}
    twins.remove("demo")
    assert twins.all() == []
    assert twins.segments("demo", 0, 100) == []


def test_a_checkpoint_is_saved_again_by_who_cannot_know_that_it_was_stored(twins):
    """The connection was lost behind the commit; meanwhile the twin has told more, which goes with it."""
    twins.add("demo", {})
    told = tuple({"seq": number, "kind": f"event {number}"} for number in range(5))
    twins.save("demo", 1, _checkpoint(0, 10, told[:1]))
    twins.save("demo", 1, _checkpoint(0, 12, told[1:3]))
    twins.save("demo", 1, _checkpoint(0, 12, told[1:3]))
    assert twins.get("demo").events == 3
    twins.save("demo", 1, _checkpoint(0, 15, told[1:]))
    assert (twins.get("demo").events, twins.get("demo").samples) == (5, 15)
    assert twins.events("demo", -1, 10) == list(told)


def test_the_first_event_of_later_epochs(twins):
    twins.add("demo", {})
    told = tuple({"seq": seq, "epoch": epoch} for seq, epoch in enumerate((1, 1, 2, 2, 4)))
    twins.save("demo", 1, _checkpoint(0, 10, told))
    assert [twins.first_event("demo", epoch) for epoch in range(5)] == [0, 2, 4, 4, None]
    assert twins.first_event("nobody", 0) is None


BROKEN = (sa.exc.OperationalError, sa.exc.InternalError, sa.exc.InterfaceError, sa.exc.DatabaseError)


@pytest.mark.parametrize("kind", BROKEN)
def test_what_no_statement_has_earned_is_the_databases_trouble(database, kind):
    """PostgreSQL calls a file that cannot grow an internal error, SQLite a torn file a database error."""
    told = []
    database.on_error = lambda: told.append(kind)
    with pytest.raises(StoreError, match="could not extend file"), database.write():
        raise kind("INSERT", {}, Exception("could not extend file"))
    assert told == [kind]


@pytest.mark.parametrize("kind", [sa.exc.IntegrityError, sa.exc.ProgrammingError])
def test_what_a_statement_has_earned_is_no_trouble_of_the_databases(database, kind):
    with pytest.raises(kind), database.write():
        raise kind("INSERT", {}, Exception("twice"))


def test_a_twin_taken_over_cannot_be_written_by_the_first(twins, database):
    twins.add("demo", {})
    first = twins.get("demo").epoch
    second, snapshot = twins.open("demo")
    assert (second, snapshot) == (first + 1, None)
    with pytest.raises(Superseded):
        twins.save("demo", first, _checkpoint(0, 10))
    assert twins.segments("demo", 0, 100) == []
    twins.save("demo", second, _checkpoint(0, 10))
    assert TwinRepository(database, "two").all() == []
    with pytest.raises(Conflict):
        TwinRepository(database, "two").add("demo", {})


def test_old_samples_and_events_are_forgotten(twins):
    twins.add("demo", {})
    twins.save("demo", 1, _checkpoint(0, 10, ({"seq": 0, "kind": "started"},)))
    assert twins.prune(0.0) == 0
    assert twins.prune(1e12) == 1
    assert twins.events("demo", -1, 10) == []
    assert twins.get("demo").samples == 10


def test_keys_are_stored_as_digests_and_can_be_revoked(database):
    keys = KeyRepository(database)
    assert not keys.any_valid()
    key = keys.create("ann")
    assert keys.valid(key).name == "ann"
    assert keys.valid(key).scopes == USUAL
    assert keys.valid(key + "x") is None
    with pytest.raises(Conflict):
        keys.create("ann")
    with database.read() as connection:
        assert key.encode() not in bytes(connection.exec_driver_sql("SELECT digest FROM keys").scalar())
    assert keys.revoke("ann")
    assert not keys.revoke("ann")
    assert keys.valid(key) is None
    assert not keys.any_valid()
