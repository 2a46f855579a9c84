"""Rows of the linear programs that propose potentials, and what a vehicle's U is in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from station.bounds.grid import Floats, Grid
from station.plant import KELVIN

Ints = NDArray[np.int64]

CORNERS = ((0, 0), (0, 1), (1, 0), (1, 1))


@dataclass
class Rows:
    """Rows of a sparse system `matrix x <= bound`, added by columns."""

    width: int
    count: int = 0
    parts: list[tuple[Ints, Ints, Floats]] = field(default_factory=list)
    bounds: list[Floats] = field(default_factory=list)

    def add(self, columns: list[Ints], values: Sequence[Floats | float], bound: Floats) -> None:
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


def corner_nodes(i: Ints, j: Ints, corner: tuple[int, int]) -> list[tuple[Ints, Ints]]:
    """Nodes of the difference along pressure, then of that along temperature, at a corner of cells (i, j)."""
    a, b = corner
    return [(i + 1, j + b), (i, j + b), (i + a, j + 1), (i + a, j)]


def rises(grid: Grid, volume: float, pressure: Floats, warm: Floats, flow: Floats) -> tuple[Floats, Floats]:
    """What a second at `flow` (0: closed) adds to a vehicle's place on its scale, and to its temperature [K]."""
    plant = grid.plant
    drift = np.where(flow > 0, plant.vehicle_heating, 0.0) + plant.heat_exchange * (plant.ambient_temperature - warm)
    ratio = 1 + drift / (warm + KELVIN)
    rise = grid.bar_per_gram(volume) * grid.theta(warm) * ratio * flow + pressure * (ratio - 1)
    return np.asarray(rise * grid.pressure_scale.rate(pressure)), np.asarray(drift)


def start_weights(grid: Grid, start: float) -> Floats:
    """Weights of the nodes of U in its value at a start pressure [bar] and the usual temperature."""
    y = grid.y
    place = float(grid.pressure_scale.position(np.array([start]))[0])
    weights = np.zeros((len(y), len(grid.vehicle_temperature)))
    near = int(np.argmin(np.abs(grid.vehicle_temperature - grid.station.vehicle.start_temperature_c)))
    cell = int(np.clip(np.searchsorted(y, place, side="right") - 1, 0, len(y) - 2))
    share = (place - y[cell]) / (y[cell + 1] - y[cell])
    weights[cell, near], weights[cell + 1, near] = 1 - share, share
    return weights.ravel()


def service_limits(grid: Grid) -> list[tuple[float | None, float | None]]:
    """U is 0 at the highest finish pressure, and negative below it."""
    columns = len(grid.vehicle_temperature)
    free: list[tuple[float | None, float | None]] = [(-20_000.0, 0.0)] * (columns * (len(grid.pressure) - 1))
    return free + [(0.0, 0.0)] * columns
