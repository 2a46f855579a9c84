"""What is proved of potentials, whoever proposes them: prices that hold for every state and command of a second.

A potential is bilinear on each cell. Over a second a state moves from s by d(s), and the potential changes by the
integral of its gradient at the points x of that segment times d(s). So whatever bounds gradient(x) . d(s) for all
x of a cell and all s less than a second before it bounds the change over any second. Cells are cut into smaller ones
and every factor is taken at the worst end of its interval: no sampling, and the proposal's solver is not believed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.bounds.grid import Floats, Grid
from station.bounds.intervals import MARGIN, Interval, between, drift_range, largest_drift, product, refined, slopes

_BIN = 1.25
"""Width of a bin of the pressure a draw comes from [bar]."""

_STOCK_PARTS = (12, 16)
"""Parts of a cell of a buffer's reference pressure and of its temperature."""


@dataclass(frozen=True)
class Stock:
    """A proved potential of the three buffers [compressor-seconds].

    No second of filling raises a buffer's potential by more than 1, and no other second without a draw raises it.
    """

    values: tuple[Floats, Floats, Floats]  # at the nodes (pressure, temperature)
    boundary: float  # least of (final potential + restoring seconds - initial potential), all buffers
    used_most: float  # most that can be drawn from the initial stock, all buffers
    prices: Floats  # (bins, flows): least fall of the potential in a second that draws at these flows
    bins: Floats  # edges of the pressure of the buffer drawn from [bar]
    flows: Floats  # nodes [g/s]


def tidy(values: Floats, grid: Grid) -> Floats:
    """The least potential above a proposal that time cannot raise and that grows with mass.

    Temperature only ever moves towards the ambient one while the valves are closed, mass stays.
    """
    tidied, middle = values.copy(), grid.ambient
    tidied[:, middle:] = np.maximum.accumulate(values[:, middle:], axis=1)
    tidied[:, : middle + 1] = np.maximum.accumulate(values[:, middle::-1], axis=1)[:, ::-1]
    return np.asarray(np.maximum.accumulate(tidied, axis=0))


@dataclass(frozen=True)
class _Boxes:
    """Parts of the cells of one buffer, and the gradient of its potential on them, (reference, temperature)."""

    reference: Floats  # edges [bar]
    cold: Floats  # where seconds that pass a part may be, at the least [deg C]
    warm: Floats  # and at the most
    temperature: Floats  # edges [deg C]
    along: Interval  # a unit of the scale of reference pressure
    heat: Interval  # by the drift of temperature, a second

    @classmethod
    def of(cls, grid: Grid, values: Floats, heating: float) -> _Boxes:
        """The boxes of a potential in seconds that heat a buffer by `heating` [K/s], a draw by less than 0."""
        along, across = slopes(values, grid.z, grid.temperature, _STOCK_PARTS)
        t = refined(grid.temperature, _STOCK_PARTS[1])
        step = largest_drift(grid, abs(heating), grid.temperature)
        cold = np.maximum(t[:-1] - step, grid.temperature[0])
        warm = np.minimum(t[1:] + step, grid.temperature[-1])
        heat = product(across, drift_range(grid, heating, cold, warm))
        r = grid.reference_scale.pressure(refined(grid.z, _STOCK_PARTS[0]))
        return cls(r, cold, warm, t, along, heat)


def filling_gains(grid: Grid, buffer: int, values: Floats) -> Floats:
    """Most by which a second of filling raises the potential, for every admissible state; an array over the cells.

    A point of the segment lies above its start by at most what the second fills. At one temperature speed on the
    scale is monotone in pressure on either side of the bend, so it is largest at an end of a part or there.
    """
    plant, scale = grid.plant, grid.reference_scale
    boxes = _Boxes.of(grid, values, plant.inlet_heating[buffer])
    rate, top = grid.kappa[buffer] * plant.inlet_coefficient, plant.compressor_pressure
    theta, low, high = grid.theta(boxes.cold), boxes.reference[:-1, None], boxes.reference[1:, None]
    far = np.maximum(low - rate * top, 0.0)
    moved = rate * np.maximum(top - far * theta, 0.0)
    bend = np.clip(scale.end - scale.width, low, high)
    gaps = [np.maximum(top - (r - moved) * theta, 0.0) * scale.rate(r) for r in (low, high, bend)]
    speed = rate * np.maximum.reduce(gaps)
    gain = np.where(speed > 0, boxes.along[1] * speed + boxes.heat[1], -np.inf)
    parts = _STOCK_PARTS
    shape = len(grid.reference) - 1, parts[0], len(grid.temperature) - 1, parts[1]
    return np.asarray(gain.reshape(shape).max(axis=(1, 3)))


def _least(values: Floats, low: NDArray[np.int64], high: NDArray[np.int64]) -> Floats:
    """Least of rows low to high (inclusive) of `values`, a row of the result for each pair."""
    best = values[low]
    for offset in range(1, int((high - low).max()) + 1):
        best = np.minimum(best, values[np.minimum(low + offset, high)])
    return best


def draw_prices(grid: Grid, buffer: int, values: Floats, bins: Floats, flows: Floats) -> Floats:
    """Least fall of one buffer's potential in a second that draws from it, (bins of its pressure, flows).

    At a point of the segment whose pressure lies in a bin, a second at flow f takes f kappa of reference pressure
    and moves the temperature, so the rate of fall is at least gamma f - delta. The least over temperatures is concave
    in f: between nodes it lies above the straight line.
    """
    boxes = _Boxes.of(grid, values, -grid.plant.outlet_cooling[buffer])
    rate = grid.reference_scale.rate(boxes.reference[:-1, None])
    taken, heat = grid.kappa[buffer] * boxes.along[0] * rate, boxes.heat[1]
    theta, edges = grid.theta(boxes.temperature), boxes.reference
    best, count = np.full((len(bins) - 1, len(flows)), np.inf), len(edges) - 1
    for j in range(taken.shape[1]):
        low = np.searchsorted(edges, bins[:-1] / theta[j + 1], side="right") - 1
        high = np.searchsorted(edges, bins[1:] / theta[j], side="left") - 1
        reached = low < count
        low, high = np.clip(low, 0, count - 1), np.clip(np.maximum(high, low), 0, count - 1)
        price = taken[:, j : j + 1] * flows - heat[:, j : j + 1]
        best = np.minimum(best, np.where(reached[:, None], _least(price, low, high), np.inf))
    return best


def prove_stock(grid: Grid, proposed: list[Floats]) -> Stock:
    """A proved potential from proposed node values: made monotone, divided by the most a second of filling gains."""
    flows = np.geomspace(*grid.flow_range, 33) if grid.flow_range[0] > 0 else np.linspace(*grid.flow_range, 33)
    flows[0], flows[-1] = grid.flow_range
    bins = np.arange(0.0, grid.pressure_max + _BIN, _BIN)
    proved, boundary, used = [], 0.0, 0.0
    prices = np.full((len(bins) - 1, len(flows)), np.inf)
    for buffer in range(3):
        values = tidy(proposed[buffer], grid)
        values = values / (max(float(filling_gains(grid, buffer, values).max()), 1e-3) * (1 + MARGIN))
        proved.append(values)
        initial = grid.stock_value(values, *grid.start(buffer))
        boundary += _least_final(grid, buffer, values) - initial
        used += initial - _least_value(grid, buffer, values)
        prices = np.minimum(prices, draw_prices(grid, buffer, values, bins, flows))
    return Stock((proved[0], proved[1], proved[2]), boundary, used, prices, bins, flows)


def _least_final(grid: Grid, buffer: int, values: Floats) -> float:
    """Least of a buffer's final potential and its restoring seconds.

    Mass raises the potential and lowers the restoring seconds: each at the worst end of a part.
    """
    z = refined(grid.z, 64)
    potential = between(values, grid.z, z[:-1], 0).min(axis=1)
    return float((potential + grid.restoring(buffer, grid.reference_scale.pressure(z[1:]))).min())


def _least_value(grid: Grid, buffer: int, values: Floats) -> float:
    """Least a buffer's potential ever is."""
    return min(grid.stock_value(values, grid.lowest(buffer), float(node)) for node in grid.temperature)


def time_only(grid: Grid) -> Stock:
    """The potential that is zero: a second that draws costs nothing, so that only time is priced."""
    nothing = np.zeros((len(grid.reference), len(grid.temperature)))
    stock = prove_stock(grid, [nothing, nothing, nothing])
    return Stock(stock.values, 0.0, 0.0, np.maximum(stock.prices, 0.0), stock.bins, stock.flows)
