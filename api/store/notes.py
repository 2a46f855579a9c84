"""Notes of people on the time axis of twins; they go with their twin."""

from __future__ import annotations

import sqlalchemy as sa

from api.store.database import Database
from api.store.idempotency import keep
from api.store.records import CapacityError, StoredNote, StoredResponse, Superseded
from api.store.tables import twin_notes, twins

_FIELDS = [twin_notes.c[name] for name in StoredNote.__slots__]

NOTES_MAX = 1000
"""Most notes of a twin: some 300 kB of JSON."""


class NoteRepository:
    """The notes on twins."""

    def __init__(self, database: Database, keep_s: float = 86_400.0) -> None:
        self._database = database
        self._keep_s = keep_s  # how long answers are kept [s]

    def add(self, twin_id: str, note: StoredNote, answer: StoredResponse | None = None) -> None:
        """Store a note, and the answer to who wrote it, in one transaction.

        Raises
        ------
        Superseded
            if there is no such twin.
        CapacityError
            if the twin has NOTES_MAX.
        KeyTaken
            if another request has used the answer's idempotency key.
        """
        held = sa.select(twins.c.id).where(twins.c.id == twin_id).with_for_update()  # so that what is counted holds
        count = sa.select(sa.func.count()).select_from(twin_notes).where(twin_notes.c.twin_id == twin_id)
        with self._database.write() as connection:
            if connection.scalar(held) is None:
                raise Superseded
            if (found := connection.scalar(count) or 0) >= NOTES_MAX:
                raise CapacityError(f"twin {twin_id!r} has {found} notes; the limit is {NOTES_MAX}: delete some")
            if answer is not None:
                keep(connection, answer, self._keep_s)
            row = {name: getattr(note, name) for name in StoredNote.__slots__}
            connection.execute(twin_notes.insert(), {"twin_id": twin_id, **row})

    def within(self, twin_id: str, first: float | None, last: float | None) -> list[StoredNote]:
        """The notes on a twin of which a part lies between two times, both included [s], in the order of time."""
        in_order = twin_notes.c.time_s, twin_notes.c.id
        query = sa.select(*_FIELDS).where(twin_notes.c.twin_id == twin_id).order_by(*in_order)
        if last is not None:
            query = query.where(twin_notes.c.time_s <= last)
        if first is not None:
            query = query.where(sa.func.coalesce(twin_notes.c.to_s, twin_notes.c.time_s) >= first)
        with self._database.read() as connection:
            return [StoredNote(*row) for row in connection.execute(query)]

    def remove(self, twin_id: str, note_id: str) -> bool:
        """Forget a note; False if there is none."""
        query = twin_notes.delete().where(twin_notes.c.twin_id == twin_id, twin_notes.c.id == note_id)
        with self._database.write() as connection:
            return connection.execute(query).rowcount == 1
