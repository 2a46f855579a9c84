"""The pool of worker processes: starts them, wakes them, replaces those that die."""

from __future__ import annotations

import logging
import multiprocessing
import secrets
import select
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import forkserver
from multiprocessing.connection import Connection, wait
from multiprocessing.context import ForkServerProcess

from api.jobs.cores import cores
from api.jobs.work import JobTypes
from api.jobs.worker import work
from api.metrics import ServiceMetrics
from api.settings import Settings
from api.store.database import StoreError
from api.store.jobs import JobRepository
from controllers.registry import THESIS_CONTROLLERS, is_ready

log = logging.getLogger(__name__)

SHORT_LIFE_S = 1.0
"""A worker that dies sooner is replaced only after this long, so that a broken one does not eat a core [s]."""

GROUP = "api.jobs.group"
"""The fork server imports this first."""

PRELOAD = ("api.jobs.worker", "controllers.logic", "controllers.minlp.controller", "pyarrow.parquet")
"""Imported once, by the fork server, for every worker; so are the modules of the types of jobs."""

COMPILED_S = 0.2
"""How often to look whether these are compiled [s]."""


@dataclass
class _Member:
    owner: str
    process: ForkServerProcess
    link: Connection  # wakes it, and brings what it tells
    started: float


class WorkerPool:
    """Worker processes under a thread that replaces the dead and gives back what they held.

    forkserver: a worker is a copy of a small process without threads or sessions, never of the server itself.
    """

    def __init__(
        self, settings: Settings, repository: JobRepository, types: JobTypes, metrics: ServiceMetrics | None = None
    ) -> None:  # fmt: skip
        self._metrics = metrics or ServiceMetrics()
        self._settings = settings
        self._repository = repository
        self._types = types
        self._context = multiprocessing.get_context("forkserver")
        modules = {function.__module__ for each in types.values() for function in (each.task, each.compute)}
        self._context.set_forkserver_preload([GROUP, *PRELOAD, *sorted(modules)])
        self._members: list[_Member] = []
        self._stop_reader, self._stop_writer = multiprocessing.Pipe(duplex=False)
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._supervise, name="jobs", daemon=True)
        if self.wanted and _compiled():
            forkserver.ensure_running()  # it imports for a second or two while the service does other things

    def start(self) -> None:
        """Start the workers; what a server of this name held before is given back first."""
        self._release(f"{self._settings.instance}/*")
        self._thread.start()

    def _release(self, owner: str) -> None:
        try:
            self._repository.release(owner)
        except StoreError as error:
            log.warning("%s; the leases of %s end by themselves", error, owner)

    def wake(self) -> None:
        """Tell the workers that there is work."""
        with self._lock:
            for member in self._members:
                _nudge(member.link)

    def _spawn(self) -> _Member | None:
        """A new worker; None if the pool closes before there is one."""
        while not self._stop_reader.poll():
            owner = f"{self._settings.instance}/{secrets.token_hex(8)}"
            try:
                here, there = multiprocessing.Pipe()
            except OSError as error:  # no more files can be opened; later they can
                log.warning("worker %s does not start: %s", owner, error)
                self._stop_reader.poll(SHORT_LIFE_S)
                continue
            arguments = self._settings, owner, self._types, there
            process = self._context.Process(target=work, args=arguments, name=owner, daemon=True)
            try:
                process.start()
            except (EOFError, OSError) as error:  # the fork server has died; another is made
                log.warning("worker %s does not start: %r; starting another", owner, error)
                here.close()  # which ends it if it did
                self._stop_reader.poll(SHORT_LIFE_S)
            else:
                return _Member(owner, process, here, time.monotonic())
            finally:
                there.close()
        return None

    def _supervise(self) -> None:
        while not _compiled():
            if self._stop_reader.poll(COMPILED_S):
                return
        for _ in range(self.wanted):
            member = self._spawn()
            if member is None:
                return
            with self._lock:
                self._members.append(member)
        while not self._stop_reader.poll():
            links = (member.link for member in self._members)
            ready = wait([self._stop_reader, *links, *(member.process.sentinel for member in self._members)])
            if self._stop_reader in ready:
                return
            for member in self._members:
                if member.link in ready:
                    self._hear(member)
            for member in [member for member in self._members if member.process.sentinel in ready]:
                self._replace(member)

    def _hear(self, member: _Member) -> None:
        with suppress(EOFError, OSError):  # it has died; its sentinel tells
            while member.link.poll():
                self._metrics.chunk_ended(*member.link.recv())

    @property
    def wanted(self) -> int:
        """How many workers there should be at least."""
        return cores() if self._settings.workers is None else self._settings.workers

    @property
    def alive(self) -> int:
        """How many there are."""
        with self._lock:
            return sum(member.process.exitcode is None for member in self._members)

    def _replace(self, dead: _Member) -> None:
        dead.process.join()
        self._hear(dead)
        self._metrics.workers_replaced.inc()
        log.warning("worker %s ended with status %s; starting another", dead.owner, dead.process.exitcode)
        with self._lock:
            dead.link.close()
        self._release(dead.owner)
        if time.monotonic() - dead.started < SHORT_LIFE_S and self._stop_reader.poll(SHORT_LIFE_S):
            return
        successor = self._spawn()
        if successor is None:
            return
        with self._lock:
            self._members[self._members.index(dead)] = successor
        _nudge(successor.link)

    def close(self) -> None:
        """End every worker; what they held is given back."""
        self._stop_writer.send_bytes(b".")
        self._thread.join()
        for member in self._members:
            member.process.kill()  # as abrupt as SIGTERM was, which they ignore: the store keeps what is whole
        for member in self._members:
            member.process.join()
            member.link.close()
        self._release(f"{self._settings.instance}/*")


def _compiled() -> bool:
    """Whether the workers' imports find their kernels, which they would compile otherwise."""
    return all(is_ready(name) for name in THESIS_CONTROLLERS)


def _nudge(worker: Connection) -> None:
    """Wake a worker; one that has not looked for long, being busy or frozen, has enough to find and is left alone."""
    writable = select.poll()
    with suppress(OSError):  # one that has just died; the supervisor will see, or has seen
        writable.register(worker, select.POLLOUT)
        if writable.poll(0):
            worker.send_bytes(b".")
