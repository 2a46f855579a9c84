"""The log of measurements on both databases: once each, in order, for a twin that is still this server's."""

from __future__ import annotations

import threading

import pytest
import sqlalchemy as sa

from api.store.measurements import SEQUENCES, SOURCES_MAX
from api.store.records import Checkpoint, Conflict, StoredMeasurements, Superseded
from api.store.tables import measurements
from api.store.twins import TwinRepository


@pytest.fixture
def twins(database):
    store = TwinRepository(database, "one")
    store.add("demo", {})
    return store


def _append(twins, sequence, source="plc", digest=None, epoch=1, payload=b"p"):
    return twins.measurements.append("demo", epoch, source, sequence, digest or f"{sequence:064}", 30, payload)


def _checkpoint(measured):
    return Checkpoint("running", {}, b"snap", 0, 0, None, measured=measured)


def test_what_is_sent_again_has_its_number_and_is_stored_once(twins):
    assert [_append(twins, n).number for n in (5, 7, 6)] == [1, 2, 3]
    assert _append(twins, 5, source="other").number == 4
    assert _append(twins, 7) == StoredMeasurements(2, repeated=True)
    assert _append(twins, 8) == StoredMeasurements(5, repeated=False)
    assert [number for number, _ in twins.measurements.after("demo", 0, 100)] == [1, 2, 3, 4, 5]
    assert [number for number, _ in twins.measurements.after("demo", 2, 2)] == [3, 4]


def test_another_content_under_the_same_sequence_is_a_conflict(twins):
    _append(twins, 5)
    with pytest.raises(Conflict, match="sequence 5 of source 'plc' was stored with other content"):
        _append(twins, 5, digest="f" * 64)
    assert twins.measurements.after("demo", 0, 100) == [(1, b"p")]


def test_a_sequence_is_refused_of_which_nobody_knows_any_more(twins):
    _append(twins, 10 + SEQUENCES)
    assert _append(twins, 10).number == 2
    with pytest.raises(
        Conflict, match=f"more than {SEQUENCES} below the highest of source 'plc', {10 + SEQUENCES}; gi"
    ):
        _append(twins, 9)
    assert _append(twins, 9, source="other").number == 3


def test_a_source_too_many_is_refused(twins):
    for place in range(SOURCES_MAX):
        _append(twins, 0, source=f"s{place}")
    with pytest.raises(Conflict, match=f"more than {SOURCES_MAX} sources"):
        _append(twins, 0, source="another")
    assert _append(twins, 1, source="s0").number == SOURCES_MAX + 1


def test_nothing_is_stored_for_a_twin_that_another_server_has(twins):
    twins.open("demo")
    with pytest.raises(Superseded):
        _append(twins, 0)
    assert _append(twins, 0, epoch=2).number == 1
    with pytest.raises(Superseded):
        twins.measurements.append("nobody", 1, "plc", 0, "d", 1, b"")


def test_a_checkpoint_takes_in_what_it_holds_and_keeps_what_it_does_not(twins, database):
    for sequence in range(4):
        _append(twins, sequence)
    twins.save("demo", 1, _checkpoint(2))
    assert [number for number, _ in twins.measurements.after("demo", 0, 100)] == [3, 4]
    assert _append(twins, 0) == StoredMeasurements(1, repeated=True)
    twins.save("demo", 1, _checkpoint(None))
    twins.save("demo", 1, _checkpoint(2))
    assert [number for number, _ in twins.measurements.after("demo", 0, 100)] == [3, 4]
    _append(twins, 3 + SEQUENCES)
    twins.save("demo", 1, _checkpoint(3))  # sequences 0 to 2 lie too far back; 3 does not
    with database.read() as connection:
        rows = connection.execute(sa.select(measurements.c.sequence, measurements.c.payload)).all()
    assert sorted(rows, key=lambda row: row[0]) == [(3, b"p"), (3 + SEQUENCES, b"p")]


def test_a_checkpoint_that_is_superseded_takes_nothing_in(twins):
    _append(twins, 0)
    twins.open("demo")
    with pytest.raises(Superseded):
        twins.save("demo", 1, _checkpoint(1))
    assert twins.measurements.after("demo", 0, 9) == [(1, b"p")]


def test_numbers_have_no_gap_and_no_double_when_sources_send_at_once(twins):
    found = []

    def send(source):
        found.extend(_append(twins, sequence, source=source).number for sequence in range(25))

    threads = [threading.Thread(target=send, args=(f"s{n}",)) for n in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(found) == list(range(1, 101))
    assert [number for number, _ in twins.measurements.after("demo", 0, 200)] == list(range(1, 101))


def test_the_log_goes_with_the_twin(twins, database):
    _append(twins, 0)
    twins.remove("demo")
    with database.read() as connection:
        assert connection.scalar(sa.select(sa.func.count()).select_from(measurements)) == 0
