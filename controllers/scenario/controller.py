"""The scenario controller: plans as `switched` does, over a small tree, and looks for shortages in futures it draws."""

from __future__ import annotations

import numpy as np

from controllers.estimate import use_station_prediction
from controllers.scenario.futures import BELIEF_SIZE, Futures, belief_of, branch_of, draw, watch
from controllers.scenario.settings import OWN, QUANTILES, ScenarioSettings, numbers_of, scenario_vector
from controllers.scenario.tree import LATE, TYPICAL, Tree, falls_short, grow
from controllers.switched.controller import (
    EXPECTED,
    MEMORY_SIZE,
    Switched,
    carry_on,
    look,
    note_plan,
    note_sequence,
    task_of,
    told_bound,
)
from controllers.switched.parts import SIZE, Task
from controllers.switched.settings import BLOCKS_MAX
from controllers.switched.vector import first_gap_of
from station.compiled import callback, kernel
from station.control_model import ControlModel, as_thesis, is_thesis
from station.controller import DECIDE, CompiledController, Decision, Observation
from station.planning import Model

STARTS = 24
"""Vehicles of a future with start pressures of their own: more than can be connected in a plan."""

# Parts of the memory: that of `switched`, the belief, the count of numbers drawn, the candidate taken: whether it was
# covered, how many have been taken, the place of the first arrival not announced, when branches see theirs, the state
# it starts from, its commands.
_BELIEF = MEMORY_SIZE
_PLACE = _BELIEF + BELIEF_SIZE
_COVERED, DECISIONS, _UNKNOWN, _SEEN = range(_PLACE + 1, _PLACE + 5)
_START = _SEEN + 3
_COMMANDS = _START + SIZE
SCENARIO_SIZE = _COMMANDS + 3 * BLOCKS_MAX
"""Entries of memory `decide_by_tree` uses; DECISIONS of them counts the candidates taken."""


@kernel
def choose(
    tree: Tree, start: np.ndarray, task: Task, futures: Futures, first_unknown: int, window: int, margin: float
) -> tuple[int, bool]:
    """The cheapest candidate without a shortage in any future, and whether there is one; else the cheapest.

    One that costs more than `margin` above the cheapest [s of compressor] is none. Neither that nor the order of
    candidates depends on the futures.
    """
    order = np.argsort(tree.cost)
    for candidate in order:
        if tree.cost[candidate] > tree.cost[order[0]] + margin:
            break
        future = 0
        while future < futures.due.shape[0] and not falls_short(
            tree, candidate, start, task, futures.due[future], first_unknown, futures.pressure[future], window
        ):
            future += 1
        if future == futures.due.shape[0]:
            return candidate, True
    return order[0], False


@kernel
def _note_policy(
    tree: Tree, taken: int, covered: bool, start: np.ndarray, first_unknown: int, memory: np.ndarray
) -> None:
    """Keep the candidate taken: whoever wants can follow it."""
    memory[_COVERED] = 1.0 if covered else 0.0
    memory[DECISIONS] += 1.0
    memory[_UNKNOWN] = first_unknown
    memory[_SEEN:_START] = tree.seen
    memory[_START:_COMMANDS] = start
    blocks = tree.commands.shape[2]
    for branch in range(3):
        place = _COMMANDS + branch * blocks
        memory[place : place + blocks] = tree.commands[taken, branch]


@kernel
def decide_by_tree(observation: Observation, model: Model, settings: np.ndarray, memory: np.ndarray) -> Decision:
    """The first command of the candidate in force; a new one where something has happened."""
    numbers, vector, own = numbers_of(settings), settings[OWN:], memory[:MEMORY_SIZE]
    seen = look(observation, model, model, vector, own)
    watch(observation, memory[_BELIEF:_PLACE])
    if seen.happened:
        branches = np.empty((3, EXPECTED))
        task = task_of(observation, model, vector, own, branches[LATE])
        belief = belief_of(
            observation, first_gap_of(vector), task.demand.next_pressure, numbers.spread, memory[_BELIEF:_PLACE]
        )
        for branch in range(3):
            branch_of(observation, belief, QUANTILES[branch], branches[branch])
        tree = grow(
            seen.start, seen.bound, seen.allowed, task, branches, belief.announced, (numbers.trunk, numbers.branch),
            numbers.candidates,
        )  # fmt: skip
        place = int(memory[_PLACE])
        futures, memory[_PLACE] = draw(observation, belief, numbers.futures, EXPECTED, STARTS, numbers.seed, place)
        taken, covered = choose(tree, seen.start, task, futures, belief.announced, numbers.window, numbers.margin)
        _note_policy(tree, taken, covered, seen.start, belief.announced, memory)
        bound = told_bound(seen.start, task, vector)  # for the latest arrivals: the least of the branches' bounds
        trunk = tree.commands[taken, TYPICAL]
        note_plan(observation.time, trunk[0], tree.cost[taken], bound, own)
        note_sequence(trunk, observation.time + branches[TYPICAL, 0], own)
    return carry_on(observation, seen.allowed, own)


@callback(DECIDE, counted=False)
def decide_scenario(
    observation: Observation, model: ControlModel, settings: np.ndarray, memory: np.ndarray
) -> Decision:
    """Decision as the compiled loop calls it."""
    if is_thesis(model):
        return decide_by_tree(observation, as_thesis(model), settings, memory)
    return decide_by_tree(observation, model, settings, memory)


class Scenario(Switched):
    """Plans as `switched` does for a typical arrival, with branches for an early and a late one.

    Chapter 6's idea: futures shared by all candidates, feedback through a small tree, and a bound on the chance of a
    shortage by their count. A candidate is a first command and what follows it on each branch.
    """

    name = "scenario"
    about = "switched with a tree of arrivals: takes the cheapest candidate without a shortage in the futures it draws"
    settings_type = ScenarioSettings

    def compiled(self) -> CompiledController:
        """This controller for the compiled loop, with fresh memory."""
        settings: ScenarioSettings = self.settings_for(self.station)
        memory = use_station_prediction(self.station, np.zeros(SCENARIO_SIZE))
        vector = scenario_vector(settings, self.station)
        return CompiledController(decide_scenario, self.station.control_constants(), vector, memory, self.obeys_hold)

    @property
    def decisions(self) -> int:
        """How many candidates have been taken since the start."""
        return 0 if self.memory is None else int(self.memory[DECISIONS])

    @property
    def covered(self) -> bool:
        """Whether the candidate in force had no shortage in any of its futures: `ScenarioSettings.chance` is for it."""
        return self.memory is not None and was_covered(self.memory)

    def falls_short(self, observation: Observation, due: np.ndarray, pressure: np.ndarray) -> bool:
        """Whether the candidate taken at an observation has a shortage in a future within its window.

        `due` (EXPECTED,) says in how many seconds vehicles come, `pressure` (STARTS,) with how much gas those connected
        next start [bar].
        """
        ready = self._ready
        if ready is None or not self.decisions:
            return False
        return taken_falls_short(ready, ready.memory, observation, due, pressure)


def was_covered(memory: np.ndarray) -> bool:
    """Whether the candidate in force, by a `Scenario.memory`, had no shortage in any of its futures."""
    return bool(memory[_COVERED] == 1.0)


def taken_falls_short(
    ready: CompiledController, memory: np.ndarray, observation: Observation, due: np.ndarray, pressure: np.ndarray
) -> bool:
    """`Scenario.falls_short` of the candidate in a memory; of the observation only vehicle and queue are looked at."""
    numbers = numbers_of(ready.settings)
    task = task_of(observation, ready.model, ready.settings[OWN:], memory[:MEMORY_SIZE], due)
    blocks = task.blocks.size
    commands = memory[_COMMANDS : _COMMANDS + 3 * blocks].astype(np.int64).reshape((1, 3, blocks))
    tree = Tree(commands, memory[_SEEN:_START].astype(np.int64), np.zeros(1))
    start, unknown = memory[_START:_COMMANDS].copy(), int(memory[_UNKNOWN])
    return bool(falls_short(tree, 0, start, task, due, unknown, pressure, numbers.window))
