"""The end of the process: what does not close in time is ended, and so is every process it has started."""

from __future__ import annotations

import faulthandler
import logging
import os
import signal
import sys
import threading
from contextlib import suppress
from pathlib import Path

log = logging.getLogger(__name__)

CLOSE_MAX_S = 8.0
"""Everything must be closed so long after SIGTERM; the process ends then, with status 1 [s]."""

END_MAX_S = 9.5
"""The process is gone then, even if it holds the interpreter [s]."""

LEAVE_S = 1.2
"""Once everything is closed, threads that still compute are left behind after so long [s]."""


class Ending:
    """A bound on how long the process takes to end."""

    def __init__(self) -> None:
        self._begun = False

    def begin(self) -> None:
        """Count from now on; again, it changes nothing."""
        if not self._begun:
            self._begun = True
            with suppress(OSError, ValueError, AttributeError):  # stderr is no file
                faulthandler.dump_traceback_later(END_MAX_S, exit=True)  # from a thread that needs no interpreter
            _later(CLOSE_MAX_S, 1)

    def closed(self) -> None:
        """All that matters is stored, and everything is closed."""
        _later(LEAVE_S, 0)


def _later(seconds: float, status: int) -> None:
    timer = threading.Timer(seconds, _end, (status,))
    timer.daemon = True
    timer.start()


def _end(status: int) -> None:
    if status:
        log.error("not everything was closed within %g s: the service ends all the same", CLOSE_MAX_S)
    for child in descendants(os.getpid()):
        with suppress(ProcessLookupError):
            os.kill(child, signal.SIGKILL)
    with suppress(OSError, ValueError):
        sys.stdout.flush()
    os._exit(status)


def descendants(process: int) -> list[int]:
    """Processes that this one has started, and theirs; empty where there is no /proc."""
    found: list[int] = []
    for listed in Path(f"/proc/{process}/task").glob("*/children"):
        with suppress(OSError):  # a thread that has just ended
            for child in map(int, listed.read_text().split()):
                found += [child, *descendants(child)]
    return found
