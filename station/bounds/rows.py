"""Rows of the linear programs that propose potentials, and what a vehicle's U is in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from station.bounds.drift import drift
from station.bounds.grid import Grid
from station.bounds.spline import Axis, Floats
from station.geometry import KELVIN

Ints = NDArray[np.int64]

SHARES = np.array([0.0, 0.5, 1.0])
"""Places in a cell, from 0 to 1, at which a program looks."""


@dataclass
class Rows:
    """Rows of a sparse system `matrix x <= bound`, added by columns."""

    width: int
    count: int = 0
    parts: list[tuple[Ints, Ints, Floats]] = field(default_factory=list)
    bounds: list[Floats] = field(default_factory=list)

    def add(self, columns: Sequence[Ints], values: Sequence[Floats | float], bound: Floats) -> None:
        """Append len(bound) rows; each column has an index and a coefficient a row."""
        ids = self.count + np.arange(len(bound))
        for column, value in zip(columns, values, strict=True):
            self.parts.append((ids, np.broadcast_to(column, ids.shape), np.broadcast_to(value, ids.shape)))
        self.bounds.append(bound)
        self.count += len(bound)

    def system(self) -> tuple[csr_matrix, Floats]:
        """The matrix and the bounds."""
        rows, columns, values = (np.concatenate(part) for part in zip(*self.parts, strict=True))
        return csr_matrix((values, (rows, columns)), shape=(self.count, self.width)), np.concatenate(self.bounds)


def mesh(*counts: int) -> list[Ints]:
    """Every combination of indices below `counts`, an array for each place."""
    return [axis.ravel() for axis in np.meshgrid(*(np.arange(count) for count in counts), indexing="ij")]


@dataclass(frozen=True)
class Samples:
    """Points (x, y) of a tensor-product spline, and its coefficients' weights there."""

    columns: list[Ints]  # nine for each point
    value: list[Floats]
    along: list[Floats]  # the slope along the first variable
    across: list[Floats]  # and along the second

    @classmethod
    def of(cls, axes: tuple[Axis, Axis], first: tuple[Ints, Floats], second: tuple[Ints, Floats]) -> Samples:
        """At these cells and places from 0 to 1 in them, along either variable."""
        p, q = axes[0].local(*first), axes[1].local(*second)
        pairs = [(a, b) for a in range(3) for b in range(3)]
        return cls(
            [(p.first + a) * axes[1].count + q.first + b for a, b in pairs],
            [p.value[:, a] * q.value[:, b] for a, b in pairs],
            [p.slope[:, a] * q.value[:, b] for a, b in pairs],
            [p.value[:, a] * q.slope[:, b] for a, b in pairs],
        )

    def moved(self, along: Floats, across: Floats) -> list[Floats]:
        """Weights of the change along a step."""
        return [left * along + right * across for left, right in zip(self.along, self.across, strict=True)]

    def shifted(self, offset: int) -> list[Ints]:
        """The columns where coefficients begin at `offset`."""
        return [column + offset for column in self.columns]


def rises(grid: Grid, volume: float, pressure: Floats, warm: Floats, flow: Floats) -> tuple[Floats, Floats]:
    """Increments of a second at `flow` (0: closed): of a vehicle's place on its scale, and of its temperature [K]."""
    change = np.where(flow > 0, grid.plant.vehicle_heating, 0.0) + drift(grid, 0.0, warm)
    ratio = 1 + change / (warm + KELVIN)
    rise = grid.bar_per_gram(volume) * grid.theta(warm) * ratio * flow + pressure * (ratio - 1)
    return np.asarray(rise * grid.pressure_scale.rate(pressure)), np.asarray(change)


def start_weights(grid: Grid, start: float) -> Floats:
    """Weights of the coefficients of U in its value at a start pressure [bar] and the usual temperature."""
    axes = grid.service_axes
    place = axes[0].place(grid.pressure_scale.position(np.array([start])))
    point = Samples.of(axes, place, axes[1].place(np.array([grid.station.vehicle.start_temperature_c])))
    weights = np.zeros(axes[0].count * axes[1].count)
    weights[np.concatenate(point.columns)] = np.concatenate(point.value)
    return weights


def service_limits(grid: Grid) -> tuple[Floats, Floats]:
    """U is 0 at the highest finish pressure, and negative below it: least and most of its coefficients."""
    first, second = (axis.count for axis in grid.service_axes)
    low, high = np.full((first, second), -20_000.0), np.zeros((first, second))
    low[-1] = 0.0
    return low.ravel(), high.ravel()


def growing(shape: tuple[int, int], axis: int) -> tuple[Ints, Ints]:
    """Neighbours along an axis of coefficients of this shape: indices before and after."""
    numbers = np.arange(shape[0] * shape[1]).reshape(shape)
    if axis == 0:
        return numbers[:-1].ravel(), numbers[1:].ravel()
    return numbers[:, :-1].ravel(), numbers[:, 1:].ravel()


def bends(shape: tuple[int, int], crease: int | None = None) -> csr_matrix:
    """Third differences of coefficients along either axis, one a row: what wiggles has large ones.

    None of them crosses column `crease`.
    """
    numbers = np.arange(shape[0] * shape[1]).reshape(shape)
    rows = Rows(numbers.size)
    sides = [numbers] if crease is None else [numbers[:, : crease + 1], numbers[:, crease:]]
    for axis, block in [(0, numbers), *((1, side) for side in sides)]:
        count = block.shape[axis] - 3
        if count > 0:
            near = [np.take(block, np.arange(count) + shift, axis).ravel() for shift in range(4)]
            rows.add(near, [-1.0, 3.0, -3.0, 1.0], np.zeros(len(near[0])))
    return rows.system()[0]
