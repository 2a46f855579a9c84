"""A referee for tests of lateness: for how long the machine itself keeps a thread waiting that could run."""

from __future__ import annotations

import threading
import time

NAP_S = 0.005

LONG_S = 0.02
"""Pauses from this on are added up: shorter ones any queue outlives [s]."""


class Stalls:
    """Naps again and again while it is entered, and notes by how much each was longer than asked.

    Attributes
    ----------
    worst
        the longest pause [s].
    total
        all pauses of LONG_S or more together [s].
    """

    def __init__(self) -> None:
        self.worst = self.total = 0.0
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._nap)

    def _nap(self) -> None:
        while not self._over.is_set():
            began = time.perf_counter()
            time.sleep(NAP_S)
            pause = time.perf_counter() - began - NAP_S
            self.worst = max(self.worst, pause)
            self.total += pause if pause >= LONG_S else 0.0

    def __enter__(self) -> Stalls:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()
