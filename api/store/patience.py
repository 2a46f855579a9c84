"""How long a caller waits for a store that does not answer, and what the callers after it are spared.

A request waits `REQUEST_S` from its arrival, or `LEAST_S` where its time went elsewhere. A background task waits
`TASK_S` for each sign of life. A silence of `SUSPECT_S` sends a probe; when that has not been answered for `OPEN_S`,
the breaker opens: every wait ends, and every new one fails at once, until a probe is answered.
"""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

log = logging.getLogger(__name__)

REQUEST_S = 2.0
"""From the arrival of a request [s]; every answer has to be on its way within 3 s."""

LEAST_S = 0.5
"""Each transaction of a request that spent its time otherwise, and each pause of a store that does answer [s]."""

TASK_S = 10.0
"""A background task, between two signs of life [s]."""

LONG_S = 600.0
"""Migrations, restores and deletions of whole tables, which a server computes in silence [s]."""

SUSPECT_S = 0.5
"""A silence that lasts so long may be the store's [s]: it is usually a lock, or much to compute."""

OPEN_S = 1.0
"""A probe takes milliseconds; unanswered for so long it says that the store does not answer anybody [s]."""

PROBE_S = 5.0
"""A probe waits so long before another is sent [s]: a frozen server answers the one that waits when it thaws."""

PROBE_EVERY_S = 0.25
"""Between a probe that failed and the next [s]."""


class Arrival:
    """When a request was complete [s, monotonic]."""

    def __init__(self) -> None:
        self.begin()

    def begin(self) -> None:
        """The request is complete now: time that its sender took for the body does not count."""
        self.at = time.monotonic()


arrival: ContextVar[Arrival | None] = ContextVar("arrival", default=None)
"""Of the request that is being answered; None in background tasks."""

_silence: ContextVar[float] = ContextVar("silence", default=TASK_S)


@contextmanager
def patient(silence_s: float) -> Iterator[None]:
    """Wait so long for each sign of life of the store while the block runs, whatever request it belongs to."""
    arrived, waits = arrival.set(None), _silence.set(silence_s)
    try:
        yield
    finally:
        _silence.reset(waits)
        arrival.reset(arrived)


def left_s() -> float:
    """The time that a request still has for the store [s]; at least `LEAST_S`."""
    arrived = arrival.get()
    return REQUEST_S if arrived is None else max(LEAST_S, arrived.at + REQUEST_S - time.monotonic())


class Cap:
    """A moment [s, monotonic] at which every wait ends: the service is closing."""

    at = math.inf


class Breaker:
    """Open while a store does not answer: its callers fail at once, and one thread probes.

    Parameters
    ----------
    probe
        Asks the store; raises while it does not answer.
    """

    def __init__(self, probe: Callable[[], None]) -> None:
        self._probe = probe
        self._lock = threading.Lock()
        self._ending = threading.Event()
        self._suspected: float | None = None  # since [s, monotonic]; None while the store answers

    @property
    def open(self) -> bool:
        """Whether the store does not answer."""
        since = self._suspected
        return since is not None and time.monotonic() - since > OPEN_S

    def suspect(self) -> None:
        """A wait is long: probe, unless that is being done."""
        with self._lock:
            if self._suspected is not None or self._ending.is_set():
                return
            self._suspected = time.monotonic()
        threading.Thread(target=self._look, name="store-probe", daemon=True).start()

    def close(self) -> None:
        """Probe no more."""
        self._ending.set()

    def _look(self) -> None:
        began, failed = time.monotonic(), False
        while not self._ending.is_set():
            try:
                with patient(PROBE_S):
                    self._probe()
            except Exception as error:  # noqa: BLE001  # whatever it is, the store does not answer
                if not failed:
                    log.warning("the store does not answer: %s", str(error).partition("\n")[0])
                failed = True
                self._ending.wait(PROBE_EVERY_S)
            else:
                if self.open:
                    log.warning("the store answers again, after %.1f s", time.monotonic() - began)
                self._suspected = None
                return


class Wait:
    """The wait of one transaction; without a breaker that of a probe."""

    def __init__(self, cap: Cap, breaker: Breaker | None = None) -> None:
        self._cap = cap
        self._breaker = breaker
        arrived = arrival.get()
        self._silence_s = _silence.get() if arrived is None else LEAST_S
        self._heard = time.monotonic()
        self._until = self._heard + (self._silence_s if arrived is None else left_s())

    def answered(self) -> None:
        """The store has given a sign of life."""
        self._heard = time.monotonic()
        self._until = max(self._until, self._heard + self._silence_s)

    @property
    def over(self) -> bool:
        """Whether to give up; a silence that is long has the store probed."""
        now = time.monotonic()
        if self._breaker is None:
            return now >= min(self._until, self._cap.at)
        if now - self._heard > SUSPECT_S:
            self._breaker.suspect()
        return now >= min(self._until, self._cap.at) or self._breaker.open


waiting: ContextVar[Wait | None] = ContextVar("waiting", default=None)
"""Of the transaction that is open."""


def current() -> Wait:
    """The wait of the open transaction; a new one outside of any."""
    return waiting.get() or Wait(Cap())
