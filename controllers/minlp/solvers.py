"""Common parts of the solvers' engines: a solver proposes valves; what counts is their cost by the plant alone."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from controllers.minlp.evaluate import begin, believe, evaluate, keep_alive, open_to
from controllers.minlp.exact import memory_vector, settings_vector
from controllers.minlp.objective import Objective
from controllers.minlp.symbolic import Stage, Tanks
from station.controller import Decision, Observation, Status
from station.errors import StationError
from station.geometry import CLOSED
from station.planning import Model

if TYPE_CHECKING:
    from controllers.minlp.settings import MinlpSettings

log = logging.getLogger(__name__)

AGREEMENT = 1e-6
"""A solver's cost and the plant's must agree to this, relative to what the valves change; SCIP keeps some 1e-9."""


class SolverError(StationError):
    """A solver gave no valves that could be used."""


class Answer(NamedTuple):
    """Answer of a solver, costs as differences from standing still at the present state [bar2]."""

    commands: list[int]
    cost: float
    bound: float
    proven: bool  # whether it claims the optimum
    seconds: float


class Solution(NamedTuple):
    """A sequence of commands with its cost on the plant."""

    commands: tuple[int, ...]  # t + 1 of them, bits of Valve
    cost: float  # Eq. (7.24) on the plant [bar2]
    bound: float  # no sequence costs less, says the solver; -inf where it says nothing [bar2]
    proven: bool  # the solver claims the optimum and the plant agrees on its cost
    solve_seconds: float  # in the solver alone


class SolverEngine:
    """Base of the engines that ask a solver; a subclass defines `optimize`."""

    name = ""

    def __init__(self, plant: Model, objective: Objective, settings: MinlpSettings) -> None:
        self.plant = plant
        self.objective = objective
        self.stages = settings.horizon + 1
        self.node_limit = settings.node_limit
        self._settings = settings_vector(
            objective, settings.horizon, settings.node_limit, settings.liveness, plant.compressor_count
        )
        self.memory = memory_vector(settings.horizon)

    def optimize(self, observation: Observation, present: Tanks, allowed: int) -> Answer:
        """The solver's answer; `allowed` are the valves that may open now, as bits of Valve.

        Raises
        ------
        SolverError
            if it has none.
        """
        raise NotImplementedError

    def decide(self, observation: Observation) -> Decision:
        """The command for this second."""
        observation = believe(observation, self.plant, self.memory)
        solution = self.solve(observation)
        status = Status.OPTIMAL if solution.proven else Status.FEASIBLE
        bound = min(solution.bound, solution.cost) if solution.bound > -np.inf else np.nan
        decision = Decision(solution.commands[0], int(status), solution.cost, bound)
        return keep_alive(decision, observation, self.plant, self._settings, self.memory)

    def solve(self, observation: Observation) -> Solution:
        """The solver's sequence for an observation whose readings are taken as live, costed on the plant.

        Where it has none all valves stay closed, and nothing is claimed of the optimum.

        Raises
        ------
        SolverError
            if a reading is no number.
        """
        observation = observation._replace(communication=True)
        masses, temperatures, pressures = begin(observation, self.plant, self.memory)
        vehicle = observation.vehicle >= 0
        tanks = 4 if vehicle else 3
        present = Tanks(masses[:tanks], temperatures[:tanks], pressures[:tanks])
        if not np.isfinite(present).all():
            raise SolverError(
                f"engine {self.name!r}: the readings at {observation.time:g} s are no numbers: {observation}"
            )
        stage = Stage(self.plant, self.objective, vehicle, observation.vehicle_volume, observation.period)
        standing = self.stages * float(stage.tank_cost(present.pressure))
        allowed = open_to(observation, self.plant, self._settings, self.memory)
        try:
            answer = self.optimize(observation, present, allowed)
        except SolverError as error:
            log.warning("%s; all stay closed", error)
            answer = Answer([CLOSED] * self.stages, np.nan, -np.inf, False, 0.0)
        commands, cost, whole = self._usable(observation, answer.commands)
        change = cost - standing
        agreed = whole and abs(answer.cost - change) <= AGREEMENT * max(1.0, abs(change))
        commands, cost = self._quiet(observation, commands, cost)
        return Solution(
            tuple(int(command) for command in commands), cost, standing + answer.bound, answer.proven and agreed,
            answer.seconds,
        )  # fmt: skip

    def _cost(self, observation: Observation, commands: np.ndarray) -> float:
        return float(evaluate(observation, self.plant, self._settings, self.memory, commands))

    def _usable(self, observation: Observation, proposed: list[int]) -> tuple[np.ndarray, float, bool]:
        """The proposed sequence without the valves that a limit forbids on the plant.

        A solver keeps a limit within its tolerance, the plant to the last digit: of the first command that is refused
        what costs least of what is not, then all closed. The flag says whether all was used.
        """
        commands = np.array(proposed, np.int64)
        cost = self._cost(observation, commands)
        for index in reversed(range(len(commands))):
            if cost < np.inf:
                return commands, cost, index == len(commands) - 1
            refused = int(commands[index])
            fewer = [part for part in range(refused) if part & ~refused == 0]
            costs = []
            for part in fewer:
                commands[index] = part
                costs.append(self._cost(observation, commands))
            best = int(np.argmin(costs)) if fewer else 0
            commands[index] = fewer[best] if fewer and costs[best] < np.inf else CLOSED
            cost = costs[best] if fewer else cost
        return commands, cost, False

    def _quiet(self, observation: Observation, commands: np.ndarray, cost: float) -> tuple[np.ndarray, float]:
        """The sequence without the inlets that gain nothing: among equal costs the compressor stays off."""
        for index in reversed(range(len(commands))):
            for inlet in (1, 2, 4):
                if commands[index] & inlet:
                    fewer = commands.copy()
                    fewer[index] &= ~inlet
                    cheaper = self._cost(observation, fewer)
                    if cheaper <= cost:
                        commands, cost = fewer, cheaper
        return commands, cost
