"""Certificates made and checked in processes of their own: limits of time and memory, and an end with the request."""

from __future__ import annotations

import json
import logging
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from http import HTTPStatus
from typing import Any

from api.http.disconnection import Disconnection
from api.http.problems import ProblemError
from api.jobs.check import MATRICES, OUT_OF_MEMORY, SERVICE, SERVICE_FORMAT
from api.settings import Settings
from station import InputError, Station

log = logging.getLogger(__name__)

PATIENCE_S = 1.0
"""A request waits so long for others to be done before it is refused [s]."""

RETRY_S = 5
"""When to come again [s]."""

WITHOUT_MEMORY = (
    OUT_OF_MEMORY,
    *(-number for number in (signal.SIGABRT, signal.SIGBUS, signal.SIGKILL, signal.SIGSEGV)),
)
"""Statuses of a process that got no memory: libraries end it where they get none, and so does a machine."""

Process = subprocess.Popen[bytes]


class Checks:
    """Runs checks, as many at once as the settings allow; one process of the quick family waits for the next."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._places = threading.BoundedSemaphore(settings.checks_max)
        self._lock = threading.Lock()
        self._processes: set[Process] = set()
        self._spare: Process | None = None
        self._closed = False

    def open(self) -> None:
        """Have a process ready."""
        spare = self._started(MATRICES) if self._spare is None else None
        with self._lock:
            if self._spare is None and not self._closed:
                self._spare, spare = spare, None
        if spare is not None:
            self._end(spare)

    def certificate(self, document: Mapping[str, Any], content: bytes, client: Disconnection) -> dict[str, Any]:
        """Whether a certificate of either kind holds: `verified`, `claim`, and `inequalities` of a switched system's.

        Parameters
        ----------
        document
            The certificate, of which only the format is looked at here.
        content
            The same as JSON text.

        Raises
        ------
        ProblemError
            422 `too-large` where it takes more time or memory than the settings allow, 429 `full` where too many are
            asked for, 503 `busy` where the machine has too little time for it.
        """
        order = {"work": "check", **self._limits()}
        with self._place():
            if document.get("format") == SERVICE_FORMAT:
                return self._answer(self._started(SERVICE), order, content, client)
            try:
                return self._answer(self._ready(), order, content, client)
            finally:
                self.open()

    def belongs(
        self, document: dict[str, Any], controller: str, station: Station, client: Disconnection
    ) -> tuple[str, str] | None:
        """Why a certificate of service is not one of this controller at this station: the field, and what is wrong.

        Raises
        ------
        ProblemError
            as `certificate`.
        """
        try:
            content = json.dumps(document).encode()
        except RecursionError:
            return "", "is nested too deeply for a certificate"
        order = {"work": "belongs", "controller": controller, "station": station.model_dump(mode="json")}
        with self._place():
            found = self._answer(self._started(SERVICE), {**order, **self._limits()}, content, client)
        refused: list[str] | None = found["refused"]
        return None if refused is None else (refused[0], refused[1])

    def make(self, controller: str, station: Station) -> dict[str, Any]:
        """A certificate of service; it may take as long as a piece of a job, and takes no place of a request's.

        Raises
        ------
        InputError
            if the controller does not fit the station.
        """
        order = {"work": "make", "controller": controller, "station": station.model_dump(mode="json")}
        found = self._answer(self._started(SERVICE), {**order, **self._limits_of_jobs()}, b"", Disconnection())
        if "problems" in found:
            raise InputError("certificate", [(field, message) for field, message in found["problems"]])
        document: dict[str, Any] = found["document"]
        return document

    def service(self, document: dict[str, Any]) -> dict[str, Any]:
        """Whether a certificate of service that `make` gave holds; as `make`."""
        order = {"work": "check", **self._limits_of_jobs()}
        return self._answer(self._started(SERVICE), order, json.dumps(document).encode(), Disconnection())

    def close(self) -> None:
        """End every check."""
        with self._lock:
            self._closed = True
            running, spare, self._spare = self._processes - {self._spare}, self._spare, None
        for process in running:
            process.kill()  # whoever waits for its answer does the rest
        if spare is not None:
            self._end(spare)

    def _limits(self) -> dict[str, Any]:
        given = self._settings
        return {
            "cpu_s": given.check_cpu_s, "wall_s": given.check_wall_s, "memory_bytes": given.check_memory_bytes,
        }  # fmt: skip

    def _limits_of_jobs(self) -> dict[str, Any]:
        longest = self._settings.chunk_max_s
        return {**self._limits(), "cpu_s": longest, "wall_s": longest}

    @contextmanager
    def _place(self) -> Iterator[None]:
        if not self._places.acquire(timeout=PATIENCE_S):
            raise ProblemError(
                HTTPStatus.TOO_MANY_REQUESTS, "full", "Too many",
                f"{self._settings.checks_max} certificates are being checked; the limit is checks_max",
                retry_after_s=RETRY_S,
            )  # fmt: skip
        try:
            yield
        finally:
            self._places.release()

    def _ready(self) -> Process:
        """The process that waits, or a new one where it has died."""
        with self._lock:
            spare, self._spare = self._spare, None
        if spare is not None and spare.poll() is not None:
            self._end(spare)
            spare = None
        return spare or self._started(MATRICES)

    def _started(self, family: str) -> Process:
        command = [sys.executable, "-P", "-m", "api.jobs.check", family]
        process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0)
        with self._lock:
            self._processes.add(process)
            closed = self._closed
        if closed:
            process.kill()
        return process

    def _answer(
        self, process: Process, order: dict[str, Any], document: bytes, client: Disconnection
    ) -> dict[str, Any]:
        """A process's answer to an order."""
        late = threading.Event()

        def stop() -> None:
            late.set()
            process.kill()

        timer = threading.Timer(order["wall_s"], stop)
        timer.start()
        try:
            with client.calls(process.kill):
                text = _asked(process, json.dumps({**order, "bytes": len(document)}).encode() + b"\n" + document)
            status = process.wait()
        finally:
            timer.cancel()
            self._end(process)
        if status == 0:
            answer: dict[str, Any] = json.loads(text)
            return answer
        raise self._problem(status, order, late=late.is_set())

    def _problem(self, status: int, order: dict[str, Any], *, late: bool) -> ProblemError:
        """Why a process gave no answer."""
        if status == -signal.SIGKILL and self._closed:
            return ProblemError(
                HTTPStatus.SERVICE_UNAVAILABLE, "busy", "Stopping", "the service is being stopped",
                retry_after_s=RETRY_S,
            )  # fmt: skip
        if status == -signal.SIGKILL and late:
            return ProblemError(
                HTTPStatus.SERVICE_UNAVAILABLE, "busy", "Too busy",
                f"{order['wall_s']:g} s were not enough for the check (setting check_wall_s)", retry_after_s=RETRY_S,
            )  # fmt: skip
        if status == -signal.SIGXCPU:
            limit = f"{order['cpu_s']:g} s of a core (setting check_cpu_s)"
        elif status in WITHOUT_MEMORY:
            limit = f"{order['memory_bytes']} bytes of memory (setting check_memory_bytes)"
        else:
            log.error("a check ended with status %d", status)
            return ProblemError(
                HTTPStatus.SERVICE_UNAVAILABLE, "busy", "Not checked", "the check could not be made; try again",
                retry_after_s=RETRY_S,
            )  # fmt: skip
        return ProblemError(
            HTTPStatus.UNPROCESSABLE_ENTITY, "too-large", "Too large to check here",
            f"the check needs more than {limit}, so that nothing is said of the document; `hrs verify` checks it "
            "without such limits",
        )  # fmt: skip

    def _end(self, process: Process) -> None:
        process.kill()
        process.wait()
        for stream in (process.stdin, process.stdout):
            if stream is not None:
                stream.close()
        with self._lock:
            self._processes.discard(process)


def _asked(process: Process, content: bytes) -> bytes:
    """The output of a process that is given this; its input stays open, since it ends where that does."""
    if process.stdin is None or process.stdout is None:
        raise RuntimeError("a check without pipes")
    with suppress(BrokenPipeError):  # it has ended; its status says why
        rest = memoryview(content)
        while rest:
            rest = rest[process.stdin.write(rest) or 0 :]
    return process.stdout.read()
