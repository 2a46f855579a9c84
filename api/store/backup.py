"""Backup and restore: the whole database in one file that either database can be restored from.

The file is a line of text, `hrs-backup 1 sha256 DIGEST`, and a gzip of JSON lines: what it holds, with the version of
the tables and how many rows each has; then for each table its name and columns, and its rows. The digest is of all
behind the first line.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
import os
import sqlite3
import tempfile
import time
import zlib
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any

import sqlalchemy as sa
from sqlalchemy.exc import SQLAlchemyError

from api.files import check_writable
from api.moments import written
from api.store.database import Database, StoreError, first_line
from api.store.patience import LONG_S, patient
from api.store.tables import metadata
from station import InputError, StationError

Progress = Callable[[int, int], None]
"""Told how many of how many rows are done."""

_MAGIC = b"hrs-backup 1 sha256 "

_HEAD = len(_MAGIC) + 64 + 1

_PIECE = 1 << 20

_ROWS = 50
"""Rows in memory at once: a series may be megabytes."""


# Backup.


def backup(database: Database, file: Path, progress: Progress) -> dict[str, int]:
    """Write all that a database holds at one moment, while others use it; how many rows each table has.

    Raises
    ------
    InputError
        if the file cannot be written, or there is no database.
    StoreError
        if the database cannot be read, or has other tables than this version's.
    """
    check_writable(file)
    if not database.exists:
        raise InputError("backup", [("data", f"there is no database {database.described}")])
    if database.outdated():
        raise StoreError(f"database {database.described} has not this version's tables: start the service once")
    partial = file.with_name(file.name + ".partial")
    try:
        with _snapshot(database, file.parent) as connection:
            rows = _write(connection, partial, progress, "SQLite" if database.sqlite else "PostgreSQL")
        partial.replace(file)
    except OSError as error:
        raise InputError("backup", [(str(file), f"cannot be written: {error.strerror}")]) from None
    finally:
        partial.unlink(missing_ok=True)
    return rows


@contextmanager
def _snapshot(database: Database, folder: Path) -> Iterator[sa.Connection]:
    """One state of the database, to be read at leisure."""
    if not database.sqlite:
        with database.engine.connect().execution_options(isolation_level="REPEATABLE READ") as connection:
            yield connection
        return
    # A copy by SQLite's backup API: a reader that stayed would keep the write-ahead log from being taken over.
    with tempfile.TemporaryDirectory(prefix=".hrs-backup-", dir=folder) as place:
        copy = Path(place) / "copy.db"
        with closing(sqlite3.connect(str(database.url.database))) as source, closing(sqlite3.connect(copy)) as target:
            source.backup(target)
        engine = sa.create_engine(f"sqlite:///{copy}")
        try:
            with engine.connect() as connection:
                yield connection
        finally:
            engine.dispose()


def _write(connection: sa.Connection, partial: Path, progress: Progress, kind: str) -> dict[str, int]:
    names = [table.name for table in metadata.sorted_tables]
    count = {name: connection.scalar(sa.text(f"SELECT count(*) FROM {name}")) or 0 for name in names}  # noqa: S608  # ours
    about = {
        "schema": connection.scalar(sa.text("SELECT version_num FROM alembic_version")), "hrs": version("hrs-twin"),
        "created": written(time.time(), "seconds"), "database": kind, "rows": count,
    }  # fmt: skip
    done, total = 0, sum(count.values())
    with os.fdopen(os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "wb") as raw:
        raw.write(bytes(_HEAD))
        with gzip.GzipFile(fileobj=raw, mode="wb", compresslevel=1, mtime=0) as out:
            out.write(_line(about))
            for table in metadata.sorted_tables:
                out.write(_line({"table": table.name, "columns": [column.name for column in table.c]}))
                query = sa.select(table).order_by(*table.primary_key).execution_options(yield_per=_ROWS)
                with connection.execute(query) as rows:
                    for row in rows:
                        out.write(_line([_plain(value) for value in row]))
                        done += 1
                        progress(done, total)
        raw.flush()
        digest = _digest(partial)
        raw.seek(0)
        raw.write(_MAGIC + digest + b"\n")
        raw.flush()
        os.fsync(raw.fileno())
    return count


def _line(document: Any) -> bytes:
    return json.dumps(document, separators=(",", ":")).encode() + b"\n"


def _plain(value: Any) -> Any:
    """As JSON carries it; bytes are told from JSON columns by their wrapping."""
    if isinstance(value, bytes):
        return {"base64": base64.b64encode(value).decode()}
    return {"json": value} if isinstance(value, dict | list) else value


def _digest(file: Path) -> bytes:
    found = hashlib.sha256()
    with file.open("rb") as stream:
        stream.seek(_HEAD)
        while piece := stream.read(_PIECE):
            found.update(piece)
    return found.hexdigest().encode()


# Restore.


def restore(database: Database, file: Path, progress: Progress, *, replace: bool) -> dict[str, int]:
    """Fill a database from a backup, in one transaction; how many rows each table has.

    Twins get a later epoch than they had in either, so that a server that still runs one of them writes no more.

    Raises
    ------
    InputError
        if the file is no backup, damaged, or of a newer version; the database is not empty and `replace` not said; or
        its folder cannot be made.
    StoreError
        if the database cannot be written.
    """
    _check(file)
    database.make_folder()
    try:
        with patient(LONG_S):
            return _restored(database, file, progress, replace=replace)
    except SQLAlchemyError as error:
        raise StoreError(f"database {database.described}: {first_line(error)}") from error


def _restored(database: Database, file: Path, progress: Progress, *, replace: bool) -> dict[str, int]:
    with _lines(file) as lines:
        about = next(lines)
        if about["schema"] not in database.known_revisions():
            raise _refused(file, f"was written by a newer version of hrs ({about['hrs']}); install that one")
        with database.write() as connection:
            found = set(sa.inspect(connection).get_table_names())
            epochs = _epochs(connection) if "twins" in found else {}
            if any(_any_row(connection, name) for name in sorted(found - {"alembic_version"})) and not replace:
                message = f"{database.described} is not empty; --replace forgets all that is in it"
                raise InputError("restore", [("database", message)])
            _drop(connection)
            database.migrate_to(connection, about["schema"])
            rows = _fill(connection, lines, about["rows"], progress)
            for twin, epoch in epochs.items():
                later = sa.text("UPDATE twins SET epoch = :epoch WHERE id = :twin AND epoch <= :epoch")
                connection.execute(later, {"twin": twin, "epoch": epoch + 1})
            connection.execute(sa.text("UPDATE chunks SET owner = NULL, lease_until = 0"))
            database.migrate_to(connection, "head")
    return rows


def _check(file: Path) -> None:
    """Raise InputError unless the file is whole."""
    try:
        with file.open("rb") as stream:
            head = stream.read(_HEAD)
        if not head.startswith(_MAGIC[:11]):
            raise _refused(file, "is no backup of hrs")
        if not head.startswith(_MAGIC):
            raise _refused(file, "is a backup of another form, which this version does not read")
        if head[len(_MAGIC) :] != _digest(file) + b"\n":
            raise _refused(file, "is damaged: its checksum is another")
    except OSError as error:
        raise _refused(file, f"cannot be read: {error.strerror}") from None


@contextmanager
def _lines(file: Path) -> Iterator[Iterator[Any]]:
    with file.open("rb") as raw:
        raw.seek(_HEAD)
        with gzip.GzipFile(fileobj=raw, mode="rb") as stream:
            try:
                yield map(json.loads, stream)
            except StationError:
                raise
            except (ValueError, EOFError, gzip.BadGzipFile, zlib.error, StopIteration, KeyError) as error:
                raise _refused(file, f"cannot be read: {error!r}") from error


def _refused(file: Path, why: str) -> InputError:
    return InputError("restore", [(str(file), why)])


def _any_row(connection: sa.Connection, name: str) -> bool:
    quoted = connection.dialect.identifier_preparer.quote(name)
    return connection.execute(sa.text(f"SELECT 1 FROM {quoted} LIMIT 1")).first() is not None  # noqa: S608  # quoted


def _epochs(connection: sa.Connection) -> dict[str, int]:
    return {row[0]: row[1] for row in connection.execute(sa.text("SELECT id, epoch FROM twins"))}


def _drop(connection: sa.Connection) -> None:
    """Every table of ours, whatever their version."""
    there = sa.MetaData()
    ours = [*metadata.tables, "alembic_version"]
    there.reflect(connection, only=lambda name, _: name in ours)
    there.drop_all(connection)


def _fill(connection: sa.Connection, lines: Iterator[Any], rows: dict[str, int], progress: Progress) -> dict[str, int]:
    """Insert what the lines hold; the tables are those of the backup's version, so they are asked for their types."""
    there = sa.MetaData()
    there.reflect(connection)
    for column in (column for found in there.tables.values() for column in found.c):
        if isinstance(column.type, sa.JSON):
            column.type.none_as_null = True  # as in `tables`
    count: dict[str, int] = {}
    table, done = "", 0
    columns: list[str] = []
    waiting: list[dict[str, Any]] = []

    def flush() -> None:
        if waiting:
            connection.execute(there.tables[table].insert(), waiting)
            waiting.clear()

    for line in lines:
        if isinstance(line, list):
            waiting.append(dict(zip(columns, map(_value, line), strict=True)))
            count[table] += 1
            done += 1
            progress(done, sum(rows.values()))
            if len(waiting) >= _ROWS:
                flush()
            continue
        flush()
        table, columns = line["table"], line["columns"]
        count[table] = 0
    flush()
    if count != rows:
        raise ValueError("rows are missing")
    return count


def _value(given: Any) -> Any:
    if isinstance(given, dict):
        return base64.b64decode(given["base64"]) if "base64" in given else given["json"]
    return given
