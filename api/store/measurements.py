"""Measurements of live twins as they came: a log, from which a twin goes on that was killed."""

from __future__ import annotations

import time

import sqlalchemy as sa

from api.store.database import Database
from api.store.records import Conflict, StoredMeasurements, Superseded
from api.store.tables import measurements, twins

SEQUENCES = 1024
"""So far below a source's highest sequence it is still known what was stored; what is older is refused."""

SOURCES_MAX = 64
"""Sources of a twin: each keeps up to SEQUENCES rows."""


class MeasurementRepository:
    """The log of measurements of a server's twins."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def append(
        self, twin_id: str, epoch: int, source: str, sequence: int, digest: str, samples: int, payload: bytes
    ) -> StoredMeasurements:  # fmt: skip
        """Store what a source sent under a sequence number, once; a repetition is found out by its digest.

        Raises
        ------
        Superseded
            if the twin has been taken over or removed.
        Conflict
            if the sequence was stored with another digest, is too old to know, or the source is one too many.
        """
        of_source = measurements.c.twin_id == twin_id, measurements.c.source == source
        there = sa.select(measurements.c.number, measurements.c.digest).where(
            *of_source, measurements.c.sequence == sequence
        )
        newest = sa.select(sa.func.max(measurements.c.sequence)).where(*of_source)
        with self._database.write() as connection:
            last = _held(connection, twin_id, epoch)
            row = connection.execute(there).one_or_none()
            if row is not None:
                if row.digest != digest:
                    raise Conflict(f"sequence {sequence} of source {source!r} was stored with other content")
                return StoredMeasurements(row.number, repeated=True)
            highest = connection.scalar(newest)
            if highest is None:
                _check_sources(connection, twin_id)
            elif sequence < highest - SEQUENCES:
                raise Conflict(
                    f"sequence must not lie more than {SEQUENCES} below the highest of source {source!r}, {highest}; "
                    f"given {sequence}"
                )
            number = last + 1
            connection.execute(twins.update().where(twins.c.id == twin_id).values(measured=number))
            connection.execute(
                measurements.insert(),
                {
                    "twin_id": twin_id, "source": source, "sequence": sequence, "number": number, "digest": digest,
                    "samples": samples, "stored": time.time(), "payload": payload,
                },
            )  # fmt: skip
        return StoredMeasurements(number, repeated=False)

    def after(self, twin_id: str, number: int, limit: int) -> list[tuple[int, bytes]]:
        """(number, payload) of at most `limit` stored behind a number, in order; none that a checkpoint took in."""
        query = (
            sa.select(measurements.c.number, measurements.c.payload)
            .where(
                measurements.c.twin_id == twin_id, measurements.c.number > number, measurements.c.payload.is_not(None)
            )
            .order_by(measurements.c.number)
            .limit(limit)
        )
        with self._database.read() as connection:
            return [(row.number, row.payload) for row in connection.execute(query)]

    def newest(self, twin_id: str) -> dict[str, int]:
        """Highest sequence of each source of a twin."""
        with self._database.read() as connection:
            return {row.source: row.sequence for row in connection.execute(_highest(twin_id))}


def _highest(twin_id: str) -> sa.Select[str, int]:
    log = measurements.c
    highest = sa.func.max(log.sequence).label("sequence")
    return sa.select(log.source, highest).where(log.twin_id == twin_id).group_by(log.source)


def _held(connection: sa.Connection, twin_id: str, epoch: int) -> int:
    """The number of a twin's last measurements, its row being held until the transaction ends."""
    held = (
        twins.update()
        .where(twins.c.id == twin_id, twins.c.epoch == epoch)
        .values(measured=twins.c.measured)
        .returning(twins.c.measured)
    )
    last: int | None = connection.execute(held).scalar_one_or_none()
    if last is None:
        raise Superseded
    return last


def _check_sources(connection: sa.Connection, twin_id: str) -> None:
    sources = sa.select(sa.func.count(sa.distinct(measurements.c.source))).where(measurements.c.twin_id == twin_id)
    if (connection.scalar(sources) or 0) >= SOURCES_MAX:
        raise Conflict(f"a twin must not have more than {SOURCES_MAX} sources")


def take_in(connection: sa.Connection, twin_id: str, number: int) -> None:
    """Forget payloads up to a number, which a checkpoint holds, and what lies too far back to be repeated."""
    log = measurements.c
    connection.execute(
        measurements.update()
        .where(log.twin_id == twin_id, log.number <= number, log.payload.is_not(None))
        .values(payload=None)
    )
    for source, sequence in connection.execute(_highest(twin_id)).all():
        connection.execute(
            measurements.delete().where(
                log.twin_id == twin_id, log.source == source, log.sequence < sequence - SEQUENCES,
                log.number <= number,
            )
        )  # fmt: skip
