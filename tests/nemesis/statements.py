"""Faults between the store and its database: at a statement or a commit, before it or when it has taken effect."""

from __future__ import annotations

import ast
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import sqlalchemy as sa

from api.store.database import Database, open_database
from api.store.tables import metadata

CRASHED = 97
"""Status of a process that ended as if it had been killed."""

COMMIT = "COMMIT"

PATIENCE_S = 60.0
"""A process that was to crash, and has not by then, hangs [s]."""

_EXECUTE = ("do_execute", "do_executemany", "do_execute_no_params")


@dataclass(frozen=True)
class Fault:
    """What goes wrong at one step (a statement or a commit) of an operation.

    `error`: the database refuses. `lost`: the connection is gone. `crash`: the process is.
    """

    place: int
    after: bool  # the step has taken effect
    kind: str

    def __str__(self) -> str:
        return f"{self.kind} {'after' if self.after else 'before'} step {self.place}"


class Statements:
    """Notes every step of a database's transactions, and lets one go wrong."""

    def __init__(self, database: Database, fault: Fault | None = None) -> None:
        self.steps: list[str] = []
        self._database = database
        self._fault = fault
        self._dialect = database.engine.dialect
        self._error = self._dialect.loaded_dbapi.OperationalError

    @contextmanager
    def watched(self) -> Iterator[Statements]:
        """While the block runs, every step passes here."""
        genuine = {name: getattr(self._dialect, name) for name in (*_EXECUTE, "do_commit")}

        def execute(name: str) -> Callable[..., Any]:
            def through(cursor: Any, statement: str, *more: Any) -> Any:
                return self._step(statement, cursor.connection, lambda: genuine[name](cursor, statement, *more))

            return through

        for name in _EXECUTE:
            setattr(self._dialect, name, execute(name))
        self._dialect.do_commit = lambda held: self._step(
            COMMIT, getattr(held, "dbapi_connection", held), lambda: genuine["do_commit"](held)
        )
        try:
            yield self
        finally:
            for name, before in genuine.items():
                setattr(self._dialect, name, before)

    def _step(self, statement: str, connection: Any, go: Callable[[], Any]) -> Any:
        place = len(self.steps)
        self.steps.append(statement)
        fault = self._fault
        if fault is None or fault.place != place:
            return go()
        if not fault.after:
            self._fail(fault, connection)
            return go()  # which fails by itself where the connection is lost
        done = go()
        self._fail(fault, connection)
        if fault.kind == "lost" and statement == COMMIT:  # done, but nobody is told
            raise self._error("server closed the connection unexpectedly")
        return done

    def _fail(self, fault: Fault, connection: Any) -> None:
        if fault.kind == "crash":
            os._exit(CRASHED)
        if fault.kind == "error":
            raise self._error("disk I/O error")
        _terminate(self._database, connection.info.backend_pid)


def _terminate(database: Database, backend: int) -> None:
    """Let PostgreSQL end a connection; returns when it is gone."""
    engine = sa.create_engine(database.url, isolation_level="AUTOCOMMIT", poolclass=sa.NullPool)
    with engine.connect() as other:
        other.execute(sa.text("SELECT pg_terminate_backend(:pid, 10000)"), {"pid": backend})


def steps_of(database: Database, act: Callable[[], Any]) -> tuple[list[str], Any]:
    """The steps of an operation that nothing disturbs, and what it returns."""
    with Statements(database).watched() as seen:
        result = act()
    return seen.steps, result


def decided(steps: list[str]) -> int:
    """The commit that makes an operation's writing last: the first behind its first writing statement."""
    reading = ("SELECT", "BEGIN", "PRAGMA", COMMIT)
    writing = next(place for place, step in enumerate(steps) if not step.lstrip().upper().startswith(reading))
    return steps.index(COMMIT, writing)


def contents(url: str) -> dict[str, list[str]]:
    """All that a database holds, seen by somebody else: rows by table."""
    engine = sa.create_engine(Database(url).url, poolclass=sa.NullPool)
    with engine.connect() as connection:
        names = sa.inspect(connection).get_table_names()
        rows = {name: connection.execute(sa.select(sa.text("*")).select_from(sa.table(name))) for name in names}
        return {name: sorted(map(repr, found)) for name, found in rows.items()}


def crashes(context: Callable[..., None], *arguments: Any) -> bool:
    """Whether a function, in a process of its own, ends as if it had been killed."""
    forks = get_context("forkserver")
    forks.set_forkserver_preload([context.__module__])  # whose import takes seconds
    process = forks.Process(target=context, args=arguments)
    process.start()
    process.join(PATIENCE_S)
    if process.is_alive():
        process.kill()
        process.join()
    return process.exitcode == CRASHED


class Copies:
    """A prepared database, again and again: SQLite's file is copied, PostgreSQL's tables are filled anew.

    `prepare` must put the same into it each time.
    """

    def __init__(self, url: str, folder: Path, prepare: Callable[[Database], Any]) -> None:
        self._url = url
        self._folder = folder
        self._prepare = prepare
        with open_database(url) as database:
            database.migrate()
            self.sqlite = database.sqlite
            self._file = database.url.database
            self.prepared = prepare(database)

    @contextmanager
    def another(self) -> Iterator[str]:
        """URL of one."""
        if not self.sqlite:
            with open_database(self._url) as database:
                _empty(database)
                self._prepare(database)
            yield self._url
            return
        copy = self._folder / "copy.db"
        shutil.copy(str(self._file), copy)
        yield f"sqlite:///{copy}"
        for file in self._folder.glob("copy.db*"):
            file.unlink()


def _empty(database: Database) -> None:
    """This version's tables, without a row."""
    if len(sa.inspect(database.engine).get_table_names()) != len(metadata.tables) + 1:
        with database.engine.begin() as connection:
            connection.execute(sa.text("DROP SCHEMA public CASCADE"))
            connection.execute(sa.text("CREATE SCHEMA public"))
        database.migrate()
        return
    with database.engine.begin() as connection:
        connection.execute(sa.text(f"TRUNCATE {', '.join(metadata.tables)}"))


def writers(folder: Path) -> set[str]:
    """Names of all functions below a folder that begin a transaction which may write: `Class.method` or `function`."""
    found = set()
    for path in folder.rglob("*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        inside = {
            id(part): each.name for each in ast.walk(tree) if isinstance(each, ast.ClassDef) for part in each.body
        }
        for function in (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)):
            if any(_writes(node) for node in ast.walk(function)):
                owner = inside.get(id(function))
                found.add(f"{owner}.{function.name}" if owner else function.name)
    return found


def _writes(node: ast.AST) -> bool:
    """Whether a node is `....write()` of a database, or goes around it by `....engine.begin()` and the like."""
    if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)):
        return False
    if node.func.attr == "write":
        return not node.args and not node.keywords
    owner = node.func.value
    around = isinstance(owner, ast.Attribute) and owner.attr in {"engine", "_writing", "_engine"}
    return around and node.func.attr in {"begin", "connect", "raw_connection"}
