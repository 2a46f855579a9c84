"""Surfaces of quadratic splines in two variables, and their patches in Bernstein form.

A quadratic spline on knots t_j is a combination of B-splines; on one cell it is a quadratic polynomial whose Bernstein
coefficients follow from the three B-spline coefficients that reach the cell (its blossom at pairs of the cell's ends).
A polynomial lies between the least and the largest of its Bernstein coefficients. Source: Prautzsch, Boehm and
Paluszny, Bezier and B-Spline Techniques, Springer 2002, chapters 5 and 6.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Local(NamedTuple):
    """The three B-splines that reach each of n points: index of the first, values and slopes (n, 3)."""

    first: Ints
    value: Floats
    slope: Floats


@dataclass(frozen=True)
class Axis:
    """Quadratic B-splines of one variable: slopes are continuous at inner knots, except at one `crease`."""

    knots: Floats
    crease: int | None = None  # an inner knot where only values are continuous

    @cached_property
    def _sequence(self) -> Floats:
        ends = [self.knots[:1]] * 2 + [self.knots] + [self.knots[-1:]] * 2
        doubled = np.concatenate(ends)
        return doubled if self.crease is None else np.insert(doubled, self.crease + 2, self.knots[self.crease])

    @property
    def cells(self) -> int:
        """Number of cells."""
        return len(self.knots) - 1

    @property
    def count(self) -> int:
        """Number of coefficients."""
        return len(self._sequence) - 3

    @cached_property
    def first(self) -> Ints:
        """Index of the first coefficient that reaches each cell."""
        return np.flatnonzero(np.diff(self._sequence) > 0) - 2

    @cached_property
    def extraction(self) -> Floats:
        """Bernstein coefficients of each cell from the three coefficients that reach it, (cells, 3, 3)."""
        found = np.zeros((self.cells, 3, 3))
        for cell, j in enumerate(self.first + 2):
            before, a, b, after = self._sequence[j - 1 : j + 3]
            found[cell, 0, :2] = (b - a) / (b - before), (a - before) / (b - before)
            found[cell, 1, 1] = 1.0
            found[cell, 2, 1:] = (after - b) / (after - a), (b - a) / (after - a)
        return found

    def place(self, x: Floats) -> tuple[Ints, Floats]:
        """The cell of each point, and its place in it from 0 to 1."""
        cell = np.clip(np.searchsorted(self.knots, x, side="right") - 1, 0, self.cells - 1)
        return cell, (x - self.knots[cell]) / np.diff(self.knots)[cell]

    def local(self, cell: Ints, share: Floats) -> Local:
        """B-splines at a place from 0 to 1 in a cell."""
        u = np.asarray(share)[:, None]
        bernstein = np.concatenate(((1 - u) ** 2, 2 * u * (1 - u), u * u), axis=1)
        slope = np.concatenate((2 * u - 2, 2 - 4 * u, 2 * u), axis=1) / np.diff(self.knots)[cell][:, None]
        into = self.extraction[cell]
        return Local(
            self.first[cell], np.einsum("na,nac->nc", bernstein, into), np.einsum("na,nac->nc", slope, into)
        )  # fmt: skip

    def points(self, parts: int) -> Floats:
        """Ends of the equal parts of each cell, (cells, parts + 1)."""
        shares = np.arange(parts + 1) / parts
        return np.asarray(self.knots[:-1, None] * (1 - shares) + self.knots[1:, None] * shares)


@dataclass(frozen=True)
class Surface:
    """The polynomials of a tensor-product spline, cell by cell.

    `bernstein` is (cells, cells, degree + 1, degree + 1).
    """

    bernstein: Floats
    widths: tuple[Floats, Floats]  # of the cells along either variable

    @classmethod
    def of(cls, axes: tuple[Axis, Axis], coefficients: Floats) -> Surface:
        """From B-spline coefficients (axes[0].count, axes[1].count)."""
        first, second = axes
        rows = coefficients[first.first[:, None] + np.arange(3)]  # (cells, 3, count)
        along = np.einsum("iac,icn->ian", first.extraction, rows)
        both = along[:, :, second.first[:, None] + np.arange(3)]  # (cells, 3, cells, 3)
        patches = np.einsum("jbd,iajd->ijab", second.extraction, both)
        return cls(patches, (np.diff(first.knots), np.diff(second.knots)))

    def slope(self, axis: int) -> Surface:
        """The partial derivative along a variable."""
        degree = self.bernstein.shape[2 + axis] - 1
        if degree == 0:
            return Surface(np.zeros_like(self.bernstein), self.widths)
        shape = [1, 1, 1, 1]
        shape[axis] = -1
        change = np.diff(self.bernstein, axis=2 + axis) * degree
        return Surface(change / self.widths[axis].reshape(shape), self.widths)

    def most(self) -> Floats:
        """A bound on the absolute value in each cell (cells, cells)."""
        return np.asarray(np.abs(self.bernstein).max(axis=(2, 3)))

    def at(self, parts: tuple[int, int]) -> Floats:
        """Values at the ends of the parts of each cell, (cells, parts + 1, cells, parts + 1)."""
        left, right = (
            _basis(np.arange(parts[axis] + 1) / parts[axis], self.bernstein.shape[2 + axis] - 1) for axis in (0, 1)
        )
        return np.asarray(np.einsum("ijab,ka,lb->ikjl", self.bernstein, left, right, optimize=True))


def _basis(share: Floats, degree: int) -> Floats:
    """Bernstein polynomials of degree 0, 1 or 2 at places from 0 to 1, (n, degree + 1)."""
    u = share[:, None]
    columns = {0: (u**0,), 1: (1 - u, u), 2: ((1 - u) ** 2, 2 * u * (1 - u), u * u)}[degree]
    return np.concatenate(columns, axis=1)


def value(axes: tuple[Axis, Axis], coefficients: Floats, x: float, y: float) -> float:
    """A spline's value at one point of its domain."""
    parts = [axis.local(*axis.place(np.array([at]))) for axis, at in zip(axes, (x, y), strict=True)]
    (i, left, _), (j, right, _) = parts
    block = coefficients[int(i[0]) : int(i[0]) + 3, int(j[0]) : int(j[0]) + 3]
    return float(left[0] @ block @ right[0])
