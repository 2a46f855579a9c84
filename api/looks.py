"""A look at something that may take its time: one at a time, however many ask, and what was found last is kept."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from concurrent.futures import TimeoutError as LateError
from typing import Generic, TypeVar

log = logging.getLogger(__name__)

Found = TypeVar("Found")


class Look(Generic[Found]):
    """Looks in a thread of its own when somebody asks and the last look is older than `kept_s`.

    Parameters
    ----------
    look
        What to call; where it raises nothing is found, and the log says why.
    name
        Of the thread.
    kept_s
        How long what was found is new enough [s].
    """

    def __init__(self, look: Callable[[], Found], name: str, kept_s: float) -> None:
        self._look = look
        self._name = name
        self._kept_s = kept_s
        self._lock = threading.Lock()
        self._going: Future[Found | None] | None = None
        self._began = 0.0  # monotonic [s]

    def found(self, patience_s: float) -> Found | None:
        """The value found; None if it is not known within `patience_s`."""
        with self._lock:
            going = self._going
            if going is None or (going.done() and time.monotonic() - self._began > self._kept_s):
                self._going = going = Future()
                self._began = time.monotonic()
                threading.Thread(target=self._go, args=(going,), name=self._name, daemon=True).start()
        try:
            return going.result(patience_s)
        except LateError:
            return None

    def _go(self, going: Future[Found | None]) -> None:
        found = None
        try:
            found = self._look()
        except Exception:
            log.exception("%s: the look failed", self._name)
        finally:
            going.set_result(found)  # or nobody would look again
