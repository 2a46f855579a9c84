"""Connections to SQLite that give up: another process may hold the file's lock for as long as it likes."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from typing import Any, TypeVar

import sqlalchemy as sa

from api.store.patience import current

SLICE_S = 0.1
"""SQLite itself waits so long for a lock; between its waits the caller looks at the clock [s]."""

LOG_BYTES = 8_000_000
"""Disk that the log keeps once all in it is in the file [bytes]; a burst may make it larger for a while."""

SHRINK_PAGES = 2000
"""Free pages given back to the disk in one transaction: some 8 MB."""

_BYTE = 0xFF
"""Extended codes of an error carry the plain one in their last byte."""

Answer = TypeVar("Answer")


def is_busy(error: BaseException | None) -> bool:
    """Whether an error says that another connection holds the lock."""
    return isinstance(error, sqlite3.OperationalError) and error.sqlite_errorcode & _BYTE == sqlite3.SQLITE_BUSY


def _persist(act: Callable[[], Answer]) -> Answer:
    """Do it again while the file is locked, as long as the caller may wait."""
    wait = current()
    while True:
        try:
            return act()
        except sqlite3.OperationalError as error:
            if not is_busy(error) or wait.over:
                raise


def prepare(connection: Any, _record: Any) -> None:
    """Write-ahead log: readers and the writer do not wait for each other; NORMAL keeps commits over kill -9."""

    def ask(pragma: str) -> Any:
        return _persist(lambda: connection.execute(f"PRAGMA {pragma}").fetchone())

    ask(f"busy_timeout = {int(1000 * SLICE_S)}")
    if ask("page_count")[0] == 0:  # a file with tables stays as it is, and setting it would wait for the writers' lock
        ask("auto_vacuum = INCREMENTAL")
    for pragma in (
        "journal_mode = WAL",
        f"journal_size_limit = {LOG_BYTES}",
        "synchronous = NORMAL",
        "foreign_keys = ON",
    ):
        ask(pragma)


def begin(connection: sa.Connection) -> None:
    """Begin a transaction with all the locks it will need, so that none of its statements waits for one."""
    writes = connection.get_execution_options().get("hrs_writes", False)
    plain: Any = connection.connection.driver_connection

    def start() -> None:
        if writes:
            plain.execute("BEGIN IMMEDIATE")
            return
        plain.execute("BEGIN")
        try:
            plain.execute("SELECT 1 FROM sqlite_schema LIMIT 1").fetchall()  # takes the lock of a reader
        except sqlite3.OperationalError:
            plain.execute("ROLLBACK")
            raise

    _persist(start)


def shrink(connection: sa.Connection) -> None:
    """Give `SHRINK_PAGES` free pages back to the disk."""
    plain: Any = connection.connection.driver_connection
    plain.execute(f"PRAGMA incremental_vacuum({SHRINK_PAGES})").fetchall()  # a step for each page
