"""Algorithm 2: decisions among obstacles by one set of samples for all candidate paths, and their bounds."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from theory.arrays import Array
from theory.errors import IllPosedError, InfeasibleError
from theory.paths.boxes import Boxes, free_boxes
from theory.paths.mission import Mission
from theory.paths.scenario_bounds import ViolationBound, by_count, by_range, by_support, by_tail
from theory.paths.scenario_program import ScenarioProgram, SearchResult, search_paths, search_softened
from theory.paths.stochastic import ScenarioSamples, random_entries
from theory.validation import finite_array

KEPT = 1e-6
"""Limits exceeded by less are kept."""

SAME = 1e-7
"""Inputs that differ by less are the same decision."""


@dataclass(frozen=True)
class Drawn:
    """The scenarios of a decision: of the constraints at the first step, at later steps, and of the cost."""

    first: ScenarioSamples
    later: ScenarioSamples | None = None
    cost: ScenarioSamples | None = None


@dataclass(frozen=True)
class Step:
    """A decision, and how it was reached."""

    state: Array
    input: Array
    inputs: Array
    """N x m."""
    cost: float
    path: Boxes
    """The free box of every step."""
    paths: float
    """J: sequences of maximal free boxes, among which the samples choose."""
    nodes: int
    """Programs solved to find the best of them and prove it the best."""
    softened: bool
    """Whether limits were relaxed, since the samples allowed no path (Remark 6.3 is false)."""
    slack: float
    """Total relaxation of the limits."""
    sensed: tuple[int, ...]
    """Obstacles in sight, counted from 0."""
    bounds: tuple[ViolationBound, ...]
    """Bounds on the probability that the next state breaks a limit or the safe distance of an obstacle in sight.

    On the mean over the samples, a decision without a bound counted as kept; softened ones carry none.
    """
    given_up: tuple[int, ...]
    """Scenarios removed."""
    drawn: Drawn = field(repr=False)


@dataclass(frozen=True)
class _Problem:
    """The problem of a decision: a state, the boxes free of obstacles in sight, and the scenarios drawn."""

    mission: Mission
    state: Array
    sensed: tuple[int, ...]
    free: Boxes
    drawn: Drawn

    def program(self, samples: ScenarioSamples) -> ScenarioProgram:
        task = self.mission
        return ScenarioProgram(
            samples, self.state, task.goal, task.Q, task.R, task.state_limits, task.input_limits,
            later=self.drawn.later, cost=self.drawn.cost,
        )  # fmt: skip

    @property
    def start(self) -> Array | None:
        """The position, if the lines between samples are to be kept free."""
        return self.state[: self.free.dimension] if self.mission.between_samples else None

    def search(self, which: list[int]) -> SearchResult:
        """The best path for some of the scenarios; those that decide by their numbers among all."""
        filled = which + which[:1] * (len(self.drawn.first) - len(which) if self.drawn.later else 0)
        found = search_paths(self.program(self.drawn.first.only(filled)), self.free, self.start)
        deciding = frozenset(filled[position] for position in found.solved.deciding)
        return replace(found, solved=replace(found.solved, deciding=deciding))

    def given_up(self) -> tuple[SearchResult, tuple[int, ...]]:
        """The best path, after giving up the scenarios that cost most one by one (greedy removal)."""
        kept, gone = list(range(len(self.drawn.first))), []
        found = self.search(kept)
        for _ in range(self.mission.removed):
            trials = [(one, self.search([s for s in kept if s != one])) for one in sorted(found.solved.deciding)]
            if not trials:
                break
            worst, found = min(trials, key=lambda trial: trial[1].solved.cost)
            kept.remove(worst)
            gone.append(worst)
        return found, tuple(gone)


class PathPlanner:
    """Algorithm 2 with one set of samples for all paths and an exact search over the paths."""

    def __init__(self, mission: Mission, seed: int | np.random.SeedSequence = 0) -> None:
        self.mission = mission
        self._rng = np.random.default_rng(seed)

    def decide(self, state: Array, samples: ScenarioSamples | None = None) -> Step:
        """The input at a state. The futures of the constraints are drawn unless given: horizon steps each.

        Parameters
        ----------
        state
            (n,), positions first.
        samples
            Futures of the constraints, horizon steps each; drawn by default.

        Returns
        -------
        Step
            Input, predicted inputs, path, and bounds of the risk of violation.
        """
        problem = self._problem(state, samples)
        gone: tuple[int, ...] = ()
        slack, softened = 0.0, False
        try:
            found, gone = problem.given_up()
        except InfeasibleError:
            found, slack = search_softened(problem.program(problem.drawn.first), problem.free, problem.start)
            softened = True
        paths = float(len(problem.free)) ** self.mission.horizon
        bounds = () if softened else tuple(_bounds(problem, found, gone, paths))
        return Step(
            problem.state, found.solved.inputs[0], found.solved.inputs, found.solved.cost,
            problem.free.only(np.array(found.path)), paths, found.nodes, softened, slack, problem.sensed, bounds, gone,
            problem.drawn,
        )  # fmt: skip

    def a_posteriori_bound(self, step: Step, doubt: float = 0.05) -> ViolationBound | None:
        """The a-posteriori bound: leave out scenarios one after the other as long as the decision stays the same.

        Those left decide. None for a softened step, or one that gave up scenarios.
        """
        if step.softened or step.given_up:
            return None
        problem = self._seen(step.state, step.drawn)
        kept = list(range(len(step.drawn.first)))
        for s in range(len(step.drawn.first)):
            fewer = [other for other in kept if other != s]
            if fewer and np.abs(problem.search(fewer).solved.inputs - step.inputs).max() <= SAME:
                kept = fewer
        return by_support(len(kept), len(step.drawn.first), doubt)

    def _problem(self, state: Array, samples: ScenarioSamples | None) -> _Problem:
        task, system = self.mission, self.mission.system
        state = finite_array("state", state, (system.states,))
        if samples is None:
            samples = system.draw(self._rng, task.scenarios, task.horizon)
        wanted = (task.horizon, system.states, system.inputs)
        if samples.B.shape[1:] != wanted or len(samples) <= task.removed:
            raise IllPosedError(
                "samples",
                f"must be more than {task.removed} futures of (steps, n, m) = {wanted}, given {samples.B.shape}",
            )
        drawn = Drawn(samples)
        if task.apart:
            later, cost = (system.draw(self._rng, len(samples), task.horizon) for _ in range(2))
            drawn = Drawn(samples, later, cost)
        return self._seen(state, drawn)

    def _seen(self, state: Array, drawn: Drawn) -> _Problem:
        task = self.mission
        sensed = np.flatnonzero(task.obstacles.distances(state[: task.obstacles.dimension]) <= task.perception)
        free = free_boxes(task.room, task.grown.only(sensed))
        return _Problem(task, state, tuple(int(o) for o in sensed), free, drawn)


def _bounds(problem: _Problem, found: SearchResult, gone: tuple[int, ...], paths: float) -> Iterator[ViolationBound]:
    """The bounds by counts; with removal only if the decision breaks the limits of each scenario given up at once."""
    task, scenarios = problem.mission, len(problem.drawn.first)
    rank, sides = task.system.inputs, _sides(problem)
    if not gone:
        if sides is not None:
            yield by_range(sides, scenarios)
        if (
            task.apart and (counted := by_count(paths, scenarios, rank)).value < 1
        ):  # else it says nothing; the tail does
            yield counted
    if not task.apart:
        return
    removed = problem.drawn.first.only(list(gone))
    after = removed.A[:, 0] @ problem.state + removed.B[:, 0] @ found.solved.inputs[0] + removed.w[:, 0]
    box = problem.free.only(np.array(found.path[:1]))
    if not any(
        box.containing(one[None, : box.dimension])[0] and task.state_limits.containing(one[None])[0] for one in after
    ):
        yield by_tail(paths, scenarios, rank, task.removed)


def _sides(problem: _Problem) -> int | None:
    """Limits of the random entries of the next state; None if the input acts at random, or nothing is known of it."""
    random = random_entries(problem.mission.system)
    if random is None:
        return None
    limits, place = problem.mission.state_limits, np.arange(len(random)) < problem.free.dimension
    seen = place & bool(problem.sensed)
    return int(
        ((np.isfinite(limits.low[0]) | seen) & random).sum() + ((np.isfinite(limits.high[0]) | seen) & random).sum()
    )
