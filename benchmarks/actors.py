"""Two controllers for measuring: one asks another from Python each second, one repeats recorded commands."""

from __future__ import annotations

from typing import Any

import numpy as np

from station import Decision, Observation, Record, Station
from station.compiled import callback
from station.control_model import ControlModel
from station.controller import DECIDE, CompiledController
from station.geometry import VALVES


class SecondBySecond:
    """Another controller as a plug-in: called from Python each second, and keeping what it saw."""

    def __init__(self, inner: Any) -> None:
        self.name: str = inner.name
        self.obeys_hold: bool = inner.obeys_hold
        self.fallback = inner.fallback
        self.seen: list[Observation] = []
        self._inner = inner

    @property
    def liveness_s(self) -> float | None:
        """That of the other controller [s]."""
        found: float | None = self._inner.liveness_s
        return found

    def start(self, station: Station) -> None:
        """Prepare the other controller."""
        self._inner.start(station)
        self.seen = []

    def decide(self, observation: Observation) -> Decision:
        """The other controller's decision."""
        self.seen.append(observation)
        decision: Decision = self._inner.decide(observation)
        return decision


@callback(DECIDE)
def _next_recorded(
    _observation: Observation, _model: ControlModel, settings: np.ndarray, memory: np.ndarray
) -> Decision:
    """The next recorded command; memory[0] counts them."""
    step = int(memory[0])
    memory[0] = step + 1
    return Decision(int(settings[step]), 0, np.nan, np.nan)


class Replay:
    """Repeats the commands of a record, so that a run takes the same way without deciding anything."""

    name = "replay"

    def __init__(self, record: Record, obeys_hold: bool) -> None:
        self.obeys_hold = obeys_hold
        bits = [record[valve].astype(np.float64) * 2.0**bit for bit, valve in enumerate(VALVES)]
        self.commands: np.ndarray = np.asarray(np.sum(bits, axis=0))

    def start(self, station: Station) -> None:
        """Begin at the first command."""
        self._plant = station.control_constants()

    def decide(self, observation: Observation) -> Decision:
        """Unused: a replay runs in the compiled loop."""
        raise NotImplementedError("a replay runs in the compiled loop")

    def compiled(self) -> CompiledController:
        """This controller for the compiled loop, at the first command."""
        return CompiledController(_next_recorded, self._plant, self.commands, np.zeros(1), self.obeys_hold)
