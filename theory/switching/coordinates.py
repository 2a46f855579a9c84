"""Coordinates z = S x in which a problem is well scaled, S a matrix of binary fractions: nothing is lost on the way.

Maps are changed in rational arithmetic and rounded once, and matrices come back exactly: L = S' X S. So a system in
coordinates of a condition of a million, or with a state in other units, is solved as well as the one it came from.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from math import gcd

import numpy as np
from scipy import linalg

from theory.arrays import Array
from theory.checker import multiply

ExactMatrix = list[list[Fraction]]

PASSES = 12
"""Changes of coordinates until the averaged Lyapunov matrix is near I; each gains some four decimals of condition."""

ROOM = 0.3
"""Relative room above the averaged maps' growth: their Lyapunov matrix exists."""

TIGHT = 2e-7
"""Relative distance of a single map's norm above its spectral radius that is near enough."""

NEAR = 30.0
"""Condition at which coordinates are good enough."""

GRAMIAN_STATES = 30
"""Up to so many states Gramians are solved for directly, else summed up."""

SERIES = 2000
"""Terms of a Gramian that is summed up."""

LIVELY = 0.98
"""Growth of a Gramian's terms beyond which the maps are scaled down until it is finite."""


@dataclass(frozen=True)
class Coordinates:
    """z = S x: `turn` holds S, n x n, regular."""

    turn: Array

    @cached_property
    def _exact(self) -> tuple[ExactMatrix, ExactMatrix]:
        exact = [[Fraction(float(item)) for item in row] for row in self.turn]
        return exact, inverse(exact)

    @cached_property
    def back(self) -> Array:
        """T = S^-1, x = T z, each entry rounded once."""
        return _floats(self._exact[1])

    @property
    def size(self) -> int:
        """N."""
        return len(self.turn)

    def loop(self, exact: ExactMatrix) -> Array:
        """S A T, rounded once.

        Parameters
        ----------
        exact
            A, n x n.
        """
        one, two = self._exact
        return _floats(multiply(multiply(one, exact), two))

    def drive(self, exact: ExactMatrix) -> Array:
        """S E, rounded once.

        Parameters
        ----------
        exact
            E, n x q.
        """
        return _floats(multiply(self._exact[0], exact))

    def output(self, exact: ExactMatrix) -> Array:
        """C T, rounded once.

        Parameters
        ----------
        exact
            C, p x n.
        """
        return _floats(multiply(exact, self._exact[1]))

    def followed_by(self, turn: Array) -> Coordinates:
        """The coordinates turn S x, each row in units of a power of two near its size.

        Parameters
        ----------
        turn
            n x n, regular.
        """
        return Coordinates(turn @ self.turn)

    def scaled(self, by: float) -> Coordinates:
        """By S, where `by` is a power of two."""
        return Coordinates(by * self.turn)

    def matrices(self, found: Array) -> list[ExactMatrix]:
        """L = S' X S for every X, exactly.

        Parameters
        ----------
        found
            count x n x n, symmetric.
        """
        one = self._exact[0]
        columns = [list(row) for row in zip(*one, strict=True)]
        return [multiply(multiply(columns, [[Fraction(float(x)) for x in row] for row in item]), one) for item in found]

    @cached_property
    def smallest(self) -> float:
        """The smallest singular value of S: what a margin in z keeps in x, at least, is its square times as much."""
        return 1.0 / float(np.linalg.norm(self.back, 2))


def inverse(rows: ExactMatrix) -> ExactMatrix:
    """The inverse of a regular matrix, by elimination without fractions (Bareiss).

    Parameters
    ----------
    rows
        n x n, regular.
    """
    size = len(rows)
    scales = [_common(row) for row in rows]
    rest = [[int(x * by) for x in row] + [by * (i == j) for j in range(size)]
            for i, (row, by) in enumerate(zip(rows, scales, strict=True))]  # fmt: skip
    before = 1
    for k in range(size):
        pivot = next(i for i in range(k, size) if rest[i][k] != 0)
        rest[k], rest[pivot] = rest[pivot], rest[k]
        own = rest[k]
        for i in range(size):
            if i != k:
                by = rest[i][k]
                rest[i] = [(own[k] * x - by * y) // before for x, y in zip(rest[i], own, strict=True)]
        before = own[k]
    return [[Fraction(x, rest[i][i]) for x in rest[i][size:]] for i in range(size)]


def of_maps(exact: Sequence[ExactMatrix]) -> Coordinates:
    """Coordinates in which maps are near contractions of their common growth, whatever those they are given in.

    Parameters
    ----------
    exact
        The maps, n x n each.
    """
    size = len(exact[0])
    _, (scale, _) = linalg.matrix_balance(
        np.abs([_floats(one) for one in exact]).sum(axis=0), permute=False, separate=True
    )
    found = Coordinates(np.diag(1.0 / scale))
    for _ in range(PASSES):
        shape = averaged(np.array([found.loop(one) for one in exact]), ROOM)
        if shape is None:
            return found
        found = found.followed_by(root(shape))
        if np.linalg.cond(shape) < NEAR**2:
            break
    if len(exact) == 1:
        found = _contracting(exact[0], found)
    _, logarithm = np.linalg.slogdet(found.turn)
    return Coordinates(found.turn * 2.0 ** -np.round(logarithm / size / np.log(2)))


def _contracting(exact: ExactMatrix, found: Coordinates) -> Coordinates:
    """Coordinates in which the norm of a single map is near its spectral radius: step by step, for Jordan blocks."""
    room = ROOM
    while room > TIGHT:
        one = found.loop(exact)
        radius = float(np.abs(np.linalg.eigvals(one)).max())
        if np.linalg.norm(one, 2) <= radius * (1 + TIGHT):
            break
        room /= 3
        shape = averaged(one[None], room)
        if shape is None or not np.isfinite(shape).all():
            break
        found = found.followed_by(root(shape))
    return found


def averaged(maps: Array, room: float) -> Array | None:
    """P = I + sum of A' P A over the maps, these scaled so that P exists with some room; None if they all vanish.

    Parameters
    ----------
    maps
        k x n x n.
    room
        Relative distance of their growth, so scaled, below 1.
    """
    growth = _growth(maps)
    if growth <= 0:
        return None
    found = series(np.swapaxes(maps, 1, 2) / np.sqrt(growth * (1 + room)), np.eye(maps.shape[-1]))
    if np.isfinite(found).all() and np.linalg.eigvalsh(found).min() > 1 / 2:
        return found
    return _leading(maps)


def _leading(maps: Array) -> Array:
    """The first terms of that sum, each over its own size, for coordinates so bad that equations tell nothing."""
    total = term = np.eye(maps.shape[-1])
    for _ in range(4 * len(term)):
        term = (np.swapaxes(maps, 1, 2) @ term @ maps).sum(axis=0)
        size = float(np.trace(term))
        if size <= 0:
            break
        term = (term + term.T) / (2 * size)
        total = total + term
    return np.asarray(total)


def series(maps: Array, start: Array) -> Array:
    """The sum of Phi^j (start) over j, Phi (P) = sum of A P A' over the maps: a Gramian.

    Parameters
    ----------
    maps
        k x n x n, scaled so that the sum is finite.
    start
        n x n, symmetric.

    Returns
    -------
    Array
        n x n; not finite where the equations are singular.
    """
    size = maps.shape[-1]
    if size <= GRAMIAN_STATES:
        through = sum((np.kron(one, one) for one in maps), np.zeros((size**2, size**2)))
        try:
            found = np.linalg.solve(np.eye(size**2) - through, start.ravel()).reshape(size, size)
        except np.linalg.LinAlgError:
            return np.full((size, size), np.nan)
        return np.asarray((found + found.T) / 2)
    if len(maps) == 1:
        return np.asarray(linalg.solve_discrete_lyapunov(maps[0], start, method="bilinear"))
    total, term = start.copy(), start
    for _ in range(SERIES):
        term = (maps @ term @ np.swapaxes(maps, 1, 2)).sum(axis=0)
        total = total + term
        if np.trace(term) < 1e-9 * np.trace(total):
            break
    return np.asarray(total)


def gramian(maps: Array, start: Array, growth: float = 1.0) -> Array:
    """The sum of Phi^j (start), Phi (P) the mean of A P A' over the maps, by `growth`; scaled where it is not finite.

    Parameters
    ----------
    maps
        k x n x n.
    start
        n x n, symmetric.
    growth
        Each term is divided by it.
    """
    scaled = maps / np.sqrt(len(maps) * growth)
    if len(maps) > 1 and (own := _growth(scaled)) > LIVELY:
        scaled = scaled / np.sqrt(own / LIVELY)
    values, vectors = np.linalg.eigh(series(scaled, start))
    return np.asarray((vectors * np.maximum(values, 1e-13 * values[-1])) @ vectors.T)


def root(shape: Array) -> Array:
    """R with R' R = shape, for a positive definite shape; eigenvalues below rounding are lifted.

    Parameters
    ----------
    shape
        n x n, symmetric.
    """
    values, vectors = np.linalg.eigh(shape)
    values = np.maximum(values, 1e-13 * values[-1])
    return np.asarray(np.sqrt(values)[:, None] * vectors.T)


def geometric_mean(low: Array, high: Array, share: float = 0.5) -> Array:
    """The geometric mean of two positive definite matrices, `share` of the way from the one to the other.

    Parameters
    ----------
    low, high
        n x n, symmetric.
    share
        0 gives `low`, 1 gives `high`, whatever the coordinates.
    """
    half = root(low)
    inner = np.linalg.solve(half.T, np.linalg.solve(half.T, high).T)
    values, vectors = np.linalg.eigh((inner + inner.T) / 2)
    middle = (vectors * np.maximum(values, 1e-30) ** share) @ vectors.T
    return np.asarray(half.T @ middle @ half)


def _growth(maps: Array) -> float:
    """The growth of P to the sum of A' P A over the maps, by its powers."""
    size = maps.shape[-1]
    if len(maps) == 1:
        return float(np.abs(np.linalg.eigvals(maps[0])).max()) ** 2
    if size <= GRAMIAN_STATES // 2:
        through = sum((np.kron(one, one) for one in maps), np.zeros((size**2, size**2)))
        return float(np.abs(np.linalg.eigvals(through)).max())
    shape, logarithms = np.eye(size) / size, []
    for _ in range(120):
        shape = (np.swapaxes(maps, 1, 2) @ shape @ maps).sum(axis=0)
        trace = float(np.trace(shape))
        if trace <= 0:
            return 0.0
        logarithms.append(np.log(trace))
        shape = shape / trace
    return float(np.exp(np.mean(logarithms[60:])))


def _common(row: Sequence[Fraction]) -> int:
    found = 1
    for item in row:
        found = found * item.denominator // gcd(found, item.denominator)
    return found


def _floats(rows: Sequence[Sequence[Fraction]]) -> Array:
    return np.array([[float(item) for item in row] for row in rows])
