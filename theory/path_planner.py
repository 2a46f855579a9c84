"""Algorithm 2: scenario predictive control among obstacles, over all candidate paths, and the closed loop with it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from theory.boxes import Boxes, free_boxes
from theory.errors import IllPosedError, InfeasibleError
from theory.scenario_bounds import Bound, by_count, by_tail, judged
from theory.scenario_program import Found, ScenarioProgram, search, search_softened
from theory.stochastic import Samples, Uncertain
from theory.system import Array

KEPT = 1e-6
"""Limits exceeded by less are kept."""

SAME = 1e-7
"""Inputs that differ by less are the same decision."""


@dataclass(frozen=True)
class Mission:
    """Where to go, through what, and how carefully. Positions are the first d coordinates of the state."""

    system: Uncertain
    goal: Array
    """z_d, n."""
    Q: Array  # n x n
    R: Array  # m x m
    state_limits: Boxes
    """One box of n coordinates; its first d are the map."""
    input_limits: Boxes
    obstacles: Boxes
    """In d coordinates; `boxes.cover` makes them of polygons."""
    safe_distance: float
    """d_s, to be kept from every obstacle with the probability that the samples give."""
    perception: float
    """d_p: obstacles farther away are not seen."""
    horizon: int = 3
    scenarios: int = 19
    between_samples: bool = False
    """Whether the line between successive samples, too, must keep the distance: both must share a free box."""
    removed: int = 0
    """Scenarios given up, those that cost most (Remark 6.5)."""
    reached: float = 5.0
    """How close to the goal is there."""

    def __post_init__(self) -> None:
        n, m, d = self.system.states, self.system.inputs, self.obstacles.dimension
        for name, shape, wanted in (
            ("goal", np.shape(self.goal), (n,)), ("Q", np.shape(self.Q), (n, n)), ("R", np.shape(self.R), (m, m)),
            ("state_limits", self.state_limits.low.shape, (1, n)),
            ("input_limits", self.input_limits.low.shape, (1, m)),
        ):  # fmt: skip
            if shape != wanted:
                raise IllPosedError(name, f"must have the shape {wanted}, given {shape}")
        if not 1 <= d <= n:
            raise IllPosedError("obstacles", f"must have 1 to {n} coordinates, given {d}")
        if np.linalg.eigvalsh(self.Q).min() < -1e-12 or np.linalg.eigvalsh(self.R).min() <= 0:
            raise IllPosedError("Q, R", "Q must not have a negative eigenvalue, and R only positive ones")
        for name, value, low, high in (
            ("safe_distance", self.safe_distance, 0, 1e9), ("perception", self.perception, 0, 1e9),
            ("horizon", self.horizon, 1, 50), ("scenarios", self.scenarios, 1, 10_000),
            ("removed", self.removed, 0, self.scenarios - 1), ("reached", self.reached, 0, 1e9),
        ):  # fmt: skip
            if not low <= value <= high:
                raise IllPosedError(name, f"must lie between {low} and {high}, given {value}")
        place = np.asarray(self.goal, float)[:d]
        if not self.room.containing(place[None])[0]:
            raise IllPosedError("goal", f"{place.tolist()} lies outside the map: move it, or widen the state limits")
        near = np.flatnonzero(self.obstacles.grown(self.safe_distance).inside(place))
        if len(near):
            raise IllPosedError(
                "goal", f"{place.tolist()} lies within the safe distance of obstacle {near[0] + 1}: move it away"
            )

    @property
    def room(self) -> Boxes:
        """The map."""
        d = self.obstacles.dimension
        return Boxes(self.state_limits.low[:, :d], self.state_limits.high[:, :d])

    @cached_property
    def grown(self) -> Boxes:
        """Obstacles with their safe distance."""
        return self.obstacles.grown(self.safe_distance)

    def check_start(self, state: Array) -> None:
        """Raise `IllPosedError` for a start outside the limits or inside an obstacle."""
        if np.shape(state) != (self.system.states,):
            raise IllPosedError("start", f"must have {self.system.states} entries, given {np.shape(state)}")
        if not self.state_limits.containing(np.asarray(state)[None])[0]:
            raise IllPosedError("start", f"{np.asarray(state).tolist()} breaks the state limits: move it inside")
        place = np.asarray(state)[: self.obstacles.dimension]
        hit = np.flatnonzero(self.obstacles.inside(place))
        if len(hit):
            raise IllPosedError("start", f"{place.tolist()} lies inside obstacle {hit[0] + 1}: move it out")


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
    slack: float
    """0, or by how much limits had to give way in total: the samples allowed no path (Remark 6.3 is false)."""
    sensed: tuple[int, ...]
    """Obstacles in sight, counted from 0."""
    bounds: tuple[Bound, ...]
    """What is proved of the next state's violation; nothing where limits gave way."""
    given_up: tuple[int, ...] = ()
    """Scenarios removed."""
    samples: Samples | None = field(default=None, repr=False)

    @property
    def softened(self) -> bool:
        """Whether limits had to give way."""
        return self.slack > 0


class PathPlanner:
    """Algorithm 2 with one set of samples for all paths and an exact search over the paths."""

    def __init__(self, mission: Mission, seed: int | np.random.SeedSequence = 0) -> None:
        self.mission = mission
        self._rng = np.random.default_rng(seed)

    def decide(self, state: Array, samples: Samples | None = None) -> Step:
        """The input at a state. Samples are drawn unless given."""
        mission, state = self.mission, np.asarray(state, float)
        drawn = samples or mission.system.draw(self._rng, mission.scenarios, mission.horizon)
        sensed, free = self._free(state)
        given_up: tuple[int, ...] = ()
        slack = 0.0
        try:
            found = self._search(state, free, drawn)
            for _ in range(mission.removed):
                worse = self._without_worst(state, free, drawn, given_up, found)
                if worse is None:
                    break
                found, given_up = worse
        except InfeasibleError:
            found, slack = search_softened(self._program(state, drawn), free, self._start(state, free))
        paths = float(len(free)) ** mission.horizon
        bounds = (
            ()
            if slack
            else tuple(self._bounds(paths, drawn, given_up, found, state, free.only(np.array(found.path[:1]))))
        )
        return Step(
            state,
            found.solved.inputs[0],
            found.solved.inputs,
            found.solved.cost,
            free.only(np.array(found.path)),
            paths,
            found.nodes,
            slack,
            sensed,
            bounds,
            given_up,
            drawn,
        )

    def judge(self, step: Step, doubt: float = 0.05) -> Bound | None:
        """The a-posteriori bound: leave out scenarios one after the other as long as the decision stays the same.

        Those left decide. None for a softened step, or one that gave up scenarios.
        """
        if step.softened or step.given_up or step.samples is None:
            return None
        _, free = self._free(step.state)
        kept = list(range(len(step.samples)))
        for s in range(len(step.samples)):
            fewer = [other for other in kept if other != s]
            if (
                fewer
                and np.abs(self._search(step.state, free, step.samples.only(fewer)).solved.inputs - step.inputs).max()
                <= SAME
            ):
                kept = fewer
        return judged(len(kept), len(step.samples), doubt)

    def _free(self, state: Array) -> tuple[tuple[int, ...], Boxes]:
        mission = self.mission
        place = state[: mission.obstacles.dimension]
        sensed = np.flatnonzero(mission.obstacles.distances(place) <= mission.perception)
        return tuple(int(o) for o in sensed), free_boxes(mission.room, mission.grown.only(sensed))

    def _program(self, state: Array, samples: Samples) -> ScenarioProgram:
        mission = self.mission
        return ScenarioProgram(
            samples,
            state,
            np.asarray(mission.goal, float),
            mission.Q,
            mission.R,
            mission.state_limits,
            mission.input_limits,
        )

    def _start(self, state: Array, free: Boxes) -> Array | None:
        """The position, if the line from it is to be kept free, and noise has not carried it too near already."""
        place = state[: free.dimension]
        return place if self.mission.between_samples and free.containing(place[None]).any() else None

    def _search(self, state: Array, free: Boxes, samples: Samples) -> Found:
        return search(self._program(state, samples), free, self._start(state, free))

    def _without_worst(
        self, state: Array, free: Boxes, drawn: Samples, given_up: tuple[int, ...], found: Found
    ) -> tuple[Found, tuple[int, ...]] | None:
        """Greedy removal: of the scenarios that decide, the one whose loss lowers the cost most; or None."""
        kept = [s for s in range(len(drawn)) if s not in given_up]
        best: tuple[Found, tuple[int, ...]] | None = None
        for position in sorted(found.solved.deciding):
            gone = (*given_up, kept[position])
            trial = self._search(state, free, drawn.only([s for s in range(len(drawn)) if s not in gone]))
            if best is None or trial.solved.cost < best[0].solved.cost:
                best = trial, gone
        return best

    def _bounds(
        self, paths: float, drawn: Samples, given_up: tuple[int, ...], found: Found, state: Array, box: Boxes
    ) -> Iterator[Bound]:
        """Bounds from the counts. With removal only if the decision breaks the limits of each one removed at once."""
        mission, scenarios, rank = self.mission, len(drawn), self.mission.system.inputs
        if not given_up:
            yield by_count(paths, scenarios, rank)
            yield by_tail(paths, scenarios, rank)
            return
        removed = drawn.only(list(given_up))
        following = removed.A[:, 0] @ state + removed.B[:, 0] @ found.solved.inputs[0] + removed.w[:, 0]
        allowed = mission.state_limits.containing
        kept = [
            bool(box.containing(after[None, : box.dimension])[0] and allowed(after[None])[0]) for after in following
        ]
        if not any(kept):
            yield by_tail(paths, scenarios, rank, len(given_up))


@dataclass(frozen=True)
class Drive:
    """A closed loop from start to goal, or until the steps ran out."""

    mission: Mission
    states: Array
    steps: list[Step]

    @property
    def positions(self) -> Array:
        """T + 1 x d."""
        return self.states[:, : self.mission.obstacles.dimension]

    @property
    def arrived(self) -> bool:
        """Whether the goal was reached."""
        goal = np.asarray(self.mission.goal)[: self.mission.obstacles.dimension]
        return bool(np.linalg.norm(self.positions[-1] - goal) <= self.mission.reached)

    @property
    def lost(self) -> bool:
        """Whether the run ended because the position was outside the map by more than the map's extent."""
        return _lost(self.mission, self.positions[-1])

    @property
    def kept(self) -> list[bool]:
        """For every step, whether the state it led to keeps limits and safe distance."""
        limits, grown = self.mission.state_limits, self.mission.grown
        return [
            bool(limits.containing(state[None], KEPT)[0]) and not grown.inside(place, KEPT).any()
            for state, place in zip(self.states[1:], self.positions[1:], strict=True)
        ]

    @property
    def near(self) -> list[bool]:
        """For every step, whether an obstacle was in sight."""
        return [bool(step.sensed) for step in self.steps]

    def cuts(self, *, safe: bool = False) -> list[int]:
        """Steps whose straight line passes through an obstacle (`safe`: or its safe distance)."""
        boxes = self.mission.grown if safe else self.mission.obstacles
        pairs = zip(self.positions[:-1], self.positions[1:], strict=True)
        return [i for i, (before, after) in enumerate(pairs) if boxes.cut_by(before, after, KEPT).any()]


def drive(mission: Mission, start: Array, seed: int, steps: int = 100) -> Drive:
    """Steer the system itself, one draw a step, with the planner's samples independent of it.

    Raises `IllPosedError` for a start outside the limits or inside an obstacle.
    """
    state = np.asarray(start, float)
    mission.check_start(state)
    ours, its = np.random.SeedSequence(seed).spawn(2)
    planner, rng = PathPlanner(mission, ours), np.random.default_rng(its)
    states, taken = [state], []
    for _ in range(steps):
        step = planner.decide(state)
        drawn = mission.system.draw(rng, 1, 1)
        state = drawn.A[0, 0] @ state + drawn.B[0, 0] @ step.input + drawn.w[0, 0]
        states.append(state)
        taken.append(step)
        if np.linalg.norm((state - mission.goal)[: mission.obstacles.dimension]) <= mission.reached:
            break
        if _lost(mission, state[: mission.obstacles.dimension]):
            break
    return Drive(mission, np.array(states), taken)


def _lost(mission: Mission, place: Array) -> bool:
    extent = float((mission.room.high - mission.room.low).max())
    return bool(mission.room.distances(place)[0] > extent)
