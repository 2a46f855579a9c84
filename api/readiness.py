"""Whether the service can do its work: each thing it depends on, by name."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from concurrent.futures import TimeoutError as LateError

log = logging.getLogger(__name__)

KEPT_S = 0.5
"""Whoever asks more often is told what was found last [s]: `/readyz` is open to all, and asks the database."""

PATIENCE_S = 2.0
"""What has not answered by then counts as failed [s]; probes wait longer."""


class Readiness:
    """Looks after the things the service depends on: one look at a time, however many ask.

    Parameters
    ----------
    checks
        What to call for each thing: it returns why that fails, or an empty text, and raises if it cannot say. Reasons
        are shown to anybody, so they name no address.
    """

    def __init__(self, checks: Mapping[str, Callable[[], str]]) -> None:
        self._checks = checks
        self._lock = threading.Lock()
        self._look: Future[dict[str, str]] | None = None
        self._looked = 0.0  # monotonic [s]
        self._at = next(iter(checks), "")

    def failures(self) -> dict[str, str]:
        """What fails, and why; blocks at most `PATIENCE_S`."""
        with self._lock:
            look = self._look
            if look is None or (look.done() and time.monotonic() - self._looked > KEPT_S):
                self._look = look = Future()
                self._looked = time.monotonic()
                threading.Thread(target=self._all, args=(look,), name="readiness", daemon=True).start()
        try:
            return look.result(PATIENCE_S)
        except LateError:
            return {self._at: f"does not answer within {PATIENCE_S:g} s"}

    def _all(self, look: Future[dict[str, str]]) -> None:
        found = {}
        for name, check in self._checks.items():
            self._at = name
            try:
                reason = check()
            except Exception as error:  # noqa: BLE001  # whatever it is, it is not ready
                log.warning("not ready: %s: %s", name, error)
                reason = "does not answer"
            if reason:
                found[name] = reason
        look.set_result(found)

    @property
    def names(self) -> list[str]:
        """What is looked after."""
        return list(self._checks)
