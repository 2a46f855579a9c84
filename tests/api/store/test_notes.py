"""Notes on both databases: in the order of time, bounded, gone with their twin."""

from __future__ import annotations

import pytest

from api.store import notes as store
from api.store.notes import NoteRepository
from api.store.records import CapacityError, StoredNote, Superseded
from api.store.twins import TwinRepository


def _note(name, time_s, to_s=None):
    return StoredNote(name, time_s, to_s, "\u2028 \U0001f698 0.1", "me", 0.1 + 0.2)


def test_notes_are_kept_in_the_order_of_their_times(database):
    twins, notes = TwinRepository(database, "one"), NoteRepository(database)
    for twin in ("a", "b"):
        twins.add(twin, {})
    given = [_note("n1", 7.5), _note("n2", 0.1 + 0.2, 5.0), _note("n3", 7.5, 1e12)]
    for note in given:
        notes.add("a", note)
    notes.add("b", given[0])
    assert notes.within("a", None, None) == [given[1], given[0], given[2]]
    assert notes.within("a", 5.0, 7.0) == [given[1]]
    assert notes.within("a", 8.0, None) == [given[2]]
    assert notes.within("a", None, 0.2) == []
    assert notes.remove("a", "n1")
    assert not notes.remove("a", "n1")
    assert notes.within("b", None, None) == [given[0]]
    twins.remove("a")
    assert notes.within("a", None, None) == []
    with pytest.raises(Superseded):
        notes.add("a", given[0])
    assert notes.within("b", None, None) == [given[0]]


def test_a_twin_has_so_many_notes_at_most(database, monkeypatch):
    monkeypatch.setattr(store, "NOTES_MAX", 2)
    TwinRepository(database, "one").add("a", {})
    notes = NoteRepository(database)
    for name in ("n1", "n2"):
        notes.add("a", _note(name, 1.0))
    with pytest.raises(CapacityError, match="twin 'a' has 2 notes; the limit is 2"):
        notes.add("a", _note("n3", 1.0))
    notes.remove("a", "n1")
    notes.add("a", _note("n3", 1.0))
    assert [note.id for note in notes.within("a", None, None)] == ["n2", "n3"]
