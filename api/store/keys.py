"""API keys: only their digests are stored."""

from __future__ import annotations

import hashlib
import secrets
import time

import sqlalchemy as sa
from sqlalchemy.exc import IntegrityError

from api.store.database import Database
from api.store.records import Conflict, Key
from api.store.tables import keys

PREFIX = "hrs_"
"""Begins every key, so that one that leaks into a file is found by a search."""


class KeyRepository:
    """Who may use a service that asks for keys."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def create(self, name: str) -> str:
        """A new key: 256 random bits, told once. A plain digest is enough: nobody guesses so many bits."""
        key = PREFIX + secrets.token_urlsafe(32)
        try:
            with self._database.write() as connection:
                connection.execute(keys.insert(), {"name": name, "digest": _digest(key), "created": time.time()})
        except IntegrityError:
            raise Conflict(f"a key called {name!r} exists, or existed; take another name") from None
        return key

    def all(self) -> list[Key]:
        """Every key, the oldest first."""
        query = sa.select(keys.c.name, keys.c.created, keys.c.revoked).order_by(keys.c.created)
        with self._database.read() as connection:
            return [Key(*row) for row in connection.execute(query)]

    def revoke(self, name: str) -> bool:
        """Refuse this key from now on; False if there is none of that name, or it was revoked before."""
        held = keys.update().where(keys.c.name == name, keys.c.revoked.is_(None))
        with self._database.write() as connection:
            return connection.execute(held.values(revoked=time.time())).rowcount == 1

    def owner(self, key: str) -> str | None:
        """Name of a key that is valid, else None."""
        query = sa.select(keys.c.name).where(keys.c.digest == _digest(key), keys.c.revoked.is_(None))
        with self._database.read() as connection:
            return connection.scalar(query)

    def any_valid(self) -> bool:
        """Whether anybody could use a service that asks for keys."""
        return any(key.revoked is None for key in self.all())


def _digest(key: str) -> bytes:
    return hashlib.sha256(key.encode()).digest()
