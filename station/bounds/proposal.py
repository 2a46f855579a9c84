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
from station.bounds.proof import Stock, filling_gains, service_rises, tidy, tidy_service
from station.plant import KELVIN

Ints = NDArray[np.int64]

_ROUNDS = 6
_VIOLATION = 0.004
_CUTS = 4000
_EXCESS = 0.006
_TILT = 3e-5
_SERVICE_ROUNDS = 6
_SERVICE_EXCESS = 1e-4
_KEPT = 10
_NEAR = 1.12
_CUT_ROUNDS = 6
_FREE = 1e6


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
    """Where the variables stand: potentials of the buffers, a U for each price, draw ceilings, boundary terms."""

    grid: Grid
    flows: Floats
    services: int  # prices of a connected second that one potential is to serve

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """Nodes of a buffer's pressure and temperature, of a vehicle's pressure and temperature."""
        g = self.grid
        return len(g.reference), len(g.temperature), len(g.pressure), len(g.vehicle_temperature)

    def stock(self, buffer: int, i: Ints, j: Ints) -> Ints:
        """A buffer's potential at nodes (i, j)."""
        rows, columns = self.shape[:2]
        return buffer * rows * columns + i * columns + j

    def service(self, number: int, i: Ints, j: Ints) -> Ints:
        """A price's U at nodes (i, j)."""
        rows, columns, first, second = self.shape
        return 3 * rows * columns + number * first * second + i * second + j

    def ceiling(self, cell: Ints, end: int, flow: Ints) -> Ints:
        """Least that a draw must cost in a cell of vehicle pressure, at one of its ends and a node of flow."""
        rows, columns, first, second = self.shape
        before = 3 * rows * columns + self.services * first * second
        return before + (2 * cell + end) * len(self.flows) + flow

    @property
    def boundary(self) -> int:
        """The first of three boundary terms."""
        return int(self.ceiling(np.int64(self.shape[2] - 1), 0, np.int64(0)))  # type: ignore[arg-type]  # one node

    @property
    def width(self) -> int:
        """Number of variables."""
        return self.boundary + 3


def _corner_nodes(i: Ints, j: Ints, corner: tuple[int, int]) -> list[tuple[Ints, Ints]]:
    """Nodes of the difference along pressure, then of that along temperature, at a corner of cells (i, j)."""
    a, b = corner
    return [(i + 1, j + b), (i, j + b), (i + a, j + 1), (i + a, j)]


_CORNERS = ((0, 0), (0, 1), (1, 0), (1, 1))


def _stock_rows(rows: Rows, layout: Layout, buffer: int, excess: Floats) -> None:
    """Filling gains at most 1, time nothing; potentials grow with pressure."""
    grid, plant = layout.grid, layout.grid.plant
    r, t, z = grid.reference, grid.temperature, grid.z
    count, columns = layout.shape[:2]
    i, j = _mesh(count - 1, columns - 1)
    for corner in _CORNERS:
        pressure, warm = r[i + corner[0]], t[j + corner[1]]
        gap = np.maximum(plant.compressor_pressure - pressure * grid.theta(warm), 0.0) * grid.reference_scale.rate(
            pressure
        )
        along = grid.kappa[buffer] * plant.inlet_coefficient * gap / (z[i + 1] - z[i])
        drift = plant.inlet_heating[buffer] + plant.heat_exchange * (plant.ambient_temperature - warm)
        across = drift / (t[j + 1] - t[j])
        nodes = [layout.stock(buffer, *node) for node in _corner_nodes(i, j, corner)]
        rows.add(nodes, [along, -along, across, -across], 1 / excess[i, j])
    i, j = _mesh(count, columns - 1)
    sign = np.where(t[j] >= plant.ambient_temperature - 1e-9, 1.0, -1.0)
    rows.add([layout.stock(buffer, i, j), layout.stock(buffer, i, j + 1)], [sign, -sign], np.zeros(len(i)))
    i, j = _mesh(count - 1, columns)
    rows.add([layout.stock(buffer, i, j), layout.stock(buffer, i + 1, j)], [1.0, -1.0], np.zeros(len(i)))


def _boundary_rows(rows: Rows, layout: Layout, buffer: int) -> None:
    """The boundary term is at most a final potential and its restoring seconds, less the initial potential."""
    grid, z = layout.grid, layout.grid.z
    i, j = _mesh(*layout.shape[:2])
    restoring = grid.restoring(buffer, grid.reference[i])
    reached = np.isfinite(restoring)
    i, j = i[reached], j[reached]
    start, temperature = grid.start(buffer)
    place = float(grid.reference_scale.position(np.array([start]))[0])
    cell = min(int(np.searchsorted(z, place, side="right")) - 1, len(z) - 2)
    share = (place - z[cell]) / (z[cell + 1] - z[cell])
    near = np.full(len(i), int(np.argmin(np.abs(grid.temperature - temperature))))
    initial = [layout.stock(buffer, np.full(len(i), cell + k), near) for k in (0, 1)]
    term = np.full(len(i), layout.boundary + buffer)
    rows.add([term, layout.stock(buffer, i, j), *initial], [1.0, -1.0, 1 - share, share], restoring[reached])


def _rises(grid: Grid, volume: float, pressure: Floats, warm: Floats, flow: Floats) -> tuple[Floats, Floats]:
    """What a second at `flow` (0: closed) adds to a vehicle's place on its scale, and to its temperature [K]."""
    plant = grid.plant
    drift = np.where(flow > 0, plant.vehicle_heating, 0.0) + plant.heat_exchange * (plant.ambient_temperature - warm)
    ratio = 1 + drift / (warm + KELVIN)
    rise = grid.bar_per_gram(volume) * grid.theta(warm) * ratio * flow + pressure * (ratio - 1)
    return np.asarray(rise * grid.pressure_scale.rate(pressure)), np.asarray(drift)


def _service_rows(rows: Rows, layout: Layout, number: int, price: float, volume: float) -> None:
    """A price's U rises by at most the ceiling and the price of a second."""
    grid, t, y = layout.grid, layout.grid.vehicle_temperature, layout.grid.y
    i, j = _mesh(layout.shape[2] - 1, layout.shape[3] - 1)
    for a, b in ((0, 0), (0, 1), (1, 0), (1, 1)):
        columns = [layout.service(number, *node) for node in ((i + 1, j + b), (i, j + b), (i + a, j + 1), (i + a, j))]
        for node, flow in enumerate((0.0, *layout.flows)):
            rise, drift = _rises(grid, volume, grid.pressure[i + a], t[j + b], np.full(len(i), flow))
            along, across = rise / (y[i + 1] - y[i]), drift / (t[j + 1] - t[j])
            extra = [layout.ceiling(i, a, np.full(len(i), node - 1))] if node else []
            values: list[Floats | float] = [along, -along, across, -across]
            values += [-1.0] if node else []
            rows.add([*columns, *extra], values, np.full(len(i), price))


def _draw_rows(rows: Rows, layout: Layout, buffer: int) -> tuple[Floats, Floats]:
    """A draw costs at least the ceiling; of each row the vehicle's pressure and the flow."""
    grid, plant, flows = layout.grid, layout.grid.plant, layout.flows
    r, t, z, against = grid.reference, grid.temperature, grid.z, grid.pressure
    mesh = _mesh(len(r) - 1, len(t) - 1, len(against) - 1)
    pressures, drawn = [], []
    for number in range(8):
        corner, end = (number & 1, number >> 1 & 1), number >> 2
        i, j, k = mesh
        warm = t[j + corner[1]]
        theta = grid.theta(warm)
        ends = [plant.outlet_coefficient * (r[i + side] * theta - against[k + end]) for side in (0, 1)]
        met = (ends[1] >= flows[0]) & (ends[0] <= flows[-1])
        i, j, k, warm, theta = i[met], j[met], k[met], warm[met], theta[met]
        flow = np.clip(ends[corner[0]][met], flows[0], flows[-1])
        node = np.clip(np.searchsorted(flows, flow) - 1, 0, len(flows) - 2)
        share = (flow - flows[node]) / (flows[node + 1] - flows[node])
        reference = (against[k + end] + flow / plant.outlet_coefficient) / theta
        along = grid.kappa[buffer] * flow * grid.reference_scale.rate(reference) / (z[i + 1] - z[i])
        drift = -plant.outlet_cooling[buffer] + plant.heat_exchange * (plant.ambient_temperature - warm)
        across = drift / (t[j + 1] - t[j])
        columns = [layout.ceiling(k, end, node), layout.ceiling(k, end, node + 1)]
        columns += [layout.stock(buffer, *item) for item in _corner_nodes(i, j, corner)]
        values = [1 - share, share, -along, along, across, -across]
        rows.add(columns, values, np.zeros(len(i)))
        pressures.append(against[k + end])
        drawn.append(flow)
    return np.concatenate(pressures), np.concatenate(drawn)


class Proposer:
    """Linear programs of one station, with what earlier ones learned of the rows that matter."""

    def __init__(self, grid: Grid, volume: float, start: float, vehicles: int, services: int) -> None:
        low, high = grid.flow_range
        flows = np.geomspace(max(low, 0.02 * high), high, grid.resolution.flows)
        flows[0] = low
        self.layout = Layout(grid, flows, services)
        self.volume, self.start, self.vehicles = volume, start, vehicles
        draws = Rows(self.layout.width)
        met = [_draw_rows(draws, self.layout, buffer) for buffer in range(3)]
        self._against, self._drawn = (np.concatenate(part) for part in zip(*met, strict=True))
        self._draws, self._draw_bounds = draws.system()
        shape = self.layout.shape
        self._excess = [np.ones((shape[0] - 1, shape[1] - 1)) for _ in range(3)]

    def propose(self, prices: Sequence[float]) -> list[Floats]:
        """Potentials of the buffers that make the bound large if equally many vehicles pay each price, as node values.

        A price is in compressor-seconds a connected second.
        """
        layout = self.layout
        cost, limits = self._objective()
        best, active = np.zeros(layout.width), self._promising(max(prices)) | self._promising(min(prices))
        for _ in range(_ROUNDS):
            rows = Rows(layout.width)
            for buffer in range(3):
                _stock_rows(rows, layout, buffer, self._excess[buffer])
                _boundary_rows(rows, layout, buffer)
            for number, price in enumerate(prices):
                _service_rows(rows, layout, number, price, self.volume)
            matrix, bound = rows.system()
            system = vstack([matrix, self._draws[active]])
            right = np.concatenate((bound, self._draw_bounds[active]))
            found = linprog(cost, system, right, bounds=limits, method="highs-ipm")
            if found.x is None:
                break
            best = found.x
            violation = self._draws @ best - self._draw_bounds
            excess = self._measure(best)
            if violation.max() < _VIOLATION and excess < _EXCESS:
                break
            active[np.argsort(-violation)[: min(_CUTS, int((violation > _VIOLATION / 2).sum()))]] = True
        return self._stocks(best)

    def _promising(self, price: float) -> NDArray[np.bool_]:
        """The rows of draws that would be nearly the cheapest [1/g] if potentials counted seconds of filling."""
        plant = self.layout.grid.plant

        def paid(pressure: Floats, flow: Floats) -> Floats:
            gap = plant.compressor_pressure - pressure - flow / plant.outlet_coefficient
            return np.asarray(1 / (plant.inlet_coefficient * np.maximum(gap, 1.0)) + price / flow)

        nodes = self.layout.grid.pressure
        flows = np.geomspace(float(self.layout.flows[0]), float(self.layout.flows[-1]), 200)
        least = paid(nodes[:, None], flows).min(axis=1)
        return np.asarray(paid(self._against, self._drawn) < _NEAR * np.interp(self._against, nodes, least))

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
        last = first + layout.services * layout.shape[2] * layout.shape[3]
        cost = np.zeros(layout.width)
        each = self.vehicles / layout.services
        cost[first:last] = np.tile(each * _start_weights(grid, self.start), layout.services)
        cost[layout.boundary :] = -1.0
        tilt = np.zeros(layout.shape[:2])
        tilt[:, 0] += 1.0
        tilt[:, -1] += 1.0
        tilt[:, grid.ambient] -= 2.0
        cost[:first] += _TILT * self.vehicles * np.tile(tilt.ravel(), 3)
        limits: list[tuple[float | None, float | None]] = [(None, None)] * layout.width
        for buffer in range(3):
            limits[buffer * layout.shape[0] * layout.shape[1]] = (0.0, 0.0)
        limits[first:last] = _service_limits(grid) * layout.services
        limits[last : layout.boundary] = [(0.0, None)] * (layout.boundary - last)
        return cost, limits


def _start_weights(grid: Grid, start: float) -> Floats:
    """Weights of the nodes of U in its value at a start pressure [bar] and the usual temperature."""
    y = grid.y
    place = float(grid.pressure_scale.position(np.array([start]))[0])
    weights = np.zeros((len(y), len(grid.vehicle_temperature)))
    near = int(np.argmin(np.abs(grid.vehicle_temperature - grid.station.vehicle.start_temperature_c)))
    cell = int(np.clip(np.searchsorted(y, place, side="right") - 1, 0, len(y) - 2))
    share = (place - y[cell]) / (y[cell + 1] - y[cell])
    weights[cell, near], weights[cell + 1, near] = 1 - share, share
    return weights.ravel()


def _service_limits(grid: Grid) -> list[tuple[float | None, float | None]]:
    """U is 0 at the highest finish pressure, and negative below it."""
    columns = len(grid.vehicle_temperature)
    free: list[tuple[float | None, float | None]] = [(-20_000.0, 0.0)] * (columns * (len(grid.pressure) - 1))
    return free + [(0.0, 0.0)] * columns


class ServiceProposer:
    """Linear programs for U over the prices of proved stocks; their rows serve every stock and price of a grid."""

    def __init__(self, grid: Grid, volume: tuple[float, float], start: float) -> None:
        self.grid, self.volume, self.start = grid, volume, start
        low, high = grid.flow_range
        self._flows = np.geomspace(max(low, 0.02 * high), high, 100)
        self._flows[0] = low
        self._shares = np.linspace(0.0, 1.0, 6)
        closed, self._closed_cells, self._closed_weights = self._closed_rows()
        self._closed, self._closed_bounds = closed.system()
        drawn, self._open_cells, self._pressures, self._nodes, self._speeds = self._open_rows()
        self._open, _ = drawn.system()

    def propose(self, stock: Stock, price: float) -> Floats:
        """U at the nodes, as large a gain as the prices of a proved stock and `price` allow.

        What the proof finds above the price in a cell of pressure is taken off there, and the program solved anew.
        """
        shape = len(self.grid.pressure), len(self.grid.vehicle_temperature)
        ceilings = [_ceiling(self.grid, stock, self._pressures, flow) for flow in self._flows]
        limits = np.stack(ceilings)[self._nodes, np.arange(len(self._nodes))]
        limits = np.where(np.isfinite(limits), limits, _FREE) + price
        active = self._tightest(limits)
        off, drawn_off = np.zeros(shape[0] - 1), np.zeros(shape[0] - 1)
        best, least = np.zeros(shape), np.inf
        for _ in range(_SERVICE_ROUNDS):
            closed = price - off[self._closed_cells] * self._closed_weights
            found = self._solve(closed, limits - drawn_off[self._open_cells], active)
            if found is None:
                break
            values = tidy_service(found.reshape(shape))
            over = [np.maximum(part - price, 0.0) for part in service_rises(self.grid, stock, values, self.volume)]
            worst = max(float(part.max()) for part in over)
            if worst < least:
                best, least = values, worst
            if worst < _SERVICE_EXCESS:
                break
            off, drawn_off = off + over[0], drawn_off + over[1]
        return best

    def _solve(self, closed: Floats, limits: Floats, active: NDArray[np.bool_]) -> Floats | None:
        """Node values, rows of draws added as they are violated; None if there is no solution."""
        cost, box = _start_weights(self.grid, self.start), _service_limits(self.grid)
        best = None
        for _ in range(_CUT_ROUNDS):
            system = vstack([self._closed, self._open[active]])
            found = linprog(cost, system, np.concatenate((closed, limits[active])), bounds=box, method="highs-ds")
            if found.x is None:
                return best
            best = np.asarray(found.x)
            violated = self._open @ best - limits
            worst = np.argsort(-violated)[:_CUTS]
            if violated[worst[0]] < _SERVICE_EXCESS / 4:
                break
            active[worst[violated[worst] > 0]] = True
        return best

    def _tightest(self, limits: Floats) -> NDArray[np.bool_]:
        """The rows of draws to begin with: of each cell and corner those that leave a slope the least room."""
        count = len(self._flows) * len(self._shares)
        order = np.argsort((limits / self._speeds).reshape(-1, count), axis=1)[:, :_KEPT]
        active = np.zeros(limits.shape, dtype=bool)
        active[(order + count * np.arange(len(order))[:, None]).ravel()] = True
        return active

    def _closed_rows(self) -> tuple[Rows, Ints, Floats]:
        """In a second with closed outlets; the cell of each row and its drift as a share of the fastest."""
        grid, t, y = self.grid, self.grid.vehicle_temperature, self.grid.y
        rows = Rows(len(y) * len(t))
        i, j = _mesh(len(y) - 1, len(t) - 1)
        weights = []
        for a, b in _CORNERS:
            rise, drift = _rises(grid, self.volume[1], grid.pressure[i + a], t[j + b], np.zeros(len(i)))
            along, across = rise / (y[i + 1] - y[i]), drift / (t[j + 1] - t[j])
            nodes = [node[0] * len(t) + node[1] for node in _corner_nodes(i, j, (a, b))]
            rows.add(nodes, [along, -along, across, -across], np.zeros(len(i)))
            weights.append(np.abs(drift))
        weight = np.concatenate(weights)
        return rows, np.tile(i, len(_CORNERS)), weight / max(float(weight.max()), 1e-12)

    def _open_rows(self) -> tuple[Rows, Ints, Floats, Ints, Floats]:
        """In a second that draws; of each row the cell, the pressure, the node of flow and the rise on the scale."""
        grid, t, y = self.grid, self.grid.vehicle_temperature, self.grid.y
        columns = len(t)
        i, j, b, s, node = _mesh(len(y) - 1, columns - 1, 2, len(self._shares), len(self._flows))
        share = self._shares[s]
        pressure = grid.pressure_scale.pressure(y[i] + share * (y[i + 1] - y[i]))
        rise, drift = _rises(grid, self.volume[1], pressure, t[j + b], self._flows[node])
        along, across = rise / (y[i + 1] - y[i]), drift / (t[j + 1] - t[j])
        first, second, corner = (1 - share) * across, share * across, i * columns + j
        rows = Rows(len(y) * columns)
        nodes = [corner + columns + b, corner + b, corner + 1, corner, corner + columns + 1, corner + columns]
        rows.add(nodes, [along, -along, first, -first, second, -second], np.zeros(len(i)))
        return rows, i, pressure, node, rise


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
