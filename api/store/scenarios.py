"""Scenarios of users, by name."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import sqlalchemy as sa

from api.store.database import Database
from api.store.records import CapacityError, StoredScenario
from api.store.tables import scenarios

_ENTRY = [scenarios.c[name] for name in StoredScenario.__slots__]

Check = Callable[[StoredScenario | None], None]
"""Raises where what is stored now, None for nothing, must not be changed."""


class ScenarioRepository:
    """Scenarios that users have stored."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def all(self) -> list[StoredScenario]:
        """Every scenario, by name."""
        with self._database.read() as connection:
            found = connection.execute(sa.select(*_ENTRY).order_by(scenarios.c.name))
            return [StoredScenario(*row) for row in found]

    def get(self, name: str) -> tuple[StoredScenario, dict[str, Any]] | None:
        """A scenario and its document, or None."""
        query = sa.select(*_ENTRY, scenarios.c.document).where(scenarios.c.name == name)
        with self._database.read() as connection:
            row = connection.execute(query).one_or_none()
        return None if row is None else (StoredScenario(*row[:-1]), row.document)

    def put(self, wanted: StoredScenario, document: dict[str, Any], most: int, check: Check) -> bool:
        """Store a scenario under its name unless `check` raises; whether there was none. The same one is left alone.

        Raises
        ------
        Full
            if it would be one more than `most`.
        """
        with self._changing() as connection:
            held = _entry(connection, wanted.name)
            check(held)
            if held is None:
                count = connection.scalar(sa.select(sa.func.count()).select_from(scenarios)) or 0
                if count >= most:
                    raise CapacityError(f"{count} scenarios are stored; the limit is scenarios_max = {most}")
            elif held.digest == wanted.digest:
                return False
            values = {
                "about": wanted.about, "document": document, "digest": wanted.digest, "changed": wanted.changed,
            }  # fmt: skip
            if held is None:
                connection.execute(scenarios.insert(), {**values, "name": wanted.name, "created": time.time()})
            else:
                connection.execute(scenarios.update().where(scenarios.c.name == wanted.name).values(**values))
            return held is None

    def remove(self, name: str, check: Check) -> bool:
        """Forget a scenario unless `check` raises; False if there is none."""
        with self._changing() as connection:
            check(_entry(connection, name))
            return connection.execute(scenarios.delete().where(scenarios.c.name == name)).rowcount == 1

    @contextmanager
    def _changing(self) -> Iterator[sa.Connection]:
        """A transaction beside which no other changes a scenario: what was checked and counted still holds."""
        with self._database.write() as connection:
            if not self._database.sqlite:
                connection.execute(sa.text("LOCK TABLE scenarios IN SHARE ROW EXCLUSIVE MODE"))
            yield connection


def _entry(connection: sa.Connection, name: str) -> StoredScenario | None:
    row = connection.execute(sa.select(*_ENTRY).where(scenarios.c.name == name)).one_or_none()
    return None if row is None else StoredScenario(*row)
