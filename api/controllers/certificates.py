"""Certificates of service, made one at a time by processes in the background and kept while the service runs."""

from __future__ import annotations

import queue
import threading
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import Future
from concurrent.futures import TimeoutError as LateError
from contextlib import suppress
from enum import StrEnum
from functools import partial
from http import HTTPStatus
from typing import Any, Literal

from api.controllers.service import check_station
from api.http.problems import ProblemError
from api.jobs.checks import Checks
from station import Station

KEPT = 64
"""Certificates kept; the largest have some megabytes."""

WAITING_MAX = 8
"""Certificates that may be waited for at once."""

PATIENCE_S = 1.0
"""A request waits so long for a certificate before it says when to come again [s]."""

RETRY_S = 5
"""When to come again [s]."""


DocumentKind = Literal["certificate", "verification"]

Work = Callable[[], dict[str, Any]]


_OF: dict[DocumentKind, str] = {"certificate": "", "verification": "?of=verification"}


class Making(StrEnum):
    """How far a certificate is."""

    NONE = "none"  # nobody has had it made since the service started
    MAKING = "making"
    MADE = "made"
    FAILED = "failed"  # asking for the certificate says why


class ServiceCertificates:
    """Certificates, and checks of them, by controller, options and the hash of the station."""

    def __init__(self, checks: Checks) -> None:
        self._checks = checks
        self._worker = _Worker()
        self._found: OrderedDict[tuple[str, str, str], Future[dict[str, Any]]] = OrderedDict()
        self._lock = threading.Lock()

    def begin(self, what: DocumentKind, controller: str, station: Station) -> Future[dict[str, Any]]:
        """Have it made, unless it is or is being made; waits for nothing.

        Raises
        ------
        ProblemError
            429 where too many are waited for.
        InputError
            if the controller does not fit the station.
        """
        check_station(controller, station)
        with self._lock:
            document = self._begun("certificate", controller, station, partial(self._checks.make, controller, station))
            if what == "certificate":
                return document
            return self._begun(what, controller, station, lambda: self._checks.service(document.result()))

    def get(self, what: DocumentKind, controller: str, station: Station) -> dict[str, Any]:
        """The document, or the check of it; begins nothing.

        Raises
        ------
        ProblemError
            503 while it is made, 404 where nothing has had it made.
        InputError
            if the controller does not fit the station.
        """
        check_station(controller, station)
        future = self._found.get(_key(what, controller, station))
        if future is None:
            raise ProblemError(
                HTTPStatus.NOT_FOUND, "not-found", "Not made",
                f"POST /v1/controllers/{{name}}/certificate{_OF[what]} with the same station and options makes it",
            )  # fmt: skip
        try:
            return future.result(PATIENCE_S)
        except LateError:
            raise ProblemError(
                HTTPStatus.SERVICE_UNAVAILABLE, "unavailable", "In the making", f"the {what} is being made",
                retry_after_s=RETRY_S,
            ) from None  # fmt: skip

    def state(self, what: DocumentKind, controller: str, station: Station) -> tuple[Making, dict[str, Any]]:
        """How far it is, and the document once it is made; begins nothing and waits for nothing."""
        future = self._found.get(_key(what, controller, station))
        if future is None:
            return Making.NONE, {}
        if not future.done():
            return Making.MAKING, {}
        if future.cancelled() or future.exception() is not None:
            return Making.FAILED, {}
        return Making.MADE, future.result()

    def _begun(self, what: DocumentKind, controller: str, station: Station, work: Work) -> Future[dict[str, Any]]:
        """The future document; called under the lock."""
        key = _key(what, controller, station)
        held = self._found.get(key)
        if held is None or (held.done() and held.exception() is not None):  # what failed may succeed another time
            if sum(not future.done() for future in self._found.values()) >= WAITING_MAX:
                raise ProblemError(
                    HTTPStatus.TOO_MANY_REQUESTS, "full", "Too many",
                    f"{WAITING_MAX} certificates are being made", retry_after_s=RETRY_S,
                )  # fmt: skip
            self._found[key] = self._worker.submit(work)
        self._found.move_to_end(key)
        self._forget()
        return self._found[key]

    def _forget(self) -> None:
        done = [key for key, future in self._found.items() if future.done()]
        for key in done[: max(0, len(self._found) - KEPT)]:
            del self._found[key]

    def close(self) -> None:
        """Begin no further certificate."""
        self._worker.close()


class _Worker:
    """Work one after the other, on a thread that does not keep the process from ending: a proof takes minutes."""

    def __init__(self) -> None:
        self._waiting: queue.SimpleQueue[tuple[Work, Future[dict[str, Any]]] | None] = queue.SimpleQueue()
        threading.Thread(target=self._run, name="certificate", daemon=True).start()

    def submit(self, work: Work) -> Future[dict[str, Any]]:
        """Do it behind what was submitted before."""
        future: Future[dict[str, Any]] = Future()
        self._waiting.put((work, future))
        return future

    def close(self) -> None:
        """Begin nothing more."""
        with suppress(queue.Empty):
            while True:
                self._waiting.get_nowait()
        self._waiting.put(None)

    def _run(self) -> None:
        while (item := self._waiting.get()) is not None:
            work, future = item
            try:
                future.set_result(work())
            except Exception as error:  # noqa: BLE001  # whoever asks for it is told
                future.set_exception(error)


def _key(what: DocumentKind, controller: str, station: Station) -> tuple[str, str, str]:
    from controllers.certified.service import station_hash

    return what, controller, station_hash(station)
