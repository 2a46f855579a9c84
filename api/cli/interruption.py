"""The end of a command that goes on until somebody interrupts it."""

from __future__ import annotations

import signal
import threading
from types import FrameType


def interruption() -> threading.Event:
    """An event that SIGINT or SIGTERM sets from now on."""
    ending = threading.Event()

    def end(_number: int, _frame: FrameType | None) -> None:
        ending.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, end)
    return ending
