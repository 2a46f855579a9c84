"""Gradients of a potential on parts of the cells of its grid, as intervals, and the drift of temperatures."""

from __future__ import annotations

import numpy as np

from station.bounds.grid import Floats, Grid
from station.plant import exchange_rate

MARGIN = 1e-9
"""Relative safety of every proved figure against rounding in its own evaluation."""

Interval = tuple[Floats, Floats]


def product(first: Interval, second: Interval) -> Interval:
    """All products of numbers of two intervals."""
    corners = [a * b for a in first for b in second]
    return np.minimum.reduce(corners), np.maximum.reduce(corners)


def refined(nodes: Floats, parts: int) -> Floats:
    """Nodes with `parts` equal cells in each cell."""
    fine = nodes[:-1, None] + np.diff(nodes)[:, None] * (np.arange(parts) / parts)
    return np.append(fine.ravel(), nodes[-1])


def between(values: Floats, nodes: Floats, at: Floats, axis: int) -> Floats:
    """Linear interpolation along an axis."""
    cell = np.clip(np.searchsorted(nodes, at, side="right") - 1, 0, len(nodes) - 2)
    share = (at - nodes[cell]) / (nodes[cell + 1] - nodes[cell])
    shape = [1] * values.ndim
    shape[axis] = len(at)
    share = share.reshape(shape)
    return (1 - share) * np.take(values, cell, axis) + share * np.take(values, cell + 1, axis)


def _ends(values: Floats, axis: int) -> Interval:
    """Least and largest of neighbours along an axis."""
    count = values.shape[axis]
    low, high = np.take(values, range(count - 1), axis), np.take(values, range(1, count), axis)
    return np.minimum(low, high), np.maximum(low, high)


def slopes(values: Floats, first: Floats, second: Floats, parts: tuple[int, int]) -> tuple[Interval, Interval]:
    """Intervals of both partial derivatives on each part of each cell."""
    along = np.repeat(np.diff(values, axis=0) / np.diff(first)[:, None], parts[0], axis=0)
    across = np.repeat(np.diff(values, axis=1) / np.diff(second), parts[1], axis=1)
    fine_first, fine_second = refined(first, parts[0]), refined(second, parts[1])
    return _ends(between(along, second, fine_second, 1), 1), _ends(between(across, first, fine_first, 0), 0)


def drift_range(grid: Grid, heating: float, low: Floats, high: Floats) -> Interval:
    """Change of temperature in a second [K] at `heating` [K/s] from temperatures between `low` and `high`."""
    plant = grid.plant
    return heating + exchange_rate(high, plant), heating + exchange_rate(low, plant)


def largest_drift(grid: Grid, heating: float, nodes: Floats) -> float:
    """The largest change of temperature in a second on a domain [K]."""
    plant = grid.plant
    away = max(plant.ambient_temperature - nodes[0], nodes[-1] - plant.ambient_temperature)
    return heating + plant.heat_exchange * float(away)
