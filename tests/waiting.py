"""Waiting for what comes by itself."""

from __future__ import annotations

import asyncio
import time
from concurrent.futures import ThreadPoolExecutor


def wait_until(condition, seconds=180.0):
    """Return as soon as a condition holds; an AssertionError if not in that time, however slow the machine."""
    until = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < until
        time.sleep(0.01)


def awaited(coroutine):
    """What a coroutine comes to, in a thread of its own: Playwright keeps a loop running in that of the tests."""
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(asyncio.run, coroutine).result()
