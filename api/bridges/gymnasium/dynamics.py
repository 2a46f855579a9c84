"""The compiled runs behind an environment, its spaces, and its reward."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Discrete
from numpy.typing import NDArray

from controllers import create
from controllers.registry import FALLBACK
from station import InputError, Scenario
from station.kernels import CLOSED_CONTROLLER
from station.simulation import liveness_of
from station.valves import commands
from station.vector_kernels import COSTS, ENERGY, OBSERVED
from station.vector_run import VectorRun

WEIGHTS: Mapping[str, float] = {"waiting": 1.0, "compressor": 1.0, "dispensing": 0.5}
"""The reward, where nobody asks for another: minus the sum of cost components times these [1/s].

A compressor-second counts twice a dispensing second, the 2:1 of Sec. 7.3, and as much as a vehicle-second of waiting.
"""


def observation_space() -> Box[np.float32]:
    """The space of an observation: `station.vector_kernels.OBSERVED` with its bounds."""
    bounds = [(low, high) for _, low, high in OBSERVED.values()]
    low, high = np.array(bounds, np.float32).T.copy()
    return Box(low, high, dtype=np.float32)


def action_space(scenario: Scenario) -> Discrete[np.int64]:
    """The space of actions: places among the commands of the station, 13 with one compressor, 19 with two, else 20."""
    return Discrete(len(commands(scenario.station.compressor.count)))


def is_whole(given: Any) -> bool:
    """Whether an action, or a batch of them, is of whole numbers: 1.5 and NaN are no command's place."""
    return isinstance(given, int | np.integer) or bool(np.issubdtype(np.asarray(given).dtype, np.integer))


class Dynamics:
    """Runs of a scenario as an environment steps them.

    Raises
    ------
    InputError
        if the reward weighs what is no cost component, or energy that nobody knows; or as VectorRun does.
    """

    def __init__(
        self, scenario: Scenario, number: int, *, shield: bool, weights: Mapping[str, float] | None, keeping: bool
    ) -> None:
        given = WEIGHTS if weights is None else weights
        if not isinstance(shield, bool | np.bool_):
            raise InputError("environment", [("shield", f"must be true or false; given {shield!r}")])
        fallback, liveness = CLOSED_CONTROLLER, math.inf
        if shield:
            rule = create(FALLBACK)
            rule.start(scenario.known_station)
            fallback, liveness = rule.compiled(), liveness_of(None, scenario.station)
        self.run = VectorRun(scenario, number, shielded=shield, fallback=fallback, liveness=liveness, keeping=keeping)
        self._weights = _vector(given, known=self.run.knows_energy)
        self.names = [name for name in COSTS if name != "energy" or self.run.knows_energy]
        self.places = [list(COSTS).index(name) for name in self.names]

    def step(self, actions: NDArray[np.int64], active: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Step the active runs, show the next second of all, and give their rewards, (number,)."""
        run = self.run
        run.apply(run.commands[actions], active)
        run.begin()
        if not run.knows_energy:
            run.costs[:, ENERGY] = 0.0
        return -(run.costs @ self._weights)


def _finite(value: object) -> bool:
    """Whether a weight is a number that a reward can be made of."""
    return isinstance(value, int | float | np.number) and not isinstance(value, bool) and math.isfinite(value)


def _vector(weights: Mapping[str, float], *, known: bool) -> NDArray[np.float64]:
    """Weights in the order of COSTS."""
    wrong = [(name, f"is no cost component; there are {', '.join(COSTS)}") for name in weights if name not in COSTS]
    wrong += [
        (name, f"must be a finite number; given {value!r}") for name, value in weights.items() if not _finite(value)
    ]
    if weights.get("energy") and not known:
        wrong.append(("energy", "cannot be weighed: the station says no compressor.power_kw and precooler.power_kw"))
    if wrong:
        raise InputError("weights", wrong)
    return np.array([float(weights.get(name, 0.0)) for name in COSTS])
