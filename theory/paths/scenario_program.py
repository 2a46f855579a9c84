"""The conditional scenario program (6.5) and the exact search over its candidate paths, inputs condensed.

For given samples every state is an affine function of the N m inputs, common to all scenarios. A path says in which
free box all scenarios shall be at each step; the rows of the program are the same for all paths, only bounds change.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import count, product
from typing import Any

import numpy as np
from scipy.optimize import linprog

from theory.arrays import Array
from theory.errors import InfeasibleError, SolverError, TooLargeError
from theory.paths.boxes import Boxes
from theory.paths.stochastic import ScenarioSamples
from theory.solvers import qp

NODES_MAX = 20_000
"""Programs solved in one search: a second or two, and a minute where limits are relaxed at every node."""

FIT = 1e-9
"""Distance outside a box that still counts as inside, relative to 1 + |coordinate|: the accuracy of the programs."""

Path = tuple[int, ...]
"""A box for every step."""

PartialPath = tuple[int | None, ...]


@dataclass(frozen=True)
class Solved:
    """Inputs for one path."""

    inputs: Array
    """N x m."""
    cost: float
    """Mean over the scenarios of the sum of |z - z_d|_Q^2 + |u|_R^2, without the terms no input changes."""
    deciding: frozenset[int]
    """Scenarios (of the first step, if later ones have their own) with an active row."""


@dataclass(frozen=True)
class SearchResult:
    """The best of all paths."""

    path: Path
    solved: Solved
    nodes: int
    """Programs solved."""


class ScenarioProgram:
    """min over u of the mean cost, such that all scenarios keep their limits; the position's may be drawn in by a path.

    Parameters
    ----------
    samples
        S futures of N steps, drawn once and shared by all paths: those of the constraints.
    state
        z_0, n.
    goal, Q, R
        z_d (n), n x n with no negative eigenvalue, m x m positive definite.
    state_limits, input_limits
        One box each, n and m; infinite where there is no limit.
    last
        Whether the last state counts in the cost, as in (6.3); (6.5a) stops before it.
    later
        Futures of the constraints from the second step on; by default the same as at the first.
    cost
        Futures over which the cost is the mean; by default those of the constraints, as in (6.5).
    """

    def __init__(
        self, samples: ScenarioSamples, state: Array, goal: Array, Q: Array, R: Array,  # noqa: N803  # the thesis's letters
        state_limits: Boxes, input_limits: Boxes, *, last: bool = True,
        later: ScenarioSamples | None = None, cost: ScenarioSamples | None = None,
    ) -> None:  # fmt: skip
        self.samples = samples
        self.scenarios, self.steps, self.n, self.m = samples.B.shape
        self.free, self.pushed = samples.condensed(np.asarray(state, float))
        self._apart = later is not None
        if later is not None:
            free, pushed = later.condensed(np.asarray(state, float))
            self.free[1:], self.pushed[1:] = free[1:], pushed[1:]
        counted = self.steps if last else self.steps - 1
        wide = self.steps * self.m
        free, pushed = (self.free, self.pushed) if cost is None else cost.condensed(np.asarray(state, float))
        pushed, away = pushed[:counted], free[:counted] - goal
        weighted = np.einsum("ab,isbk->isak", Q, pushed)
        self.hessian = 2 * (
            np.einsum("isaj,isak->jk", pushed, weighted) / away.shape[1] + np.kron(np.eye(self.steps), R)
        )
        self.linear = 2 * np.einsum("isa,isak->k", away, weighted) / away.shape[1]
        self.constant = float(np.einsum("isa,ab,isb->", away, Q, away)) / away.shape[1]
        self.low, self.high = state_limits.low[0], state_limits.high[0]
        self._input_bounds = np.concatenate(
            [np.tile(input_limits.high[0], self.steps), -np.tile(input_limits.low[0], self.steps)]
        )
        self._where, self._scenario, rows, self._most, self._least = self._merged()
        self.state_rows = rows
        eye = np.eye(wide)
        self.program = qp.Program(self.hessian, self.linear, np.vstack([eye, -eye, rows, -rows]), "scenario program")

    def _merged(self) -> tuple[Array, Array, Array, Array, Array]:
        """Rows per step, coordinate and scenario, merged where all scenarios have the same coefficients."""
        where: list[Any] = []
        scenario: list[Any] = []
        rows: list[Any] = []
        most: list[Any] = []
        least: list[Any] = []
        for i, c in product(range(self.steps), range(self.n)):
            coefficients, offsets = self.pushed[i, :, c], self.free[i, :, c]
            if (coefficients == coefficients[0]).all():
                where.append([[i, c]])
                scenario.append([[int(offsets.argmax()), int(offsets.argmin())]])
                rows.append(coefficients[:1])
                most.append([offsets.max()])
                least.append([offsets.min()])
            else:
                where.append([[i, c]] * self.scenarios)
                scenario.append([[s, s] for s in range(self.scenarios)])
                rows.append(coefficients)
                most.append(offsets)
                least.append(offsets)
        parts = (where, scenario, rows, most, least)
        joined = tuple(np.concatenate(part) for part in parts)
        return joined[0], joined[1], joined[2], joined[3], joined[4]

    def upper(self, low: Array, high: Array) -> Array:
        """Right-hand sides for state limits low and high, N x n each.

        Parameters
        ----------
        low, high
            N x n each, infinite where there is no limit.

        Returns
        -------
        Array
            A right-hand side for each row of the program.
        """
        i, c = self._where.T
        return np.concatenate([self._input_bounds, high[i, c] - self._most, self._least - low[i, c]])

    def limits(self, boxes: Boxes, choice: PartialPath, spans: Sequence[Sequence[int]]) -> tuple[Array, Array]:
        """State limits a step when choice k confines the positions at the steps spans[k]."""
        low, high = np.tile(self.low, (self.steps, 1)), np.tile(self.high, (self.steps, 1))
        d = boxes.dimension
        for chosen, span in zip(choice, spans, strict=True):
            if chosen is not None:
                for i in span:
                    low[i, :d] = np.maximum(low[i, :d], boxes.low[chosen])
                    high[i, :d] = np.minimum(high[i, :d], boxes.high[chosen])
        return low, high

    def solve(self, low: Array, high: Array) -> Solved:
        """The best inputs within state limits (N x n each). Raises `InfeasibleError`, `SolverError`.

        Parameters
        ----------
        low, high
            N x n each, infinite where there is no limit.

        Returns
        -------
        Solved
            Inputs N x m, their cost, and the scenarios that decide them.
        """
        answer = self.program.minimize(self.upper(low, high))
        return Solved(answer.point.reshape(self.steps, self.m), answer.value + self.constant, self._deciding(answer))

    def _deciding(self, answer: qp.Optimum) -> frozenset[int]:
        both = answer.multipliers[len(self._input_bounds) :].reshape(2, -1) > 0
        if self._apart:
            both = both & (self._where[:, 0] == 0)
        return frozenset(self._scenario[both[0], 0].tolist() + self._scenario[both[1], 1].tolist())

    def states(self, inputs: Array) -> Array:
        """Predicted states, N x S x n.

        Parameters
        ----------
        inputs
            N x m.

        Returns
        -------
        Array
            N x S x n.
        """
        return self.free + self.pushed @ inputs.ravel()

    def least_slack(self, low: Array, high: Array) -> tuple[float, Array, Array]:
        """The least relaxation of the limits, in total and each (N x n, downward and upward).

        Parameters
        ----------
        low, high
            N x n each, infinite where there is no limit.

        Returns
        -------
        tuple
            The total, and the relaxations downward and upward, N x n each.
        """
        wide, spots = self.steps * self.m, self.steps * self.n
        i, c = self._where.T
        give = np.zeros((len(self._where), spots))
        give[np.arange(len(give)), i * self.n + c] = -1.0
        none = np.zeros_like(give)
        rows = np.vstack([np.hstack([self.state_rows, give, none]), np.hstack([-self.state_rows, none, give])])
        upper = self.upper(low, high)
        kept = np.isfinite(upper[2 * wide :])
        bounds = [(-b, a) for a, b in zip(upper[:wide], upper[wide : 2 * wide], strict=True)] + [(0.0, None)] * (
            2 * spots
        )
        cost = np.concatenate([np.zeros(wide), np.ones(2 * spots)])
        found = linprog(cost, A_ub=rows[kept], b_ub=upper[2 * wide :][kept], bounds=bounds, method="highs")
        if found.status != 0:
            raise SolverError(found.message, "least slack")
        slack = found.x[wide:].reshape(2, self.steps, self.n)
        return float(found.fun), slack[1], slack[0]


def confined_steps(steps: int, *, between: bool) -> list[tuple[int, ...]]:
    """The steps that each choice confines: its own, or with the line from the sample before also that one."""
    return [(i - 1, i) if between and i else (i,) for i in range(steps)]


def search_paths(program: ScenarioProgram, boxes: Boxes, start: Array | None = None) -> SearchResult:
    """The best path over all sequences of boxes, by branch and bound; exact.

    Parameters
    ----------
    program
        The scenario program.
    boxes
        The maximal free boxes, of the first d coordinates.
    start
        The position now; if given, every pair of successive positions must share a box, and so the line between them.
        From a position in no box the first line goes to one of the nearest.

    Raises
    ------
    InfeasibleError
        No path has a solution.
    TooLargeError
        More than `NODES_MAX` programs.
    """
    spans = confined_steps(program.steps, between=start is not None)

    def solve(choice: PartialPath) -> tuple[float, Array, Solved]:
        solved = program.solve(*program.limits(boxes, choice, spans))
        return solved.cost, solved.inputs, solved

    return _branch(program, boxes, start, solve)


def search_softened(program: ScenarioProgram, boxes: Boxes, start: Array | None = None) -> tuple[SearchResult, float]:
    """The path of the least total relaxation of limits, that total, and the cheapest inputs within the relaxed limits.

    A total may be shared out among limits in several ways; one of them is taken.

    Parameters
    ----------
    program
        The scenario program.
    boxes
        The maximal free boxes, of the first d coordinates.
    start
        The position now, (d,), as in `search_paths`.

    Returns
    -------
    tuple
        The path with its inputs, and the total relaxation.
    """
    spans = confined_steps(program.steps, between=start is not None)

    def solve(choice: PartialPath) -> tuple[float, Array, Solved]:
        low, high = program.limits(boxes, choice, spans)
        total, down, up = program.least_slack(low, high)
        margin = 1e-7 * (1 + total)  # the linear program's own tolerance
        solved = program.solve(low - down - margin, high + up + margin)
        return total, solved.inputs, solved

    found = _branch(program, boxes, start, solve)
    total, _, _ = program.least_slack(*program.limits(boxes, found.path, spans))
    return found, total


def _branch(
    program: ScenarioProgram,
    boxes: Boxes,
    start: Array | None,
    solve: Callable[[PartialPath], tuple[float, Array, Solved]],
) -> SearchResult:
    """Best first: solve with some boxes chosen; where the solution fits no box at a step, try every box there."""
    order, nodes = count(), 0
    heap: list[tuple[float, int, PartialPath, Array, Solved]] = []
    first = np.arange(len(boxes)) if start is None else boxes.nearest(start)

    def push(choice: PartialPath) -> None:
        nonlocal nodes
        nodes += 1
        if nodes > NODES_MAX:
            raise TooLargeError("programs of the path search (shorten the horizon)", nodes, NODES_MAX)
        try:
            value, inputs, solved = solve(choice)
        except InfeasibleError:
            return
        heapq.heappush(heap, (value, next(order), choice, inputs, solved))

    push((None,) * program.steps)
    while heap:
        _, _, choice, inputs, solved = heapq.heappop(heap)
        fitting = _fitting(program, boxes, first, inputs, between=start is not None)
        misfits = [i for i, chosen in enumerate(choice) if chosen is None and not fitting[i].any()]
        if not misfits:
            path = tuple(int(fitting[i].argmax()) if chosen is None else chosen for i, chosen in enumerate(choice))
            return SearchResult(path, solved, nodes)
        for b in first if misfits[0] == 0 else range(len(boxes)):
            push((*choice[: misfits[0]], int(b), *choice[misfits[0] + 1 :]))
    raise InfeasibleError("infeasible", "all candidate paths")


def _fitting(program: ScenarioProgram, boxes: Boxes, first: Any, inputs: Array, *, between: bool) -> Array:
    """Whether all scenarios at each step (with `between`: and the step before) lie in each box: N x boxes."""
    d = boxes.dimension
    positions = program.states(inputs)[..., :d]
    bottom, top = positions.min(axis=1), positions.max(axis=1)
    if between:
        bottom[1:], top[1:] = np.minimum(bottom[1:], bottom[:-1]), np.maximum(top[1:], top[:-1])
    slack = FIT * (1 + np.abs(positions).max())
    fits = np.asarray(
        (boxes.low[None] <= bottom[:, None] + slack).all(axis=2)
        & (boxes.high[None] >= top[:, None] - slack).all(axis=2)
    )
    fits[0] &= np.isin(np.arange(len(boxes)), first)
    return fits
