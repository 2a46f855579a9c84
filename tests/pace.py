"""A referee for limits of time: how much slower than a usual machine this one is at the moment."""

from __future__ import annotations

from time import thread_time

USUAL_S = 0.008
"""CPU time of `_work` on a usual machine, a core of some 3 GHz [s]."""

TRIES = 5


def _work() -> int:
    return sum(n * n % 7 for n in range(200_000))


def _took() -> float:
    began = thread_time()
    _work()
    return thread_time() - began


def slowness() -> float:
    """By what a limit of time that holds on a usual machine is multiplied here; at least 1."""
    return max(1.0, min(_took() for _ in range(TRIES)) / USUAL_S)
