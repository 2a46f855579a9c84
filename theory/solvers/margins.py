"""The largest margin of Lyapunov inequalities along a graph, found from both sides without any matrix of its unknowns.

    maximise  t       where P_u - A' P_v A >= t I along every edge from u to v, P_u >= 0, sum of trace P_u = N n
    minimise  y N n   where sum of Z leaving u - sum of A Z A' arriving at u + Y_u = y I, Z, Y >= 0, sum of trace Z = 1

Both have points inside, whatever the maps: t far below zero, y far above. A primal-dual method of interior points stays
there, so that each of its points bounds the margin from both sides: t > 0 proves that the inequalities have a solution,
y < 0 that they have none. Directions are those of Nesterov and Todd (doi 10.1137/S105262349630060X) with the corrector
of Mehrotra (doi 10.1137/0802028).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from theory.arrays import Array
from theory.errors import InfeasibleError, SolverError
from theory.solvers.inequalities import Inequalities, factors, inverses, turned
from theory.solvers.normal_equations import NormalEquations, inner, trace_of

STEPS = 60
"""Points, at most; a yes takes 2 to 8 of them, a no 10 to 20."""

STEP = 30
"""Products that the rest of a step takes the time of."""

INSIDE = 0.9
"""Part of the way to the boundary that is gone."""

NONE = 1e-9
"""An upper bound of the margin that counts as no margin."""

STALLED = 1e-3
"""Lengths of both steps below which a point is the last one."""


@dataclass(frozen=True)
class Margin:
    """Matrices P with a margin above zero, and the bounds of the largest: the margin they have, and one from above."""

    matrices: Array
    value: float
    bound: float
    work: float


def positive_margin(
    inequalities: Inequalities, start: Array, what: str, *, work: float = np.inf, share: float = 0.0
) -> Margin:
    """Matrices for which all inequalities hold with a margin above zero, the first that are met.

    Margin and bound are those of P C P' >= t I in place of P, C a factor of `start`: the margin is measured against it.

    Parameters
    ----------
    inequalities
        Along the edges of a graph from each of whose nodes there is one.
    start
        Positive definite matrices, N x n x n, near a solution or not.
    what
        The name of the problem in errors.
    work
        Products with the matrix of a linear system after which it is given up.
    share
        Part of the largest margin that the first one met has to be.

    Raises
    ------
    InfeasibleError
        There are none, as multipliers show, or none with a margin above `NONE`.
    SolverError
        The method does not decide, or not with so little work.
    """
    done, factorised = 0.0, False
    try:
        problem, back = inequalities.where(start)
        point = _Point.first(problem)
        for _ in range(STEPS):
            if point.value > 0 and point.value >= share * point.bound:
                return Margin(back @ point.primal @ turned(back), point.value, point.bound, done)
            newton = _Newton(point, factorised=factorised)  # positive definite multipliers, or an error
            if point.bound < NONE:
                raise InfeasibleError("no margin", what)
            point, lengths = newton.next()
            done += newton.work
            factorised = factorised or newton.equations.products > newton.equations.worth
            if max(lengths) < STALLED or done > work:
                break
    except np.linalg.LinAlgError as error:  # a matrix that is positive definite but for rounding
        raise SolverError("no progress", what) from error
    raise SolverError("no decision", what)


def _even(matrices: Array) -> Array:
    return (matrices + turned(matrices)) / 2


class _Point:
    """P, t and Z, y, with the slacks S of the edges and Y of the nodes that belong to them."""

    def __init__(self, problem: Inequalities, primal: Array, value: float, dual: Array, level: float) -> None:
        self.problem, self.primal, self.value, self.dual, self.level = problem, primal, value, dual, level
        identity = np.eye(problem.size)
        self.slack = _even(problem.drop(primal) - value * identity)
        self.multiplier = _even(level * identity - problem.balance(dual))

    @classmethod
    def first(cls, problem: Inequalities) -> _Point:
        """P = I, t below what it has, and multipliers on the central path of the edges."""
        identity = np.eye(problem.size)
        primal = np.broadcast_to(identity, (problem.nodes, problem.size, problem.size))
        drop = problem.drop(primal)
        least = float(np.linalg.eigvalsh(drop).min())
        value = least - max(abs(least), 0.1) / 2
        dual = inverses(_even(drop) - value * identity)
        share = 1 / trace_of(dual)
        dual = _even(share * dual)
        level = float(np.linalg.eigvalsh(_even(problem.balance(dual))).max()) + share
        return cls(problem, primal, value, dual, level)

    @property
    def gap(self) -> float:
        """The mean product of a slack and its multiplier."""
        products = inner(self.slack, self.dual) + inner(self.primal, self.multiplier)
        return products / self.rows

    @property
    def rows(self) -> int:
        """Number of rows of all inequalities."""
        return (len(self.slack) + len(self.primal)) * self.problem.size

    @property
    def bound(self) -> float:
        """What no margin exceeds."""
        return self.level * trace_of(self.primal) / trace_of(self.dual)


@dataclass(frozen=True)
class _Step:
    """A direction of all that a point consists of."""

    primal: Array
    value: float
    dual: Array
    level: float
    slack: Array
    multiplier: Array


class _Scaling:
    """Coordinates G in which a slack G' S G and its multiplier G^-1 Z G^-T are the same diagonal matrix."""

    def __init__(self, slack: Array, multiplier: Array) -> None:
        factor = factors(slack)
        squares, vectors = np.linalg.eigh(_even(turned(factor) @ multiplier @ factor))
        if squares.min() <= 0:
            raise np.linalg.LinAlgError("a multiplier is not positive definite")
        fourth = squares**0.25
        self.values = np.sqrt(squares)
        self.turn = turned(inverses(factor)) @ vectors * fourth[:, None, :]
        self.back = turned(vectors) @ turned(factor) / fourth[:, :, None]
        self.metric = self.turn @ turned(self.turn)

    def steps(self, slack: Array, multiplier: Array) -> tuple[Array, Array]:
        """Directions of slack and multiplier in these coordinates."""
        return turned(self.turn) @ slack @ self.turn, self.back @ multiplier @ turned(self.back)

    def lengths(self, slack: Array, multiplier: Array) -> tuple[float, float]:
        """The ways along both directions to the boundary."""
        one, two = self.steps(slack, multiplier)
        return self._length(one), self._length(two)

    def corrected(self, centre: float, slack: Array, multiplier: Array) -> Array:
        """C of dZ + W dS W = C, which leads to products of `centre` after the product of these directions."""
        one, two = self.steps(slack, multiplier)
        wanted = -_even(one @ two)
        diagonal = np.arange(wanted.shape[-1])
        wanted[:, diagonal, diagonal] += centre - self.values**2
        wanted *= 2 / (self.values[:, :, None] + self.values[:, None, :])
        return self.turn @ wanted @ turned(self.turn)

    def _length(self, step: Array) -> float:
        roots = 1 / np.sqrt(self.values)
        least = float(np.linalg.eigvalsh(roots[:, :, None] * _even(step) * roots[:, None, :]).min())
        return np.inf if least >= 0 else -1 / least


class _Newton:
    """The linear systems at a point: dZ + W dS W = C at the edges, dY + V dP V = D at the nodes.

    With dS = dP_u - A' dP_v A - dt I, and dY = dy I less the balance of dZ, normal equations remain for dP and dy.
    """

    def __init__(self, point: _Point, *, factorised: bool) -> None:
        self.point, self.problem, self.factorised = point, point.problem, factorised
        self.edges = _Scaling(point.slack, point.dual)
        self.nodes = _Scaling(point.primal, point.multiplier)
        self.equations = NormalEquations(point.problem, self.edges.metric, self.nodes.metric)

    @property
    def work(self) -> float:
        """The products with the matrix that were made, or others in the time that was taken."""
        return STEP + self.equations.products + (self.equations.worth if self.factorised else 0)

    def next(self) -> tuple[_Point, tuple[float, float]]:
        """The point that follows, and the lengths of the steps to it."""
        point = self.point
        straight = self._direction(-point.dual, -point.multiplier, np.zeros(point.primal.shape))
        first, second = (min(1.0, length) for length in self._lengths(straight))
        left = inner(point.slack + first * straight.slack, point.dual + second * straight.dual)
        left += inner(point.primal + first * straight.primal, point.multiplier + second * straight.multiplier)
        gap = point.gap
        centre = gap * min(1.0, max(1e-3, left / (gap * point.rows))) ** 2
        step = self._direction(
            self.edges.corrected(centre, straight.slack, straight.dual),
            self.nodes.corrected(centre, straight.primal, straight.multiplier),
            straight.primal,
        )
        first, second = (min(1.0, INSIDE * length) for length in self._lengths(step))
        return _Point(
            self.problem, _even(point.primal + first * step.primal), point.value + first * step.value,
            _even(point.dual + second * step.dual), point.level + second * step.level,
        ), (first, second)  # fmt: skip

    def _lengths(self, step: _Step) -> tuple[float, float]:
        edges, nodes = self.edges.lengths(step.slack, step.dual), self.nodes.lengths(step.primal, step.multiplier)
        return min(edges[0], nodes[0]), min(edges[1], nodes[1])

    def _direction(self, edges: Array, nodes: Array, guess: Array) -> _Step:
        """The step for right-hand sides C of the edges and D of the nodes."""
        problem, equations, metric = self.problem, self.equations, self.edges.metric
        identity = np.eye(problem.size)
        surplus = trace_of(edges)
        right = problem.balance(edges) + nodes - (surplus / equations.weight) * equations.tilt
        primal, level = self._solved(right, guess)
        value = (inner(equations.tilt, primal) - surplus) / equations.weight
        slack = problem.drop(primal) - value * identity
        dual = edges - metric @ slack @ metric
        return _Step(primal, value, dual, level, slack, level * identity - problem.balance(dual))

    def _solved(self, right: Array, guess: Array) -> tuple[Array, float]:
        """The steps of P and y."""
        if self.factorised:
            try:
                primal, level = self.equations.factorised(right)
                return _even(primal), level
            except np.linalg.LinAlgError:  # as near to singular as rounding lets it be
                self.factorised = False
        primal, level = self.equations.iterated(right, guess)
        return _even(primal), level
