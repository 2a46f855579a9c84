"""Idempotency keys whose first request is still being answered."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from http import HTTPStatus

from api.http.problems import ProblemError


class InFlightRequest:
    """A request under way; one that ended before its work was stored is under way until `stored`."""

    stored: Future[None] | None = None


class InFlightRequests:
    """Keys whose requests are being answered by this server."""

    def __init__(self) -> None:
        self._open: set[tuple[str, str]] = set()
        self._lock = threading.Lock()

    @contextmanager
    def one(self, owner: str, key: str) -> Iterator[InFlightRequest]:
        """Only one at a time; a problem for the second."""
        with self._lock:
            if (owner, key) in self._open:
                raise ProblemError(
                    HTTPStatus.CONFLICT, "in-flight", "In flight",
                    "the first request with this Idempotency-Key is still being answered", retry_after_s=1,
                )  # fmt: skip
            self._open.add((owner, key))
        flight = InFlightRequest()
        try:
            yield flight
        finally:
            if flight.stored is None:
                self._landed(owner, key)
            else:
                flight.stored.add_done_callback(lambda _: self._landed(owner, key))

    def _landed(self, owner: str, key: str) -> None:
        with self._lock:
            self._open.discard((owner, key))
