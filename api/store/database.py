"""The database: SQLite or PostgreSQL behind one engine, its migrations and its transactions."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import sqlalchemy as sa
from sqlalchemy.exc import DataError, DBAPIError, IntegrityError, NotSupportedError, ProgrammingError, SQLAlchemyError
from sqlalchemy.exc import TimeoutError as PoolError

from api.store import tables
from station import InputError, StationError

BUSY_S = 30.0
"""How long a SQLite writer waits for another before it gives up [s]; a transaction takes milliseconds."""

SCRIPTS = Path(__file__).with_name("migrations")

_SCRIPT_LOCATION = str(SCRIPTS).replace("%", "%%")

_VERSION = sa.text("SELECT version_num FROM alembic_version")

_OF_THE_STATEMENT = (IntegrityError, NotSupportedError, ProgrammingError)
"""Errors a statement earns itself. All others are the database's: it is away, full or broken, and may be back later."""

_LOCK = 4_819_251
"""Advisory lock under which one of several PostgreSQL servers migrates."""


@contextmanager
def opened(url: str) -> Iterator[Database]:
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


class Database:
    """Connections to one database. `write()` gives a transaction that may change it, `read()` one that may not."""

    def __init__(self, url: str, *, pool: int = 5) -> None:
        self.url = sa.make_url(url)
        self.sqlite = self.url.get_backend_name() == "sqlite"
        if self.sqlite:
            Path(self.url.database or "").parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            # isolation_level None: sqlite3 must not begin transactions by itself.
            arguments = {"timeout": BUSY_S, "isolation_level": None}
            self.engine = sa.create_engine(self.url, pool_size=pool, max_overflow=40, connect_args=arguments)
            sa.event.listen(self.engine, "connect", _prepare_sqlite)
            sa.event.listen(self.engine, "begin", _begin_sqlite)
        else:
            self.engine = sa.create_engine(self.url, pool_size=pool, max_overflow=40, pool_pre_ping=True)
        self.on_error: Callable[[], None] = _nothing
        self._writing = self.engine.execution_options(hrs_writes=True)

    @contextmanager
    def write(self) -> Iterator[sa.Connection]:
        """A transaction that holds SQLite's one write lock from its start, so that it never has to begin anew."""
        with self._guarded(), self._writing.begin() as connection:
            yield connection

    @contextmanager
    def read(self) -> Iterator[sa.Connection]:
        """A transaction that sees one state of the database."""
        with self._guarded(), self.engine.begin() as connection:
            yield connection

    @contextmanager
    def _guarded(self) -> Iterator[None]:
        try:
            yield
        except DataError as error:  # PostgreSQL holds no NUL in a text, SQLite does
            raise InputError("request", [("", f"is nothing that the database holds: {first_line(error)}")]) from error
        except _OF_THE_STATEMENT:
            raise
        except (DBAPIError, PoolError) as error:
            self.on_error()
            raise StoreError(f"database {self.described}: {first_line(error)}") from error

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
        """
        from alembic.util import CommandError

        try:
            with self.write() as connection:
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
        with self.read() as connection:
            return "" if connection.execute(sa.text("SELECT 1")).scalar() == 1 else "gives a wrong answer"

    def outdated(self) -> bool:
        """Whether the tables are not this version's."""
        with self.read() as connection:
            return connection.execute(_VERSION).scalar() != newest_revision()

    @staticmethod
    def _revision(connection: sa.Connection) -> str | None:
        if not sa.inspect(connection).has_table("alembic_version"):
            return None
        return connection.execute(_VERSION).scalar()

    def close(self) -> None:
        """Give back every connection."""
        self.engine.dispose()

    def differences(self) -> list[Any]:
        """What the migrations and `tables` disagree on; empty when they tell the same story."""
        from alembic.autogenerate import compare_metadata
        from alembic.migration import MigrationContext

        with self.read() as connection:
            return list(compare_metadata(MigrationContext.configure(connection), tables.metadata))


def _begin_sqlite(connection: sa.Connection) -> None:
    writes = connection.get_execution_options().get("hrs_writes", False)
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")


def _prepare_sqlite(connection: Any, _record: Any) -> None:
    """Write-ahead log: readers and the writer do not wait for each other; NORMAL keeps commits over kill -9."""
    for pragma in (
        "journal_mode = WAL",
        "synchronous = NORMAL",
        "foreign_keys = ON",
        f"busy_timeout = {int(1000 * BUSY_S)}",
    ):
        connection.execute(f"PRAGMA {pragma}")


def first_line(error: BaseException) -> str:
    """What the database says, without the statement it says it of."""
    return str(getattr(error, "orig", error)).strip().partition("\n")[0]
