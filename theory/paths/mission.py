"""A mission among obstacles: goal, limits, obstacles, and the probability of keeping a distance."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from theory.arrays import Array
from theory.errors import IllPosedError
from theory.paths.boxes import Boxes, free_boxes
from theory.paths.stochastic import Uncertain
from theory.validation import check_integer, check_weights, finite_array


@dataclass(frozen=True)
class Mission:
    """Positions are the first d coordinates of the state. A field that does not fit raises `IllPosedError`."""

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
    apart: bool = True
    """Whether cost, first step and later steps have S futures each of their own, which the bounds by count and tail
    need. Without, all share one set: (6.5) as printed."""
    reached: float = 5.0
    """Distance from the goal that counts as arrival."""

    def __post_init__(self) -> None:
        n, m, d = self.system.states, self.system.inputs, self.obstacles.dimension
        if not 1 <= d <= n:
            raise IllPosedError("obstacles", f"must have 1 to {n} coordinates, given {d}")
        check_weights(self.Q, self.R, n, m)
        for name, shape in (("goal", (n,)), ("Q", (n, n)), ("R", (m, m))):
            object.__setattr__(self, name, finite_array(name, getattr(self, name), shape))
        for name, limits, count in (("state_limits", self.state_limits, n), ("input_limits", self.input_limits, m)):
            if limits.low.shape != (1, count):
                raise IllPosedError(name, f"must be one box of {count} coordinates, given {limits.low.shape}")
            if np.isposinf(limits.low).any() or np.isneginf(limits.high).any():
                raise IllPosedError(name, "leaves nothing: a low end is +inf or a high end -inf")
        self._check_numbers()
        self._check_goal(self.goal[:d])

    def _check_numbers(self) -> None:
        for name, low, high in (("horizon", 1, 50), ("scenarios", 1, 10_000), ("removed", 0, self.scenarios - 1)):
            check_integer(name, getattr(self, name), low, high)
        for name in ("safe_distance", "perception", "reached"):
            if not 0 <= getattr(self, name) <= 1e9:
                raise IllPosedError(name, f"must lie between 0 and 1e9, given {getattr(self, name)}")

    def _check_goal(self, place: Array) -> None:
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

    def path_exists(self, start: Array) -> bool:
        """Whether any path leads to the goal outside all safe distances, obstacles out of sight included.

        None does where the free boxes around start and goal are not joined. A state may still step across between two
        samples, unless `between_samples`.

        Parameters
        ----------
        start
            (n,), positions first; within a safe distance, the nearest free boxes count.

        Raises
        ------
        TooLargeError
            Too many free boxes.
        """
        place, goal = (np.asarray(point, float)[: self.obstacles.dimension] for point in (start, self.goal))
        free = free_boxes(self.room, self.grown)
        if not len(free):
            return False
        reached = np.isin(np.arange(len(free)), free.nearest(place))
        touching = ((free.low[:, None] <= free.high[None]) & (free.low[None] <= free.high[:, None])).all(axis=2)
        for _ in free.low:  # more steps than boxes reach no further
            reached = np.asarray((touching & reached[:, None]).any(axis=0))
        return bool((reached & free.containing(goal[None])).any())

    def check_start(self, state: Array) -> None:
        """Raise `IllPosedError` for a start outside the limits or inside an obstacle.

        Parameters
        ----------
        state
            (n,), positions first.
        """
        state = finite_array("start", state, (self.system.states,))
        if not self.state_limits.containing(state[None])[0]:
            raise IllPosedError("start", f"{state.tolist()} breaks the state limits: move it inside")
        place = state[: self.obstacles.dimension]
        hit = np.flatnonzero(self.obstacles.inside(place))
        if len(hit):
            raise IllPosedError("start", f"{place.tolist()} lies inside obstacle {hit[0] + 1}: move it out")
