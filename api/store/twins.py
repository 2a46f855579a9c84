"""Live twins as stored: settings, the last snapshot, samples in segments, events."""

from __future__ import annotations

import time
from collections.abc import Collection, Sequence
from itertools import pairwise, takewhile
from typing import Any

import sqlalchemy as sa
from sqlalchemy.exc import IntegrityError

from api.store.database import Database
from api.store.idempotency import forget, keep, keep_beside
from api.store.measurements import MeasurementRepository, take_in
from api.store.records import Checkpoint, Conflict, StoredResponse, StoredTwin, Superseded
from api.store.tables import twin_events, twin_minutes, twin_segments, twins

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
        self.measurements = MeasurementRepository(database)

    @property
    def silent(self) -> bool:
        """Whether the database is known not to answer."""
        return self._database.silent

    def add(
        self, twin_id: str, settings: dict[str, Any], answer: StoredResponse | None = None,
        snapshot: bytes | None = None,
    ) -> StoredTwin:  # fmt: skip
        """Store a new twin, taken by this server, and the answer to who asked for it, in one transaction.

        `snapshot` is the state with which it begins, where that is not its scenario's.

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
            "snapshot": snapshot,
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

    def snapshot(self, twin_id: str) -> bytes | None:
        """The last snapshot of a twin, which stays whose it is."""
        query = sa.select(twins.c.snapshot).where(twins.c.id == twin_id, twins.c.instance == self._instance)
        with self._database.read() as connection:
            found: bytes | None = connection.execute(query).scalar_one_or_none()
        return found

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
            if checkpoint.measured is not None:
                take_in(connection, twin_id, checkpoint.measured)

    def segments(self, twin_id: str, first_seq: int, last_seq: int) -> list[tuple[int, int, bytes]]:
        """(first_seq, epoch, Parquet) of the segments that overlap these rows, in order."""
        with self._database.read() as connection:
            return [tuple(row) for row in connection.execute(_overlapping(twin_segments, twin_id, first_seq, last_seq))]

    def parts(
        self, twin_id: str, first_seq: int, last_seq: int
    ) -> tuple[list[tuple[int, int, bytes]], list[tuple[int, int, bytes]]]:  # fmt: skip
        """As for `segments`: what is kept as minutes, and what is kept whole, seen at one moment."""
        with self._database.read() as connection:
            thin, full = (
                [tuple(row) for row in connection.execute(_overlapping(table, twin_id, first_seq, last_seq))]
                for table in (twin_minutes, twin_segments)
            )
        return thin, full

    def to_thin(self, before: float, limit: int) -> list[tuple[str, int, int, int, float, bytes]]:
        """(id, epoch, first_seq, rows, stored, Parquet) of the oldest segments stored before this Unix time [s].

        They follow each other, are of one twin and epoch, and none is a twin's last, which may still grow.
        """
        segments = twin_segments.c
        query = (
            sa.select(
                segments.twin_id, segments.epoch, segments.first_seq, segments.rows, segments.stored, segments.parquet
            )
            .join_from(twin_segments, twins)
            .where(
                twins.c.instance == self._instance,
                segments.stored < before,
                segments.first_seq + segments.rows < twins.c.samples,
            )
            .order_by(segments.twin_id, segments.first_seq)
            .limit(limit)
        )
        with self._database.read() as connection:
            found = [tuple(row) for row in connection.execute(query)]
        for place, (before_it, row) in enumerate(pairwise(found), 1):
            if row[:2] != before_it[:2] or row[2] != before_it[2] + before_it[3]:
                return found[:place]
        return found

    def thin(self, twin_id: str, epoch: int, first_seq: int, rows: int, stored: float, parquet: bytes) -> None:
        """Put minutes in the place of the segments that they were made of, in one transaction.

        Raises
        ------
        Superseded
            if these are not there any more; nothing is written.
        """
        segments = twin_segments.c
        made_of = (
            segments.twin_id == twin_id, segments.epoch == epoch,
            segments.first_seq.between(first_seq, first_seq + rows - 1),
        )  # fmt: skip
        with self._database.write() as connection:
            there = connection.scalar(sa.select(sa.func.sum(segments.rows)).where(*made_of))
            if there != rows:
                raise Superseded
            connection.execute(twin_segments.delete().where(*made_of))
            connection.execute(
                twin_minutes.insert(),
                {
                    "twin_id": twin_id, "first_seq": first_seq, "epoch": epoch, "rows": rows, "stored": stored,
                    "parquet": parquet,
                },
            )  # fmt: skip

    def first_kept(self, twin_id: str, seq: int) -> int | None:
        """Number of the first sample from `seq` on that is kept whole."""
        segments = twin_segments.c
        query = sa.select(sa.func.min(segments.first_seq)).where(
            segments.twin_id == twin_id, segments.first_seq + segments.rows > seq
        )
        with self._database.read() as connection:
            found = connection.scalar(query)
        return None if found is None else max(found, seq)

    def thinned_to(self, twin_id: str) -> int:
        """Number behind the last sample that is kept as minutes alone; 0 if there is none."""
        query = sa.select(sa.func.max(twin_minutes.c.first_seq + twin_minutes.c.rows))
        with self._database.read() as connection:
            return connection.scalar(query.where(twin_minutes.c.twin_id == twin_id)) or 0

    def epochs(self, twin_id: str) -> dict[int, int]:
        """First row of each epoch that has stored any."""
        first: dict[int, int] = {}
        with self._database.read() as connection:
            for table in (twin_segments, twin_minutes):
                query = sa.select(table.c.epoch, sa.func.min(table.c.first_seq)).where(table.c.twin_id == twin_id)
                for epoch, begin in connection.execute(query.group_by(table.c.epoch)):
                    first[epoch] = min(begin, first.get(epoch, begin))
        return first

    def events(self, twin_id: str, after: int, limit: int, kinds: Collection[str] = ()) -> list[dict[str, Any]]:
        """Documents of the events behind number `after`, in order; of some kinds if any is named."""
        query = (
            sa.select(twin_events.c.document)
            .where(twin_events.c.twin_id == twin_id, twin_events.c.seq > after)
            .order_by(twin_events.c.seq)
            .limit(limit)
        )
        if kinds:
            query = query.where(twin_events.c.document["kind"].as_string().in_([*kinds]))
        with self._database.read() as connection:
            return list(connection.scalars(query))

    def last_events(
        self, twin_id: str, before: int, limit: int, kinds: Collection[str] = ()
    ) -> list[dict[str, Any]]:  # fmt: skip
        """Documents of the last events below number `before`, in order; of some kinds if any is named."""
        query = (
            sa.select(twin_events.c.document)
            .where(twin_events.c.twin_id == twin_id, twin_events.c.seq < before)
            .order_by(twin_events.c.seq.desc())
            .limit(limit)
        )
        if kinds:
            query = query.where(twin_events.c.document["kind"].as_string().in_([*kinds]))
        with self._database.read() as connection:
            return list(connection.scalars(query))[::-1]

    def thin_events(
        self, twin_id: str, kinds: Sequence[str], before: float, behind: int, limit: int
    ) -> tuple[int, int] | None:  # fmt: skip
        """Of the next `limit` events behind number `behind`, forget those of these kinds that are old.

        Old is what was stored before this Unix time [s]. The result is the number of the last event that was looked
        at, and how many were forgotten; None where no old one is left. Without any to forget nothing is written.
        """
        events = twin_events.c
        query = (
            sa.select(events.seq, events.stored, events.document["kind"].as_string())
            .where(events.twin_id == twin_id, events.seq > behind)
            .order_by(events.seq)
            .limit(limit)
        )
        with self._database.read() as connection:
            old = list(takewhile(lambda row: row[1] < before, connection.execute(query)))
        if not old:
            return None
        forgotten = [row[0] for row in old if row[2] in kinds]
        if forgotten:
            between = events.seq.between(forgotten[0], forgotten[-1])
            of_these = events.document["kind"].as_string().in_(kinds)
            with self._database.write() as connection:
                connection.execute(
                    twin_events.delete().where(events.twin_id == twin_id, between, of_these, events.stored < before)
                )
        return old[-1][0], len(forgotten)

    def first_event(self, twin_id: str, epoch: int) -> int | None:
        """Number of the first stored event of a later epoch than this one; None if there is none."""
        later = twin_events.c.document["epoch"].as_integer() > epoch
        query = sa.select(sa.func.min(twin_events.c.seq)).where(twin_events.c.twin_id == twin_id, later)
        with self._database.read() as connection:
            return connection.scalar(query)

    def remove(self, twin_id: str, answer: StoredResponse | None = None) -> None:
        """Forget a twin with everything it told; and the answer that it was made, if it never began."""
        with self._database.write() as connection:
            connection.execute(twins.delete().where(twins.c.id == twin_id))
            if answer is not None:
                forget(connection, answer)

    def prune(self, before: float) -> int:
        """Forget samples and events stored before this Unix time [s]; how many segments there were."""
        with self._database.write() as connection:
            connection.execute(twin_events.delete().where(twin_events.c.stored < before))
            connection.execute(twin_minutes.delete().where(twin_minutes.c.stored < before))
            return connection.execute(twin_segments.delete().where(twin_segments.c.stored < before)).rowcount


def _overlapping(table: sa.Table, twin_id: str, first_seq: int, last_seq: int) -> sa.Select[Any]:
    return (
        sa.select(table.c.first_seq, table.c.epoch, table.c.parquet)
        .where(table.c.twin_id == twin_id, table.c.first_seq <= last_seq, table.c.first_seq + table.c.rows > first_seq)
        .order_by(table.c.first_seq)
    )


def _twin(row: Any) -> StoredTwin:
    settings = {**row.settings, **row.changes}
    return StoredTwin(row.id, settings, row.state, row.epoch, row.samples, row.events, row.created, row.changed)
