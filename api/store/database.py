"""The database: SQLite or PostgreSQL behind one engine, its migrations and its transactions."""

from __future__ import annotations

import sqlite3
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import sqlalchemy as sa
from sqlalchemy.exc import DataError, DBAPIError, IntegrityError, NotSupportedError, ProgrammingError, SQLAlchemyError
from sqlalchemy.exc import TimeoutError as PoolError
from sqlalchemy.pool import NullPool

from api.store import sqlite, tables
from api.store.claim import Claim
from api.store.documents import read_json
from api.store.patience import LEAST_S, LONG_S, Breaker, Cap, Wait, current, patient, waiting
from station import InputError, StationError

POOL_EXTRA = 40
"""Connections beyond the pool's size: one for each thread that answers requests."""

_LOST = "its file has been moved or deleted"

SCRIPTS = Path(__file__).with_name("migrations")

_SCRIPT_LOCATION = str(SCRIPTS).replace("%", "%%")

_VERSION = sa.text("SELECT version_num FROM alembic_version")

_OF_THE_STATEMENT = (IntegrityError, NotSupportedError, ProgrammingError)
"""Errors a statement earns itself. All others are the database's: it is away, full or broken, and may be back later."""

_LOCK = 4_819_251
"""Advisory lock under which one of several PostgreSQL servers migrates."""


@contextmanager
def open_database(url: str) -> Iterator[Database]:
    """A database while the block runs."""
    database = Database(url)
    try:
        yield database
    finally:
        database.close()


def _nothing() -> None:
    """Nobody wants to know."""


@cache
def newest_revision() -> str | None:
    """Of the migrations of this version of hrs."""
    from alembic.script import ScriptDirectory

    return ScriptDirectory(str(SCRIPTS)).get_current_head()


class StoreError(StationError):
    """The database cannot be used; the message says why, without its password."""


class SilentStoreError(StoreError):
    """The database is known not to answer: it was not asked."""


class Database:
    """Connections to one database. `write()` gives a transaction that may change it, `read()` one that may not."""

    def __init__(self, url: str, *, pool: int = 5) -> None:
        self.url = sa.make_url(url)
        self.sqlite = self.url.get_backend_name() == "sqlite"
        self._claim: Claim | None = None
        self._writer = threading.Lock()
        self.engine = self._engine(pool_size=pool, max_overflow=POOL_EXTRA, pool_timeout=LEAST_S, pool_pre_ping=True)
        self.on_error: Callable[[], None] = _nothing
        self._writing = self.engine.execution_options(hrs_writes=True)
        self._cap = Cap()
        self._probing = self._engine(poolclass=NullPool)
        self._reads = Breaker(lambda: self._probe(writes=False))
        # A lock that keeps SQLite's writers out lets its readers in.
        self._writes = Breaker(lambda: self._probe(writes=True)) if self.sqlite else self._reads

    def _engine(self, **options: Any) -> sa.Engine:
        options["json_deserializer"] = read_json
        if self.sqlite:
            options.pop("pool_pre_ping", None)  # a file does not hang up
            # isolation_level None: sqlite3 must not begin transactions by itself.
            engine = sa.create_engine(self.url, connect_args={"isolation_level": None}, **options)
            sa.event.listen(engine, "connect", sqlite.prepare)
            sa.event.listen(engine, "begin", sqlite.begin)
        else:
            engine = sa.create_engine(self.url, **options)
            sa.event.listen(engine, "do_connect", _connect_postgresql)
        return engine

    def _probe(self, *, writes: bool) -> None:
        """Ask the database something over a connection of its own; raises while it does not answer."""
        held = waiting.set(Wait(self._cap))
        try:
            with self._probing.execution_options(hrs_writes=writes).begin() as connection:
                connection.execute(sa.text("SELECT 1"))
        finally:
            waiting.reset(held)

    @contextmanager
    def write(self) -> Iterator[sa.Connection]:
        """A transaction that holds SQLite's one write lock from its start, so that it never has to begin anew."""
        if self._claim is not None and self._claim.lost:
            raise StoreError(f"database {self.described}: {_LOST}")
        with self._guarded(self._writes), self._turn(), self._writing.begin() as connection:
            yield connection

    @contextmanager
    def _turn(self) -> Iterator[None]:
        """The one turn to write to SQLite that the threads of a process have.

        Threads that wait for the lock of the file instead look at it every now and then: most wait for too long, and
        under load some for ever.
        """
        if not self.sqlite:
            yield
            return
        wait = current()
        while not self._writer.acquire(timeout=sqlite.SLICE_S):
            if wait.over:
                raise sqlite3.OperationalError("database is locked")
        try:
            yield
        finally:
            self._writer.release()

    @contextmanager
    def read(self) -> Iterator[sa.Connection]:
        """A transaction that sees one state of the database."""
        with self._guarded(self._reads), self.engine.begin() as connection:
            yield connection

    @contextmanager
    def _guarded(self, breaker: Breaker) -> Iterator[None]:
        if breaker.open:
            self.on_error()
            raise SilentStoreError(f"database {self.described}: does not answer")
        held = waiting.set(Wait(self._cap, breaker))
        try:
            yield
        except DataError as error:  # PostgreSQL holds no NUL in a text, SQLite does
            raise InputError("request", [("", f"is nothing that the database holds: {first_line(error)}")]) from error
        except _OF_THE_STATEMENT:
            raise
        except (DBAPIError, PoolError, sqlite3.OperationalError) as error:
            self.on_error()
            raise StoreError(f"database {self.described}: {first_line(error)}") from error
        finally:
            waiting.reset(held)

    @property
    def silent(self) -> bool:
        """Whether the database does not answer at present, as far as is known."""
        return self._reads.open or self._writes.open

    def end_waiting(self, within_s: float) -> None:
        """Let every wait, also those to come, end within so many seconds: the service is closing."""
        self._cap.at = time.monotonic() + within_s

    @property
    def described(self) -> str:
        """The database's address without its password."""
        return self.url.render_as_string(hide_password=True)

    def migrate(self) -> None:
        """Bring the database to this version's tables.

        Raises
        ------
        StoreError
            if it cannot be reached, or a newer version has written it.
        InputError
            if its folder cannot be made.
        """
        from alembic.util import CommandError

        self.make_folder()
        self.check()  # a server that is frozen is found out before the long wait
        try:
            with patient(LONG_S), self.write() as connection:
                if not self.sqlite:
                    connection.execute(sa.text(f"SELECT pg_advisory_xact_lock({_LOCK})"))
                if self._revision(connection) == newest_revision():
                    return
                self.migrate_to(connection, "head")
        except CommandError as error:
            raise StoreError(f"database {self.described} was written by a newer version of hrs: {error}") from None
        except SQLAlchemyError as error:
            raise StoreError(f"database {self.described}: {first_line(error)}") from error

    @staticmethod
    def migrate_to(connection: sa.Connection, revision: str) -> None:
        """Bring the tables to a revision, in the transaction of this connection."""
        from alembic import command
        from alembic.config import Config

        config = Config()
        config.set_main_option("script_location", _SCRIPT_LOCATION)
        config.attributes["connection"] = connection
        command.upgrade(config, revision)

    @staticmethod
    def known_revisions() -> set[str]:
        """Every revision of the tables that this version can bring to its own."""
        from alembic.script import ScriptDirectory

        return {script.revision for script in ScriptDirectory(str(SCRIPTS)).walk_revisions()}

    def check(self) -> str:
        """Why the database does not answer; empty if it does. Raises StoreError where it says so itself."""
        if self._claim is not None and self._claim.lost:
            return _LOST
        with self.read() as connection:
            return "" if connection.execute(sa.text("SELECT 1")).scalar() == 1 else "gives a wrong answer"

    @property
    def exists(self) -> bool:
        """Whether there is anything to read: a SQLite file may not have been made yet."""
        return not self.sqlite or Path(self.url.database or "").exists()

    def claim(self, instance: str) -> None:
        """Keep other servers of this name off a SQLite file; again, it changes nothing.

        Raises
        ------
        InputError
            if another has it.
        """
        if self.sqlite:
            self._claim = self._claim or Claim(Path(self.url.database or ""), instance)
            self._claim.take()

    def make_folder(self) -> None:
        """Make the folder of a SQLite file.

        Raises
        ------
        InputError
            if it cannot be made.
        """
        if not self.sqlite:
            return
        folder = Path(self.url.database or "").parent
        try:
            folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        except OSError as error:
            raise InputError("settings", [("data", f"{folder} cannot be made a folder: {error.strerror}")]) from None

    def outdated(self) -> bool:
        """Whether the tables are not this version's."""
        with self.read() as connection:
            return connection.execute(_VERSION).scalar() != newest_revision()

    @staticmethod
    def _revision(connection: sa.Connection) -> str | None:
        if not sa.inspect(connection).has_table("alembic_version"):
            return None
        return connection.execute(_VERSION).scalar()

    def shrink(self) -> None:
        """Give the free pages of SQLite's file back to the disk; PostgreSQL's vacuum looks after its own."""
        free = 1
        while self.sqlite and free:
            with self.write() as connection:
                sqlite.shrink(connection)
                before, free = free, int(connection.exec_driver_sql("PRAGMA freelist_count").scalar() or 0)
            if free == before:  # a file of an older version gives nothing back
                return

    def close(self) -> None:
        """Give back every connection."""
        self._reads.close()
        self._writes.close()
        self.engine.dispose()
        if self._claim is not None:
            self._claim.release()

    def differences(self) -> list[Any]:
        """Differences between the migrations and `tables`; empty when there are none."""
        from alembic.autogenerate import compare_metadata
        from alembic.migration import MigrationContext

        with self.read() as connection:
            return list(compare_metadata(MigrationContext.configure(connection), tables.metadata))


def _connect_postgresql(_dialect: Any, _record: Any, arguments: list[Any], options: dict[str, Any]) -> Any:
    from api.store.postgresql import PatientConnection  # psycopg is needed by those alone who use it

    return PatientConnection.connect(*arguments, **options)


def first_line(error: BaseException) -> str:
    """The database's message, without the statement that it is about."""
    return str(getattr(error, "orig", error)).strip().partition("\n")[0]
