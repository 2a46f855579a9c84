"""API keys: only their digests are stored."""

from __future__ import annotations

import hashlib
import secrets
import time
from collections.abc import Sequence
from typing import Any

import sqlalchemy as sa
from sqlalchemy.exc import IntegrityError

from api.scopes import USUAL, Scope
from api.store.database import Database, StoreError
from api.store.records import Conflict, Key
from api.store.tables import keys

PREFIX = "hrs_"
"""Begins every key, so that one that leaks into a file is found by a search."""


SEEN_S = 600.0
"""A key stays valid so long without the store [s]."""


class KeyRepository:
    """The keys of a service that asks for keys."""

    def __init__(self, database: Database) -> None:
        self._database = database
        self._seen: dict[bytes, tuple[Key, float]] = {}  # valid keys by digest, and when they were [s, monotonic]

    def create(self, name: str, scopes: Sequence[Scope] = USUAL) -> str:
        """A new key: 256 random bits, told once. A plain digest is enough: nobody guesses so many bits."""
        key = PREFIX + secrets.token_urlsafe(32)
        try:
            with self._database.write() as connection:
                connection.execute(
                    keys.insert(),
                    {
                        "name": name, "digest": _digest(key), "created": time.time(),
                        "scopes": " ".join(scope for scope in Scope if scope in scopes),
                    },
                )  # fmt: skip
        except IntegrityError:
            raise Conflict(f"a key called {name!r} exists, or existed; take another name") from None
        return key

    def all(self) -> list[Key]:
        """Every key, the oldest first."""
        with self._database.read() as connection:
            return [_key(row) for row in connection.execute(_keys().order_by(keys.c.created, keys.c.name))]

    def revoke(self, name: str) -> bool:
        """Refuse this key from now on; False if there is none of that name, or it was revoked before."""
        held = keys.update().where(keys.c.name == name, keys.c.revoked.is_(None))
        self._seen.clear()
        with self._database.write() as connection:
            return connection.execute(held.values(revoked=time.time())).rowcount == 1

    def valid(self, key: str) -> Key | None:
        """The key, if it is valid.

        The store says so each time. While it does not answer, a key is taken that was valid up to `SEEN_S` ago: live
        twins can be looked at meanwhile, and whoever would revoke the key needs the store as well.
        """
        digest = _digest(key)
        query = _keys().where(keys.c.digest == digest, keys.c.revoked.is_(None))
        try:
            with self._database.read() as connection:
                row = connection.execute(query).one_or_none()
        except StoreError:
            held, seen = self._seen.get(digest, (None, 0.0))
            if held is None or time.monotonic() - seen > SEEN_S:
                raise
            return held
        if row is None:
            self._seen.pop(digest, None)
            return None
        found = _key(row)
        self._seen[digest] = found, time.monotonic()
        return found

    def any_valid(self) -> bool:
        """Whether anybody could use a service that asks for keys."""
        return any(key.revoked is None for key in self.all())


def _keys() -> sa.Select[Any]:
    return sa.select(keys.c.name, keys.c.created, keys.c.revoked, keys.c.scopes, keys.c.digest)


def _key(row: Any) -> Key:
    return Key(row.name, row.created, row.revoked, tuple(Scope(name) for name in row.scopes.split()), row.digest)


def _digest(key: str) -> bytes:
    return hashlib.sha256(key.encode()).digest()
