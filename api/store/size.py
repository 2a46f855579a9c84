"""How much room the store takes and has, and when it takes no more work."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

import sqlalchemy as sa

from api.looks import Look
from api.store.database import Database, StoreError
from api.store.patience import REQUEST_S, patient
from api.store.records import StoreFull

KEPT_S = 2.0
"""A size found so long ago still counts [s]: no second of work fills a store that has its reserve."""

PATIENCE_S = 0.5
"""A store that does not tell its size by then is not held against it [s]: it will not take the work either."""


@dataclass(frozen=True)
class Size:
    """The room that a store takes, and that is left."""

    used: int  # [bytes]; free pages of SQLite's file, which the next rows take, do not count
    disk_free: int | None  # [bytes]; None where the database is another machine's


class StoreRoom:
    """Says whether new work still fits: what was accepted is stored beyond the limit."""

    def __init__(self, database: Database, used_max: int | None, disk_free_min: int) -> None:
        self._database = database
        self.used_max = used_max
        self._disk_free_min = disk_free_min
        self._look: Look[Size | None] = Look(self._measured, "store-size", KEPT_S)

    def size(self) -> Size | None:
        """The size, some seconds old at most; None while the store does not tell it."""
        return self._look.found(PATIENCE_S)

    def check(self) -> None:
        """Raise StoreFull if new jobs and twins would no longer fit."""
        why = self.full()
        if why:
            raise StoreFull(why)

    def full(self) -> str:
        """Why new work does not fit; empty if it does."""
        size = self.size()
        if size is None:
            return ""
        if self.used_max is not None and size.used >= self.used_max:
            return f"the store takes {size.used} bytes; the limit is store_bytes_max = {self.used_max}"
        if size.disk_free is not None and size.disk_free < self._disk_free_min:
            return f"its disk has {size.disk_free} bytes left; the least is disk_free_min_bytes = {self._disk_free_min}"
        return ""

    def _measured(self) -> Size | None:
        try:
            with patient(REQUEST_S):
                return measure(self._database)
        except (StoreError, OSError):  # its file, or the log beside it, may go at any time
            return None


def measure(database: Database) -> Size:
    """The size of a database, in a millisecond."""
    if not database.sqlite:
        with database.read() as connection:
            return Size(int(connection.scalar(sa.text("SELECT pg_database_size(current_database())")) or 0), None)
    file = Path(database.url.database or "")
    with database.read() as connection:
        pages, free, page = (
            int(connection.exec_driver_sql(f"PRAGMA {name}").scalar() or 0)
            for name in ("page_count", "freelist_count", "page_size")
        )
    log = file.with_name(file.name + "-wal")
    logged = log.stat().st_size if log.exists() else 0
    return Size((pages - free) * page + logged, shutil.disk_usage(file.parent).free)
