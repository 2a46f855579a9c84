"""The closed loop of Algorithm 2: a vehicle that decides at every sample, and its trajectory."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from theory.arrays import Array
from theory.errors import IllPosedError
from theory.paths.mission import Mission
from theory.paths.planner import KEPT, PathPlanner, Step


@dataclass(frozen=True)
class Trajectory:
    """A closed loop from start to goal, or until the steps ran out."""

    mission: Mission
    states: Array
    steps: list[Step]
    path_exists: bool = True
    """Whether any path leads from the start to the goal outside all safe distances."""

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


def simulate_mission(mission: Mission, start: Array, seed: int, steps: int = 100) -> Trajectory:
    """Steer the system itself, one draw a step, with the planner's samples independent of it.

    Raises `IllPosedError` for a start outside the limits or inside an obstacle.

    Parameters
    ----------
    mission
        Goal, limits and obstacles.
    start
        z_0, n.
    seed
        Of the planner's samples and of the system's own draws, which are independent.
    steps
        Samples after which the run ends, if the goal is not reached before.
    """
    mission.check_start(start)
    if steps < 1 or seed < 0:
        raise IllPosedError("steps, seed", f"must be at least 1 and 0, given {steps} and {seed}")
    state = np.asarray(start, float)
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
    return Trajectory(mission, np.array(states), taken, mission.path_exists(start))


def _lost(mission: Mission, place: Array) -> bool:
    extent = float((mission.room.high - mission.room.low).max())
    return bool(mission.room.distances(place)[0] > extent)
