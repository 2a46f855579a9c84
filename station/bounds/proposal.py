"""Potentials proposed by linear programs: good guesses, proved by `station.bounds.proof` whatever they are.

The rows state, at corners of cells, what a proof needs of the node values. Rows of
draws are many and few matter, so they enter as they are violated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.sparse import csr_matrix, vstack

from station.bounds.grid import Floats, Grid
from station.bounds.proof import Stock, filling_gains, tidy
from station.plant import KELVIN

Ints = NDArray[np.int64]

_ROUNDS = 4
_VIOLATION = 0.004
_CUTS = 4000
_EXCESS = 0.006
_TILT = 3e-5


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


def _mesh(*counts: int) -> list[Ints]:
    return [axis.ravel() for axis in np.meshgrid(*(np.arange(count) for count in counts), indexing="ij")]


@dataclass(frozen=True)
class Layout:
    """Where the variables stand: potentials of the buffers, U, draw ceilings, boundary terms."""

    grid: Grid
    flows: Floats

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """Nodes of r, T, vehicle pressure and vehicle temperature."""
        g = self.grid
        return len(g.reference), len(g.temperature), len(g.pressure), len(g.vehicle_temperature)

    def stock(self, buffer: int, i: Ints, j: Ints) -> Ints:
        """A buffer's potential at nodes (i, j)."""
        rows, columns = self.shape[:2]
        return buffer * rows * columns + i * columns + j

    def service(self, i: Ints, j: Ints) -> Ints:
        """U at nodes (i, j)."""
        return 3 * self.shape[0] * self.shape[1] + i * self.shape[3] + j

    def ceiling(self, cell: Ints, end: int, flow: Ints) -> Ints:
        """Least that a draw must cost in a cell of vehicle pressure, at one of its ends and a node of flow."""
        rows, columns, first, second = self.shape
        return 3 * rows * columns + first * second + (2 * cell + end) * len(self.flows) + flow

    @property
    def boundary(self) -> int:
        """The first of three boundary terms."""
        return int(self.ceiling(np.int64(self.shape[2] - 1), 0, np.int64(0)))  # type: ignore[arg-type]  # one node

    @property
    def width(self) -> int:
        """Number of variables."""
        return self.boundary + 3


def _gap(grid: Grid, reference: Floats, temperature: Floats, width: Floats) -> Floats:
    """How far a buffer lies below the compressor's pressure [bar], a little more where a cell is too coarse for it.

    Between two temperatures the slope is a straight line and the gap another: their product exceeds that of the
    corners by the square of the relative change, so without this the proof would scale everything down.
    """
    moved = reference * width / (grid.plant.ambient_temperature + KELVIN)
    gap = grid.plant.compressor_pressure - reference * grid.theta(temperature)
    floored = np.maximum(gap, np.maximum(20.0, 1.5 * moved))
    return np.asarray(floored * (1 + 0.27 * (moved / floored) ** 2))


def _stock_rows(rows: Rows, layout: Layout, buffer: int, excess: Floats) -> None:
    """Filling gains at most 1, time and loss of mass nothing; the boundary term."""
    grid, plant = layout.grid, layout.grid.plant
    r, t = grid.reference, grid.temperature
    count, columns = layout.shape[:2]
    i, j = _mesh(count - 1, columns - 1)
    for a in (0, 1):
        for b in (0, 1):
            gap = _gap(grid, r[i + a], t[j + b], (t[j + 1] - t[j]))
            along = grid.kappa[buffer] * plant.inlet_coefficient * gap / (r[i + 1] - r[i])
            drift = plant.inlet_heating[buffer] + plant.heat_exchange * (plant.ambient_temperature - t[j + b])
            across = drift / (t[j + 1] - t[j])
            nodes = [(i + 1, j + b), (i, j + b), (i + a, j + 1), (i + a, j)]
            columns_of = [layout.stock(buffer, *node) for node in nodes]
            rows.add(columns_of, [along, -along, across, -across], 1 / excess[i, j])
    i, j = _mesh(count, columns - 1)
    sign = np.where(t[j] >= plant.ambient_temperature - 1e-9, 1.0, -1.0)
    rows.add([layout.stock(buffer, i, j), layout.stock(buffer, i, j + 1)], [sign, -sign], np.zeros(len(i)))
    i, j = _mesh(count - 1, columns)
    rows.add([layout.stock(buffer, i, j), layout.stock(buffer, i + 1, j)], [1.0, -1.0], np.zeros(len(i)))
    i, j = _mesh(count, columns)
    restoring = grid.restoring(buffer, r)
    reached = np.isfinite(restoring[i])
    i, j = i[reached], j[reached]
    start, temperature = grid.start(buffer)
    cell = min(int(np.searchsorted(r, start, side="right")) - 1, count - 2)
    share = (start - r[cell]) / (r[cell + 1] - r[cell])
    near = np.full(len(i), int(np.argmin(np.abs(t - temperature))))
    initial = [layout.stock(buffer, np.full(len(i), cell + k), near) for k in (0, 1)]
    term = np.full(len(i), layout.boundary + buffer)
    rows.add([term, layout.stock(buffer, i, j), *initial], [1.0, -1.0, 1 - share, share], restoring[i])


def _rises(grid: Grid, volume: float, i: Ints, j: Ints, corner: tuple[int, int], flow: float) -> tuple[Floats, Floats]:
    """Coefficients of U's differences along pressure and temperature in a second at `flow` (0: closed)."""
    plant, p, t = grid.plant, grid.pressure, grid.vehicle_temperature
    warm = t[j + corner[1]]
    drift = (plant.vehicle_heating if flow else 0.0) + plant.heat_exchange * (plant.ambient_temperature - warm)
    ratio = 1 + drift / (warm + KELVIN)
    rise = grid.bar_per_gram(volume) * grid.theta(warm) * ratio * flow + p[i + corner[0]] * (ratio - 1)
    return rise / (p[i + 1] - p[i]), drift / (t[j + 1] - t[j])


def _service_rows(rows: Rows, layout: Layout, price: float, volume: float) -> None:
    """U rises by at most the ceiling and the price of a second."""
    i, j = _mesh(layout.shape[2] - 1, layout.shape[3] - 1)
    for a, b in ((0, 0), (0, 1), (1, 0), (1, 1)):
        columns = [layout.service(*node) for node in ((i + 1, j + b), (i, j + b), (i + a, j + 1), (i + a, j))]
        for node, flow in enumerate((0.0, *layout.flows)):
            along, across = _rises(layout.grid, volume, i, j, (a, b), flow)
            extra = [layout.ceiling(i, a, np.full(len(i), node - 1))] if node else []
            values: list[Floats | float] = [along, -along, across, -across]
            values += [-1.0] if node else []
            rows.add([*columns, *extra], values, np.full(len(i), price))


def _draw_rows(rows: Rows, layout: Layout, buffer: int) -> None:
    """A draw costs at least the ceiling."""
    grid, plant, flows = layout.grid, layout.grid.plant, layout.flows
    r, t, p = grid.reference, grid.temperature, grid.pressure
    mesh = _mesh(len(r) - 1, len(t) - 1, len(p) - 1)
    for corner in range(8):
        a, b, end = corner & 1, corner >> 1 & 1, corner >> 2
        i, j, k = mesh
        warm, against = t[j + b], p[k + end]
        ends = [plant.outlet_coefficient * (r[i + side] * grid.theta(warm) - against) for side in (0, 1)]
        below = r[i] * grid.theta(warm) < grid.pressure_max
        met = (ends[1] >= flows[0]) & (ends[0] <= flows[-1]) & below
        i, j, k, warm = i[met], j[met], k[met], warm[met]
        flow = np.clip(ends[a][met], flows[0], flows[-1])
        node = np.clip(np.searchsorted(flows, flow) - 1, 0, len(flows) - 2)
        share = (flow - flows[node]) / (flows[node + 1] - flows[node])
        drift = -plant.outlet_cooling[buffer] + plant.heat_exchange * (plant.ambient_temperature - warm)
        along, across = grid.kappa[buffer] * flow / (r[i + 1] - r[i]), drift / (t[j + 1] - t[j])
        nodes = [(i + 1, j + b), (i, j + b), (i + a, j + 1), (i + a, j)]
        columns = [layout.ceiling(k, end, node), layout.ceiling(k, end, node + 1)]
        columns += [layout.stock(buffer, *item) for item in nodes]
        rows.add(columns, [1 - share, share, -along, along, across, -across], np.zeros(len(i)))


class Proposer:
    """Linear programs of one station, with what earlier ones learned of the rows that matter."""

    def __init__(self, grid: Grid, volume: float, start: float, vehicles: int) -> None:
        low, high = grid.flow_range
        flows = np.geomspace(max(low, 0.02 * high), high, grid.resolution.flows)
        flows[0] = low
        self.layout = Layout(grid, flows)
        self.volume, self.start, self.vehicles = volume, start, vehicles
        draws = Rows(self.layout.width)
        for buffer in range(3):
            _draw_rows(draws, self.layout, buffer)
        self._draws, self._draw_bounds = draws.system()
        self._active = np.zeros(draws.count, dtype=bool)
        shape = self.layout.shape
        self._excess = [np.ones((shape[0] - 1, shape[1] - 1)) for _ in range(3)]
        self._active[:: max(1, draws.count // 30_000)] = True

    def propose(self, price: float) -> list[Floats]:
        """Potentials of the buffers that make the bound at `price` [1] large, as node values."""
        layout = self.layout
        cost, limits = self._objective()
        best = np.zeros(layout.width)
        for _ in range(_ROUNDS):
            rows = Rows(layout.width)
            for buffer in range(3):
                _stock_rows(rows, layout, buffer, self._excess[buffer])
            _service_rows(rows, layout, price, self.volume)
            matrix, bound = rows.system()
            system = vstack([matrix, self._draws[self._active]])
            right = np.concatenate((bound, self._draw_bounds[self._active]))
            found = linprog(cost, system, right, bounds=limits, method="highs-ipm")
            if found.x is None:
                break
            best = found.x
            violation = self._draws @ best - self._draw_bounds
            excess = self._measure(best)
            if violation.max() < _VIOLATION and excess < _EXCESS:
                break
            self._active[np.argsort(-violation)[: min(_CUTS, int((violation > _VIOLATION / 2).sum()))]] = True
        return self._stocks(best)

    def _stocks(self, found: Floats) -> list[Floats]:
        """The buffers' node values in a solution."""
        shape = self.layout.shape[:2]
        nodes = shape[0] * shape[1]
        return [found[buffer * nodes : (buffer + 1) * nodes].reshape(shape) for buffer in range(3)]

    def _measure(self, found: Floats) -> float:
        """Note where a second of filling gains more than 1 by the proof's measure, for the next round; the most."""
        worst = 0.0
        for buffer, values in enumerate(self._stocks(found)):
            gains = np.maximum(filling_gains(self.layout.grid, buffer, tidy(values, self.layout.grid)), 1.0)
            self._excess[buffer] *= gains
            worst = max(worst, float(gains.max()) - 1)
        return worst

    def _objective(self) -> tuple[Floats, list[tuple[float | None, float | None]]]:
        """U at the start, as often as there are vehicles, and the boundary terms; the normalisation."""
        grid, layout = self.layout.grid, self.layout
        first = 3 * layout.shape[0] * layout.shape[1]
        last = first + layout.shape[2] * layout.shape[3]
        cost = np.zeros(layout.width)
        cost[first:last] = self.vehicles * _start_weights(grid, self.start)
        cost[layout.boundary :] = -1.0
        middle = int(np.argmin(np.abs(grid.temperature - grid.plant.ambient_temperature)))
        tilt = np.zeros(layout.shape[:2])
        tilt[:, 0] += 1.0
        tilt[:, -1] += 1.0
        tilt[:, middle] -= 2.0
        cost[:first] += _TILT * self.vehicles * np.tile(tilt.ravel(), 3)
        limits: list[tuple[float | None, float | None]] = [(None, None)] * layout.width
        for buffer in range(3):
            limits[buffer * layout.shape[0] * layout.shape[1]] = (0.0, 0.0)
        limits[first:last] = _service_limits(grid)
        limits[last : layout.boundary] = [(0.0, None)] * (layout.boundary - last)
        return cost, limits


def _start_weights(grid: Grid, start: float) -> Floats:
    """Weights of the nodes of U in its value at a start pressure [bar] and the usual temperature."""
    weights = np.zeros((len(grid.pressure), len(grid.vehicle_temperature)))
    near = int(np.argmin(np.abs(grid.vehicle_temperature - grid.station.vehicle.start_temperature_c)))
    cell = int(np.clip(np.searchsorted(grid.pressure, start, side="right") - 1, 0, len(grid.pressure) - 2))
    share = (start - grid.pressure[cell]) / (grid.pressure[cell + 1] - grid.pressure[cell])
    weights[cell, near], weights[cell + 1, near] = 1 - share, share
    return weights.ravel()


def _service_limits(grid: Grid) -> list[tuple[float | None, float | None]]:
    """U is 0 at the highest finish pressure, and negative below it."""
    columns = len(grid.vehicle_temperature)
    free: list[tuple[float | None, float | None]] = [(-20_000.0, 0.0)] * (columns * (len(grid.pressure) - 1))
    return free + [(0.0, 0.0)] * columns


def propose_service(grid: Grid, stock: Stock, price: float, volume: float, start: float) -> Floats:
    """U at the nodes, as large a gain as the prices of a proved stock and `price` allow."""
    count, columns = len(grid.pressure), len(grid.vehicle_temperature)
    rows = Rows(count * columns)
    i, j = _mesh(count - 1, columns - 1)
    low, high = grid.flow_range
    flows = np.geomspace(max(low, 0.02 * high), high, 36)
    flows[0] = low
    for a, b in ((0, 0), (0, 1), (1, 0), (1, 1)):
        nodes = [node[0] * columns + node[1] for node in ((i + 1, j + b), (i, j + b), (i + a, j + 1), (i + a, j))]
        for flow in (0.0, *flows):
            along, across = _rises(grid, volume, i, j, (a, b), flow)
            bound = np.zeros(len(i)) if flow == 0 else _ceiling(grid, stock, grid.pressure[i + a], flow)
            met = np.isfinite(bound)
            values = [np.broadcast_to(v, i.shape)[met] for v in (along, -along, across, -across)]
            rows.add([node[met] for node in nodes], values, bound[met] + price)
    matrix, bound = rows.system()
    found = linprog(_start_weights(grid, start), matrix, bound, bounds=_service_limits(grid), method="highs-ds")
    best = np.zeros(count * columns) if found.x is None else found.x
    return np.asarray(best.reshape(count, columns))


def _ceiling(grid: Grid, stock: Stock, pressure: Floats, flow: float) -> Floats:
    """Least price of a draw at a flow into a vehicle at these pressures, the buffer's bin being known to one."""
    node = int(np.clip(np.searchsorted(stock.flows, flow, side="right") - 1, 0, len(stock.flows) - 2))
    share = (flow - stock.flows[node]) / (stock.flows[node + 1] - stock.flows[node])
    low, high = stock.prices[:, node], stock.prices[:, node + 1]
    with np.errstate(invalid="ignore"):
        price = np.where(np.isfinite(low), (1 - share) * low + share * high, np.inf)
    bins = np.searchsorted(stock.bins, pressure + flow / grid.plant.outlet_coefficient, side="right") - 1
    near = [np.clip(bins + shift, 0, len(price) - 1) for shift in (-1, 0, 1)]
    found = np.minimum.reduce([price[index] for index in near])
    return np.where(bins < len(price), found, np.inf)
