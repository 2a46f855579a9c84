"""A twin whose seconds come by the clock, at a speed that can be changed, and stand still when it is paused."""

from __future__ import annotations

import time
from abc import abstractmethod
from collections.abc import Callable
from typing import Any

from api.store.records import StoredTwin
from api.twins.live import LiveTwin
from api.twins.messages import EventKind
from api.twins.schemas import MAX, Speed, TwinRequest, TwinStateName

REBASE_S = 1.0
"""A twin that is later than this gives up catching up and goes on from now [s]."""

LATE_S = 0.1
"""A tick later than this counts as late [s]."""


class PacedTwin(LiveTwin):
    """A twin that tells a second when it is due."""

    def __init__(
        self, stored: StoredTwin, request: TwinRequest, *, on_late: Callable[[], None] = lambda: None, **kept: Any
    ) -> None:  # fmt: skip
        super().__init__(stored, request, **kept)
        self._on_late = on_late
        self.late_s = 0.0  # of the second that is told now

    @abstractmethod
    def _second(self) -> None:
        """Tell the next second."""

    # The thread.

    def _wait(self, due: float) -> float | None:
        """Seconds until the next tick; None while there is none to come."""
        if self.state is not TwinStateName.RUNNING:
            return None
        return 0.0 if self.request.speed == MAX else max(0.0, due - time.monotonic())

    def _tick(self, due: float) -> float:
        """Tell a second that was due; when the next one is [s, monotonic]."""
        now = time.monotonic()
        self.late_s = 0.0 if self.request.speed == MAX else max(0.0, now - due)
        self._second()
        self._heard = time.monotonic()
        if self.request.speed == MAX:
            while self._checkpoints.behind and self._commands.empty:
                time.sleep(0.001)
            return now
        self.lateness_max_s = max(self.lateness_max_s, self.late_s)
        if self.late_s > LATE_S:
            self.ticks_late += 1
            self._on_late()
        return now if self.late_s > REBASE_S else due + 1.0 / float(self.request.speed)

    # Commands, from other threads.

    def pause(self) -> None:
        """Stand still until `continue_`. In the twin's thread, like every command below."""
        self._check_alive()
        if self.state is TwinStateName.RUNNING:
            self._change(paused=True)
            self.state = TwinStateName.PAUSED
            self._tell(self._time, EventKind.PAUSED, {})

    def continue_(self) -> None:
        """Run again."""
        self._check_alive()
        if self.state is TwinStateName.PAUSED:
            self._change(paused=False)
            self._heard = time.monotonic()
            self.state = TwinStateName.RUNNING
            self._tell(self._time, EventKind.CONTINUED, {})

    def set_speed(self, speed: Speed) -> None:
        """Run at another speed."""
        self._check_alive()
        self._change(speed=speed)
        self._tell(self._time, EventKind.SPEED_CHANGED, {"speed": speed})
