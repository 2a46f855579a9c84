"""What is done to a running service. Each fault is injected, held for a while, and healed; then comes the next.

A plan is drawn from a seed alone: the same seed gives the same faults in the same order.
"""

from __future__ import annotations

import random
import signal
import sqlite3
from collections.abc import Callable, Collection, Iterator
from contextlib import AbstractContextManager, closing, contextmanager
from dataclasses import dataclass

from tests.nemesis.arena import LEASE_S, POSTGRESQL, SQLITE, Arena
from tests.nemesis.postgres import signalled

STOP, GO, KILL = signal.SIGSTOP, signal.SIGCONT, signal.SIGKILL

Injection = Callable[[Arena, float], AbstractContextManager[None]]
"""Injects a fault on entry and heals it on exit; the number in [0, 1) chooses where there is a choice."""


@contextmanager
def kill_server(arena: Arena, _: float) -> Iterator[None]:
    """Kill -9 the server; its workers find out by themselves."""
    arena.service.kill()
    yield
    arena.start()


@contextmanager
def kill_everything(arena: Arena, _: float) -> Iterator[None]:
    """Kill -9 server and workers at one moment, as a power cut does."""
    arena.kill_all()
    yield
    arena.start()


@contextmanager
def stop_server(arena: Arena, _: float) -> Iterator[None]:
    """Ask the server to end, as an upgrade does."""
    arena.stop_service()
    yield
    arena.start()


@contextmanager
def kill_worker(arena: Arena, choice: float) -> Iterator[None]:
    """Kill -9 one worker; the server replaces it."""
    signalled(_one(arena.workers(), choice), KILL)
    yield


@contextmanager
def kill_forkserver(arena: Arena, _: float) -> Iterator[None]:
    """Kill -9 the process that makes workers."""
    parent = arena.forkserver()
    signalled([] if parent is None else [parent], KILL)
    yield


@contextmanager
def _frozen(processes: list[int]) -> Iterator[None]:
    signalled(processes, STOP)
    try:
        yield
    finally:
        signalled(processes, GO)


def freeze_server(arena: Arena, _: float) -> AbstractContextManager[None]:
    """Stop the server where it stands, workers going on."""
    return _frozen([arena.service.process.pid])


def freeze_worker(arena: Arena, choice: float) -> AbstractContextManager[None]:
    """Stop one worker where it stands, past its lease."""
    return _frozen(_one(arena.workers(), choice))


def freeze_workers(arena: Arena, _: float) -> AbstractContextManager[None]:
    """Stop every worker where it stands, past their leases."""
    return _frozen(arena.workers())


def freeze_listener(arena: Arena, _: float) -> AbstractContextManager[None]:
    """Stop the subscriber: it misses samples."""
    return _frozen([arena.listener.process.pid])


@contextmanager
def restart_router(arena: Arena, _: float) -> Iterator[None]:
    """Kill -9 the router between the service and its subscribers."""
    arena.router.kill()
    yield
    arena.router.start()


@contextmanager
def _full(arena: Arena, fill: Callable[[int], None], choice: float) -> Iterator[None]:
    fill(arena.room(choice))
    try:
        yield
    finally:
        arena.limit_files(-1)


def fill_store(arena: Arena, choice: float) -> AbstractContextManager[None]:
    """Let no file of the store grow, from the middle of whatever comes soon."""
    return _full(arena, arena.limit_files, choice)


def start_on_a_full_store(arena: Arena, choice: float) -> AbstractContextManager[None]:
    """Kill -9 server and workers, and start them while the store is full."""
    arena.kill_all()
    return _full(arena, arena.start, choice)


@contextmanager
def restart_postgres(arena: Arena, choice: float) -> Iterator[None]:
    """Stop PostgreSQL, by its `fast` mode or as a crash, and start it again."""
    arena.postgres.stop("fast" if choice < 0.5 else "immediate")
    yield
    arena.postgres.start()


def freeze_postgres(arena: Arena, _: float) -> AbstractContextManager[None]:
    """Stop every process of PostgreSQL where it stands: its sockets stay open."""
    return arena.postgres.frozen()


@contextmanager
def lock_sqlite(arena: Arena, _: float) -> Iterator[None]:
    """Hold the lock of the file's one writer, as another process may."""
    with closing(sqlite3.connect(arena.folder / "hrs.db", timeout=60, isolation_level=None)) as holder:
        holder.execute("BEGIN IMMEDIATE")
        yield
        holder.execute("ROLLBACK")


@contextmanager
def start_without_postgres(arena: Arena, _: float) -> Iterator[None]:
    """Crash PostgreSQL and kill -9 the service, which cannot start before the database is back."""
    arena.postgres.stop("immediate")
    arena.kill_all()
    assert not arena.started()
    yield
    arena.postgres.start()
    arena.start()


def _one(processes: list[int], choice: float) -> list[int]:
    return processes[int(choice * len(processes)) :][:1]


EVERYWHERE: dict[str, Injection] = {
    fault.__name__.replace("_", "-"): fault
    for fault in (
        kill_server, kill_everything, stop_server, kill_worker, kill_forkserver, freeze_server, freeze_worker,
        freeze_workers, freeze_listener, restart_router, fill_store, start_on_a_full_store,
    )
}  # fmt: skip

ON_POSTGRESQL: dict[str, Injection] = {
    "restart-postgres": restart_postgres, "start-without-postgres": start_without_postgres,
    "freeze-postgres": freeze_postgres,
}  # fmt: skip

ON_SQLITE: dict[str, Injection] = {"lock-sqlite": lock_sqlite}

KINDS = {SQLITE: EVERYWHERE | ON_SQLITE, POSTGRESQL: EVERYWHERE | ON_POSTGRESQL}


@dataclass(frozen=True)
class Fault:
    """One fault of a plan."""

    kind: str
    choice: float  # in [0, 1)
    held_s: float  # from injection to healing [s]
    pause_s: float  # from healing to the next one [s]


def plan(store: str, count: int, seed: int, without: Collection[str] = ()) -> list[Fault]:
    """As many faults, every kind as often as the others, in an order drawn from the seed and the kinds there are."""
    chance = random.Random(f"{store}/{seed}")
    known = [kind for kind in KINDS[store] if kind not in without]
    kinds: list[str] = []
    while len(kinds) < count:
        kinds += chance.sample(known, len(known))
    return [
        Fault(kind, chance.random(), chance.uniform(1.2, 2.5) * LEASE_S, chance.uniform(0.0, 1.0))
        for kind in kinds[:count]
    ]
