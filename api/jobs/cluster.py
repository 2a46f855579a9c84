"""Chunks on a Dask cluster: its workers compute and know no database; this server claims, renews and stores."""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from distributed import CancelledError, Client, Future, KilledWorker
from distributed.comm.core import CommClosedError

from api.jobs.work import CHUNK_END_S, JobTypes, kind_of
from api.jobs.worker import IDLE_S, problem_of, too_long
from api.metrics import ServiceMetrics
from api.settings import Settings
from api.store.database import StoreError
from api.store.jobs import JobRepository
from api.store.records import Lease, Superseded

log = logging.getLogger(__name__)

AHEAD = 2
"""Chunks handed out for each thread of the cluster: one it computes, one that waits, so that none idles."""

CONNECT_S = 3.0
"""A scheduler that does not answer for so long is asked again later [s]."""

_RUNNING: set[str] = set()
"""On a worker: chunks it computes now."""


def compute_there(name: str, compute: Callable[[dict[str, Any]], Any], piece: dict[str, Any]) -> Any:
    """A chunk's result, on a worker of the cluster."""
    _RUNNING.add(name)
    try:
        return compute(piece)
    finally:
        _RUNNING.discard(name)


def running_there() -> list[str]:
    """The chunks that a worker computes now."""
    return list(_RUNNING)


@dataclass
class _Sent:
    """A chunk that is on the cluster."""

    lease: Lease
    future: Future[Any]
    sent: float  # on the monotonic clock [s]


class DaskExecutor:
    """Hands chunks to an existing scheduler and stores what its workers make of them.

    Workers may join and die: a chunk whose worker died is computed again, first by the scheduler's own choice, then by
    a new claim. What they compute is stored only under a lease that still holds, as with any worker.
    """

    def __init__(
        self, settings: Settings, repository: JobRepository, types: JobTypes, metrics: ServiceMetrics | None = None
    ) -> None:  # fmt: skip
        self._metrics = metrics or ServiceMetrics()
        self._settings = settings
        self._repository = repository
        self._types = types
        self._address = settings.executor.replace("dask://", "tcp://", 1)
        self._owner = f"{settings.instance}/dask"
        self._client: Client | None = None
        self._sent: dict[str, _Sent] = {}
        self._given_up: dict[
            str, float
        ] = {}  # names of chunks nobody waits for, and when to look whether they still run
        self._events: queue.SimpleQueue[str] = (
            queue.SimpleQueue()
        )  # names of chunks that have ended; empty: look for work
        self._spec = lru_cache(4)(self._load)
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="dask", daemon=True)

    def start(self) -> None:
        """Begin in the background; what a server of this name held before is given back first."""
        with suppress(StoreError):  # the leases end by themselves
            self._repository.release(f"{self._settings.instance}/*")
        self._thread.start()

    def wake(self) -> None:
        """There is work."""
        self._events.put("")

    wanted = 1

    @property
    def alive(self) -> int:
        """Threads of the cluster that can compute a chunk now."""
        client = self._client
        return sum(client.nthreads().values()) if client is not None and client.status == "running" else 0

    def close(self) -> None:
        """Give back what is not done."""
        self._stopping.set()
        self.wake()
        self._thread.join()

    def _load(self, job_id: str) -> dict[str, Any]:
        spec = self._repository.spec(job_id)
        if spec is None:
            raise Superseded
        return spec

    def _run(self) -> None:
        """Work while a scheduler answers; look for it again when it does not."""
        silent = False
        while not self._stopping.is_set():
            try:
                with Client(self._address, timeout=CONNECT_S, name="hrs-twin", set_as_default=False) as client:
                    self._client = client
                    log.info("jobs run on the cluster at %s", self._settings.executor)
                    silent = False
                    self._work(client)
            except (OSError, TimeoutError) as error:
                if not silent:
                    log.warning("no scheduler at %s, looking again: %s", self._settings.executor, error)
                silent = True
            finally:
                self._client = None
                self._give_back()
            self._stopping.wait(IDLE_S)

    def _give_back(self) -> None:
        self._sent.clear()
        self._given_up.clear()
        with suppress(StoreError):  # the leases end by themselves
            self._repository.release(self._owner)

    def _work(self, client: Client) -> None:
        """Claim, send, renew, store, until the connection is lost or the server ends."""
        renewed = time.monotonic()
        while not self._stopping.is_set() and client.status == "running":
            ended = ""
            try:
                if time.monotonic() - renewed > self._settings.lease_s / 3:
                    self._renew()
                    self._end_given_up(client)
                    renewed = time.monotonic()
                self._claim(client)
                ended = self._next()
                self._store(ended)
            except StoreError as error:
                log.warning("%s", error)
                if ended:
                    self._events.put(ended)  # to be stored when the store is back
                self._stopping.wait(min(IDLE_S, self._settings.lease_s / 3))
        for sent in self._sent.values():
            sent.future.cancel()

    def _next(self) -> str:
        try:
            return self._events.get(timeout=min(IDLE_S, self._settings.lease_s / 3))
        except queue.Empty:
            return ""

    def _claim(self, client: Client) -> None:
        """Keep every thread of the cluster busy."""
        for _ in range(AHEAD * self.alive - len(self._sent)):
            lease = self._repository.claim(self._owner, self._settings.lease_s, self._settings.attempts_max)
            if lease is None:
                return
            try:
                of = self._types[kind_of(lease)]
                piece = of.task(self._spec(lease.job), lease)
            except Superseded:
                continue
            name = f"{lease.job}-{lease.chunk}-{lease.attempt}"
            future = client.submit(
                compute_there, name, of.compute, piece, key=name, pure=False, priority=-lease.priority
            )
            self._sent[name] = _Sent(lease, future, time.monotonic())
            future.add_done_callback(lambda done: self._events.put(done.key))

    def _store(self, name: str) -> None:
        """Store what came of a chunk that has ended."""
        sent = self._sent.get(name)
        if sent is None:
            return
        outcome = "superseded"
        with suppress(Superseded):
            if sent.future.status == "finished":
                self._repository.complete(sent.lease, sent.future.result())
                outcome = "done"
            elif sent.future.status == "error" and not _died(error := sent.future.exception()):
                log.warning("%s failed: %r", sent.lease.job, error)
                self._repository.fail(sent.lease, problem_of(error))
                outcome = "failed"
            else:  # its workers died, or the scheduler forgot it: the next claim counts as another attempt
                self._repository.give_back(sent.lease)
        took = time.monotonic() - sent.sent
        self._metrics.chunk_ended(sent.lease.job.partition("-")[0], took, sent.lease.attempt, outcome)
        del self._sent[name]
        sent.future.release()

    def _renew(self) -> None:
        """Go on holding what is on the cluster; end what has taken too long or is nobody's any more."""
        for name, sent in list(self._sent.items()):
            try:
                if time.monotonic() < sent.sent + self._settings.chunk_max_s:
                    self._repository.renew(sent.lease, self._settings.lease_s)
                    continue
                self._repository.fail(sent.lease, too_long(sent.lease, self._settings))
            except Superseded:
                pass
            sent.future.cancel(force=True)
            self._given_up[name] = time.monotonic() + CHUNK_END_S
            del self._sent[name]

    def _end_given_up(self, client: Client) -> None:
        """Restart workers that go on with what nobody waits for: a kernel that runs cannot be stopped otherwise."""
        if not any(time.monotonic() > until for until in self._given_up.values()):
            return
        late = {name for name, until in self._given_up.items() if time.monotonic() > until}
        busy = [where for where, names in client.run(running_there, on_error="ignore").items() if late & set(names)]
        for name in late:
            del self._given_up[name]
        if busy:
            log.warning("restarting %s, which went on with a chunk that was cancelled", ", ".join(busy))
            try:
                client.restart_workers(busy, timeout=CONNECT_S)
            except (ValueError, TimeoutError) as error:
                log.warning("workers cannot be restarted: %s", error)


def _died(error: BaseException | None) -> bool:
    """Whether an error tells of a worker that is gone, not of what it computed."""
    return isinstance(error, KilledWorker | CancelledError | CommClosedError)
