"""Answers kept under idempotency keys; a row is written in the transaction of what it answers for."""

from __future__ import annotations

import time
from collections.abc import Sequence

import sqlalchemy as sa
from sqlalchemy.dialects.postgresql import insert as postgresql_insert
from sqlalchemy.dialects.sqlite import insert as sqlite_insert
from sqlalchemy.exc import IntegrityError

from api.store.database import Database
from api.store.records import KeyTaken, StoredResponse
from api.store.tables import idempotency_keys

_FIELDS = [idempotency_keys.c[name] for name in StoredResponse.__slots__]


class IdempotencyRepository:
    """Answers that have been given, by who asked and under which key."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def get(self, owner: str, key: str, after: float) -> StoredResponse | None:
        """The answer kept under a key behind this Unix time [s]."""
        query = sa.select(*_FIELDS).where(*_same(owner, key), idempotency_keys.c.created >= after)
        with self._database.read() as connection:
            row = connection.execute(query).one_or_none()
        return None if row is None else StoredResponse(*row)

    def count(self) -> int:
        """How many there are."""
        with self._database.read() as connection:
            return connection.scalar(sa.select(sa.func.count()).select_from(idempotency_keys)) or 0

    def prune(self, before: float) -> int:
        """Forget what was kept before this Unix time [s]."""
        with self._database.write() as connection:
            return connection.execute(idempotency_keys.delete().where(idempotency_keys.c.created < before)).rowcount


def keep(connection: sa.Connection, answer: StoredResponse, retention_s: float) -> None:
    """Keep an answer in the transaction of what it answers for.

    Raises
    ------
    KeyTaken
        if another server has used the key meanwhile; the transaction must be rolled back.
    """
    expired = idempotency_keys.c.created < time.time() - retention_s
    connection.execute(idempotency_keys.delete().where(*_same(answer.owner, answer.key), expired))
    try:
        connection.execute(idempotency_keys.insert(), _row(answer))
    except IntegrityError:
        raise KeyTaken from None


def keep_beside(connection: sa.Connection, answers: Sequence[StoredResponse]) -> None:
    """Keep answers in a transaction that must not fail for them: an answer kept under the key before stays."""
    insert = sqlite_insert if connection.dialect.name == "sqlite" else postgresql_insert
    for answer in answers:
        connection.execute(insert(idempotency_keys).values(**_row(answer)).on_conflict_do_nothing())


def forget(connection: sa.Connection, answer: StoredResponse) -> None:
    """Take an answer back with what it answers for."""
    connection.execute(idempotency_keys.delete().where(*_same(answer.owner, answer.key)))


def _same(owner: str, key: str) -> tuple[sa.ColumnElement[bool], ...]:
    return idempotency_keys.c.owner == owner, idempotency_keys.c.key == key


def _row(answer: StoredResponse) -> dict[str, object]:
    return {name: getattr(answer, name) for name in StoredResponse.__slots__}
