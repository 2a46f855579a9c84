"""A worker process: claim a chunk, compute it while a thread renews the lease, store its result, again."""

from __future__ import annotations

import logging
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from multiprocessing import parent_process
from multiprocessing.connection import Connection, wait
from typing import Any

from api import logs
from api.jobs.progress import reporting
from api.jobs.work import JobTypes, RunError, kind_of
from api.settings import Settings
from api.store.database import Database, StoreError
from api.store.jobs import JobRepository
from api.store.records import Lease, Superseded
from station import InputError, StationError
from theory import TheoryError

log = logging.getLogger(__name__)

IDLE_S = 1.0
"""A worker that nobody wakes looks for work this often: for what other servers submit or lose [s]."""

NICENESS = 10
"""Workers yield to live twins and requests."""


def work(settings: Settings, owner: str, types: JobTypes, server: Connection) -> None:
    """Work until the server that started this process ends it, or dies; it wakes us, and hears what we did."""
    logs.configure(settings.log_format, logging.WARNING)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)  # both may reach the whole group; the server ends its workers
    os.nice(NICENESS)
    threading.Thread(target=_end_with_the_server, daemon=True).start()
    repository = JobRepository(Database(settings.database_url, pool=2))
    worker = Worker(repository, settings, owner, types, lambda *told: _tell(server, told))
    with suppress(EOFError, ConnectionError):  # the server is gone
        while True:
            if not _stepped(worker) and server.poll(IDLE_S):
                server.recv_bytes()


def _stepped(worker: Worker) -> bool:
    try:
        return worker.step()
    except StoreError as error:
        log.warning("%s", error)
        return False


def _tell(server: Connection, told: tuple[Any, ...]) -> None:
    with suppress(OSError):  # a server that is gone: this process ends soon
        server.send(told)


def _end_with_the_server() -> None:
    server = parent_process()
    if server is not None:
        wait([server.sentinel])
        os._exit(1)


class Worker:
    """Does one chunk after the other. A cluster's executor may call `step` as well as `work` does."""

    def __init__(
        self, repository: JobRepository, settings: Settings, owner: str, types: JobTypes,
        tell: Callable[[str, float, int, str], None] = lambda *_: None,
    ) -> None:  # fmt: skip
        self._tell = tell
        self._repository = repository
        self._settings = settings
        self._owner = owner
        self._types = types
        self._spec = lru_cache(4)(self._load)

    def _load(self, job_id: str) -> dict[str, Any]:
        spec = self._repository.spec(job_id)
        if spec is None:
            raise Superseded
        return spec

    def step(self) -> bool:
        """Do the next chunk; False if there is none."""
        lease = self._repository.claim(self._owner, self._settings.lease_s, self._settings.attempts_max)
        if lease is None:
            return False
        began = time.perf_counter()
        outcome = "failed"
        try:
            with self._renewed(lease), reporting(lambda part: self._advance(lease, part)):
                of = self._types[kind_of(lease)]
                done = of.compute(of.task(self._spec(lease.job), lease))
            self._insist(lease, lambda: self._repository.complete(lease, done))
            outcome = "done"
        except Superseded:
            outcome = "superseded"
            log.info("chunk %d of %s is somebody else's now", lease.chunk, lease.job)
        except StoreError:
            raise
        except Exception as error:  # noqa: BLE001  # whatever a plug-in raises fails its job, not the worker
            self._fail(lease, error)
        self._tell(lease.job.partition("-")[0], time.perf_counter() - began, lease.attempt, outcome)
        return True

    def _advance(self, lease: Lease, part: float) -> None:
        """Store how much is done; a store in trouble is told of it the next time."""
        with suppress(StoreError):
            self._repository.advance(lease, part)

    def _fail(self, lease: Lease, error: Exception) -> None:
        log.warning("%s failed: %r", lease.job, error)
        with suppress(Superseded):
            self._insist(lease, lambda: self._repository.fail(lease, problem_of(error)))

    def _insist(self, lease: Lease, write: Callable[[], None]) -> None:
        """Write what came of a chunk, again and again while the store is away or full: it need not be computed anew.

        Raises
        ------
        Superseded
            if the chunk is somebody else's, or it was written and the store could not say so.
        """
        while True:
            try:
                write()
            except StoreError as error:
                log.warning("%s waits for the store: %s", lease.job, error)
            else:
                return
            time.sleep(min(IDLE_S, self._settings.lease_s / 3))
            with suppress(StoreError):
                self._repository.renew(lease, self._settings.lease_s)

    @contextmanager
    def _renewed(self, lease: Lease) -> Iterator[None]:
        """Renew the lease while the block runs; end the process if the chunk is no longer ours, or takes too long."""
        done = threading.Event()
        until = time.monotonic() + self._settings.chunk_max_s

        def renew() -> None:
            while not done.wait(self._settings.lease_s / 3):
                try:
                    if time.monotonic() > until:
                        self._repository.fail(lease, too_long(lease, self._settings))
                        os._exit(1)
                    self._repository.renew(lease, self._settings.lease_s)
                except Superseded:
                    if not done.is_set():
                        os._exit(1)  # nothing else stops a kernel; the server starts another worker
                except StoreError as error:
                    log.warning("%s", error)

        thread = threading.Thread(target=renew, daemon=True)
        thread.start()
        try:
            yield
        finally:
            done.set()


def too_long(lease: Lease, settings: Settings) -> dict[str, Any]:
    """The problem of a chunk that took longer than a chunk may."""
    detail = f"chunk {lease.chunk} took longer than {settings.chunk_max_s:g} s; the limit is chunk_max_s"
    return {"title": "Too long", "detail": detail}


def problem_of(error: Exception) -> dict[str, Any]:
    """The problem of a job that failed; of a comparison, with the run that did."""
    if isinstance(error, RunError):
        return {**problem_of(error.cause), "run": error.run}
    problem: dict[str, Any] = {"title": type(error).__name__, "detail": str(error)}
    if isinstance(error, InputError):
        problem["errors"] = [{"field": field, "message": message} for field, message in error.problems]
    elif not isinstance(error, StationError | TheoryError):
        problem["detail"] = repr(error)
    return problem
