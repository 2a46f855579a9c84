"""The controller slot of a live twin: a controller with the deadline of the speed, and logic for when it is late."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from api.twins.schemas import MAX, Speed
from controllers import DeadlineController, create
from controllers.registry import FALLBACK
from controllers.slot import DEADLINE_MAX
from station import Controller, StationError
from station.kernels import CLOSED_CONTROLLER
from station.live import SlotState
from station.parameters import Station
from station.simulation import liveness_of, wake_of

DIRECT_S = 0.1
"""A controller that decides in `bounded_time` is asked without a shorter deadline than this [s]."""


class ControllerSlot:
    """The controller in a twin's slot, what stands in for it, and what they remember.

    Only the twin's thread uses it.
    """

    state: SlotState

    def __init__(self, create_controller: Callable[[str], Controller], station: Station) -> None:
        self._create = create_controller
        self._station = station  # as controllers are told it
        self._actor: Any = None  # the controller
        self._late: Any = None  # logic, for when it is late
        self._asked: Any = None  # the controller with its deadline

    def take(self, controller: str, speed: Speed) -> None:
        """Put a controller in the slot; raises what it raises, and then the one before stays."""
        actor: Any = self._create(controller)
        actor.start(self._station)
        behind = CLOSED_CONTROLLER
        shield = getattr(actor, "fallback", None)
        if shield is not None:
            shield.start(self._station)
            behind = shield.compiled()
        late: Any = create(FALLBACK)
        late.start(self._station)
        self._actor, self._late = actor, late
        asked = self._timed(speed)
        live = liveness_of(actor, self._station)
        self.state = SlotState(asked.decide, bool(actor.obeys_hold), wake_of(actor), behind, live)
        self._use(asked)

    def set_deadline(self, speed: Speed) -> None:
        """Ask with the deadline of another speed."""
        asked = self._timed(speed)
        self.state = self.state._replace(decide=asked.decide)
        self._use(asked)

    def _timed(self, speed: Speed) -> Any:
        """The controller with the deadline of a speed.

        One whose decisions are sure to come soon is asked directly where the deadline would be so short that the wait
        for another thread decides who meets it; a tick that takes longer is late instead.
        """
        seconds = DEADLINE_MAX if speed == MAX else min(DEADLINE_MAX, 1.0 / float(speed))
        soon = getattr(self._actor, "bounded_time", False)
        if soon and (speed == MAX or seconds < DIRECT_S or self._actor.name == FALLBACK):
            return self._actor
        deadline = DeadlineController(self._actor, seconds)
        deadline.fallback = self._late
        return deadline

    def _use(self, asked: Any) -> None:
        self.close()
        self._asked = asked

    def memories(self) -> dict[str, np.ndarray]:
        """Memories of the controller and its stand-ins, by name."""
        found = {"fallback": self.state.fallback.memory, "late": self._late.memory}
        memory = getattr(self._actor, "memory", None)
        return found if memory is None else {**found, "controller": memory}

    def remember(self, memories: dict[str, np.ndarray]) -> bool:
        """Take up what `memories` said once, where it still fits; whether the controller's did."""
        fallback, late = memories.get("fallback"), memories.get("late")
        if fallback is not None and fallback.shape == self.state.fallback.memory.shape:
            self.state.fallback.memory[:] = fallback
        if late is not None and late.shape == self._late.memory.shape:
            self._late.memory = late
        if "controller" not in memories or getattr(self._actor, "memory", None) is None:
            return False
        try:
            self._actor.memory = memories["controller"]
        except StationError:
            return False
        return True

    def close(self) -> None:
        """Ask nobody any more."""
        if isinstance(self._asked, DeadlineController):
            self._asked.close()
