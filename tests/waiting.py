"""Waiting for what comes by itself."""

from __future__ import annotations

import time


def wait_until(condition, seconds=60.0):
    """Return as soon as a condition holds; an AssertionError if it does not in that time."""
    until = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < until
        time.sleep(0.01)
