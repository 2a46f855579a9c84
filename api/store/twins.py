"""Live twins as stored: settings, the last snapshot, samples in segments, events."""

from __future__ import annotations

import time
from typing import Any

import sqlalchemy as sa
from sqlalchemy.exc import IntegrityError

from api.store.database import Database
from api.store.idempotency import forget, keep, keep_beside
from api.store.records import Checkpoint, Conflict, KeptAnswer, StoredTwin, Superseded
from api.store.tables import twin_events, twin_segments, twins

_ABOUT = [
    twins.c[name] for name in ("id", "settings", "changes", "state", "epoch", "samples", "events", "created", "changed")
]  # all but the snapshot

FIRST_EPOCH = 1
"""Of a twin that has just been added."""


class TwinRepository:
    """The twins of one server (`instance`) on a database."""

    def __init__(self, database: Database, instance: str, keep_s: float = 86_400.0) -> None:
        self._database = database
        self._keep_s = keep_s  # how long answers are kept [s]
        self._instance = instance

    def add(self, twin_id: str, settings: dict[str, Any], answer: KeptAnswer | None = None) -> StoredTwin:
        """Store a new twin, taken by this server, and the answer to who asked for it, in one transaction.

        Raises
        ------
        Conflict
            if one of that id exists, on whatever server.
        KeyTaken
            if another request has used the answer's idempotency key.
        """
        now = time.time()
        row = {
            "id": twin_id, "instance": self._instance, "settings": settings, "changes": {}, "state": "running",
            "epoch": FIRST_EPOCH, "samples": 0, "events": 0, "created": now, "changed": now,
        }  # fmt: skip
        added = StoredTwin(twin_id, settings, "running", FIRST_EPOCH, 0, 0, now, now)
        try:
            with self._database.write() as connection:
                connection.execute(twins.insert(), row)
                if answer is not None:
                    keep(connection, answer, self._keep_s)
        except IntegrityError:
            raise Conflict(f"a twin called {twin_id!r} exists") from None
        return added

    def get(self, twin_id: str) -> StoredTwin | None:
        """The twin, or None."""
        with self._database.read() as connection:
            row = connection.execute(self._own().where(twins.c.id == twin_id)).one_or_none()
        return None if row is None else _twin(row)

    def all(self) -> list[StoredTwin]:
        """Every twin of this server, the oldest first."""
        with self._database.read() as connection:
            return [_twin(row) for row in connection.execute(self._own().order_by(twins.c.created, twins.c.id))]

    def page(self, behind: tuple[float, str] | None, limit: int) -> list[StoredTwin]:
        """The oldest twins of this server behind the one created at that Unix time [s] with that id."""
        with self._database.read() as connection:
            return [_twin(row) for row in connection.execute(self.oldest(behind, limit))]

    def oldest(self, behind: tuple[float, str] | None, limit: int) -> sa.Select[Any]:
        """The query of `page`; an index has its order."""
        query = self._own().order_by(twins.c.created, twins.c.id).limit(limit)
        if behind:
            created, last = behind
            place = sa.tuple_(sa.literal(created), sa.literal(last))
            query = query.where(sa.tuple_(twins.c.created, twins.c.id) > place)
        return query

    def states(self) -> dict[str, str]:
        """State by id of every twin of this server."""
        query = sa.select(twins.c.id, twins.c.state).where(twins.c.instance == self._instance)
        with self._database.read() as connection:
            return {row.id: row.state for row in connection.execute(query)}

    def _own(self) -> sa.Select[Any]:
        return sa.select(*_ABOUT).where(twins.c.instance == self._instance)

    def open(self, twin_id: str) -> tuple[int, bytes | None]:
        """Take a twin over: its new epoch, from which on nobody else's checkpoint counts, and its last snapshot."""
        taken = (
            twins.update()
            .where(twins.c.id == twin_id)
            .values(epoch=twins.c.epoch + 1, changed=time.time())
            .returning(twins.c.epoch, twins.c.snapshot)
        )
        with self._database.write() as connection:
            epoch, snapshot = connection.execute(taken).one()
        return epoch, snapshot

    def save(self, twin_id: str, epoch: int, checkpoint: Checkpoint) -> None:
        """Store what a twin told since its last checkpoint, and where it stands, in one transaction.

        A checkpoint may be saved again: whoever loses the connection cannot know whether it was stored.

        Raises
        ------
        Superseded
            if the twin has been taken over or removed; nothing is written.
        """
        now = time.time()
        told = checkpoint.events
        held = twins.update().where(twins.c.id == twin_id, twins.c.epoch == epoch)
        with self._database.write() as connection:
            done = connection.execute(
                held.values(
                    state=checkpoint.state,
                    changes=checkpoint.changes,
                    snapshot=checkpoint.snapshot,
                    samples=checkpoint.first_seq + checkpoint.rows,
                    events=told[-1]["seq"] + 1 if told else twins.c.events,
                    changed=now,
                )
            )
            if done.rowcount != 1:
                raise Superseded
            if checkpoint.segment is not None:
                grown = twin_segments.c.twin_id == twin_id, twin_segments.c.first_seq == checkpoint.first_seq
                connection.execute(twin_segments.delete().where(*grown))
                connection.execute(
                    twin_segments.insert(),
                    {
                        "twin_id": twin_id,
                        "first_seq": checkpoint.first_seq,
                        "epoch": epoch,
                        "rows": checkpoint.rows,
                        "stored": now,
                        "parquet": checkpoint.segment,
                    },
                )
            if told:
                numbers = twin_events.c.seq.between(told[0]["seq"], told[-1]["seq"])
                connection.execute(twin_events.delete().where(twin_events.c.twin_id == twin_id, numbers))
                rows = [{"twin_id": twin_id, "seq": event["seq"], "stored": now, "document": event} for event in told]
                connection.execute(twin_events.insert(), rows)
            keep_beside(connection, checkpoint.answers)

    def segments(self, twin_id: str, first_seq: int, last_seq: int) -> list[tuple[int, int, bytes]]:
        """(first_seq, epoch, Parquet) of the segments that overlap these rows, in order."""
        query = (
            sa.select(twin_segments.c.first_seq, twin_segments.c.epoch, twin_segments.c.parquet)
            .where(
                twin_segments.c.twin_id == twin_id,
                twin_segments.c.first_seq <= last_seq,
                twin_segments.c.first_seq + twin_segments.c.rows > first_seq,
            )
            .order_by(twin_segments.c.first_seq)
        )
        with self._database.read() as connection:
            return [tuple(row) for row in connection.execute(query)]

    def epochs(self, twin_id: str) -> dict[int, int]:
        """First row of each epoch that has stored any."""
        segments = twin_segments.c
        query = sa.select(segments.epoch, sa.func.min(segments.first_seq)).where(segments.twin_id == twin_id)
        with self._database.read() as connection:
            return {row[0]: row[1] for row in connection.execute(query.group_by(segments.epoch))}

    def events(self, twin_id: str, after: int, limit: int) -> list[dict[str, Any]]:
        """Documents of the events behind number `after`, in order."""
        query = (
            sa.select(twin_events.c.document)
            .where(twin_events.c.twin_id == twin_id, twin_events.c.seq > after)
            .order_by(twin_events.c.seq)
            .limit(limit)
        )
        with self._database.read() as connection:
            return list(connection.scalars(query))

    def first_event(self, twin_id: str, epoch: int) -> int | None:
        """Number of the first stored event of a later epoch than this one; None if there is none."""
        later = twin_events.c.document["epoch"].as_integer() > epoch
        query = sa.select(sa.func.min(twin_events.c.seq)).where(twin_events.c.twin_id == twin_id, later)
        with self._database.read() as connection:
            return connection.scalar(query)

    def remove(self, twin_id: str, answer: KeptAnswer | None = None) -> None:
        """Forget a twin with everything it told; and the answer that it was made, if it never began."""
        with self._database.write() as connection:
            connection.execute(twins.delete().where(twins.c.id == twin_id))
            if answer is not None:
                forget(connection, answer)

    def prune(self, before: float) -> int:
        """Forget samples and events stored before this Unix time [s]; how many segments there were."""
        with self._database.write() as connection:
            connection.execute(twin_events.delete().where(twin_events.c.stored < before))
            return connection.execute(twin_segments.delete().where(twin_segments.c.stored < before)).rowcount


def _twin(row: Any) -> StoredTwin:
    settings = {**row.settings, **row.changes}
    return StoredTwin(row.id, settings, row.state, row.epoch, row.samples, row.events, row.created, row.changed)
