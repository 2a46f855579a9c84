"""How much of its work the computation of a chunk has done, told to whoever runs it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

EVERY_S = 0.5
"""The store is told at most this often [s]."""

Reporter = Callable[[float], None]
"""Takes the part that is done, 0 to 1; may raise where nobody wants the result any more."""

_reporter: ContextVar[Reporter | None] = ContextVar("reporter", default=None)


def report(done: int, total: int) -> None:
    """Tell how much is done; on a cluster, whose workers know no store, nobody hears it."""
    to = _reporter.get()
    if to is not None and total > 0:
        to(done / total)


@contextmanager
def reporting(to: Reporter) -> Iterator[None]:
    """Let `to` hear what the block reports, now and then."""
    told_at = -EVERY_S

    def told(part: float) -> None:
        nonlocal told_at
        now = time.monotonic()
        if now - told_at >= EVERY_S:
            told_at = now
            to(part)

    token = _reporter.set(told)
    try:
        yield
    finally:
        _reporter.reset(token)
