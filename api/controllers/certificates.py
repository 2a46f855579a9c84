"""Certificates of service, made one at a time in the background and kept while the service runs."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from concurrent.futures import TimeoutError as LateError
from enum import StrEnum
from functools import partial
from http import HTTPStatus
from typing import Any, Literal

from api.controllers.service import check_station
from api.problems import ProblemError
from station import Station

KEPT = 64
"""Certificates kept; the largest have some megabytes."""

WAITING_MAX = 8
"""Certificates that may be waited for at once."""

PATIENCE_S = 1.0
"""A request waits so long for a certificate before it says when to come again [s]."""

RETRY_S = 5
"""When to come again [s]."""


What = Literal["certificate", "verification"]


class Making(StrEnum):
    """How far a certificate is."""

    NONE = "none"  # nobody has asked for it since the service started
    MAKING = "making"
    MADE = "made"
    FAILED = "failed"  # asking for the certificate says why


class ServiceCertificates:
    """Certificates, and checks of them, by controller, options and the hash of the station."""

    def __init__(self) -> None:
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="certificate")
        self._found: OrderedDict[tuple[str, str, str], Future[dict[str, Any]]] = OrderedDict()
        self._lock = threading.Lock()

    def get(self, controller: str, station: Station) -> dict[str, Any]:
        """The certificate, if it is there or soon will be.

        Raises
        ------
        ProblemError
            503 while it is made, 429 where too many are waited for.
        InputError
            if the controller does not fit the station.
        """
        from controllers.certified.service import certify

        check_station(controller, station)
        return self._answer("certificate", controller, station, partial(certify, controller, station))

    def verification(self, controller: str, station: Station) -> dict[str, Any]:
        """Whether the certificate holds, computed anew and proved again; made in the background as `get` does."""
        document = self.get(controller, station)
        return self._answer("verification", controller, station, partial(_verified, document))

    def begin(self, what: What, controller: str, station: Station) -> None:
        """Have it made, if it is not there; raises what `get` does, but for that it is being made."""
        try:
            (self.get if what == "certificate" else self.verification)(controller, station)
        except ProblemError as error:
            if error.problem.status != HTTPStatus.SERVICE_UNAVAILABLE:
                raise

    def state(self, what: What, controller: str, station: Station) -> tuple[Making, dict[str, Any]]:
        """How far it is, and the document once it is made; begins nothing and waits for nothing."""
        from controllers.certified.service import station_hash

        future = self._found.get((what, controller, station_hash(station)))
        if future is None:
            return Making.NONE, {}
        if not future.done():
            return Making.MAKING, {}
        if future.cancelled() or future.exception() is not None:
            return Making.FAILED, {}
        return Making.MADE, future.result()

    def _answer(
        self, what: What, controller: str, station: Station, work: Callable[[], dict[str, Any]]
    ) -> dict[str, Any]:
        from controllers.certified.service import station_hash

        key = (what, controller, station_hash(station))
        with self._lock:
            if key not in self._found:
                if sum(not future.done() for future in self._found.values()) >= WAITING_MAX:
                    raise ProblemError(
                        HTTPStatus.TOO_MANY_REQUESTS, "full", "Too many",
                        f"{WAITING_MAX} certificates are being made", retry_after_s=RETRY_S,
                    )  # fmt: skip
                self._found[key] = self._worker.submit(work)
            self._found.move_to_end(key)
            future = self._found[key]
            self._forget()
        try:
            return future.result(PATIENCE_S)
        except LateError:
            raise ProblemError(
                HTTPStatus.SERVICE_UNAVAILABLE, "unavailable", "In the making", f"the {what} is being made",
                retry_after_s=RETRY_S,
            ) from None  # fmt: skip

    def _forget(self) -> None:
        done = [key for key, future in self._found.items() if future.done()]
        for key in done[: max(0, len(self._found) - KEPT)]:
            del self._found[key]

    def close(self) -> None:
        """Begin no further certificate."""
        self._worker.shutdown(wait=False, cancel_futures=True)


def _verified(document: dict[str, Any]) -> dict[str, Any]:
    from controllers.certified.service import RefusedError, verify

    try:
        found = verify(document)
    except RefusedError as error:
        return {"verified": False, "claim": str(error)}
    return {"verified": True, "claim": f"{found['verdict']}: {found['claim']}"}
