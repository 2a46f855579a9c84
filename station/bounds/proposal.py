"""Potentials proposed by linear programs: good guesses, proved by `station.bounds.proof` whatever they are.

The rows state, at corners of cells, what a proof needs of the node values. Rows of
draws are many and few matter, so they enter as they are violated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.sparse import vstack

from station.bounds.grid import Floats, Grid
from station.bounds.proof import filling_gains, tidy
from station.bounds.rows import CORNERS, Ints, Rows, corner_nodes, mesh, rises, service_limits, start_weights

_ROUNDS = 6
_VIOLATION = 0.004
_CUTS = 4000
_EXCESS = 0.006
_TILT = 3e-5
_NEAR = 1.12


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


def _stock_rows(rows: Rows, layout: Layout, buffer: int, excess: Floats) -> None:
    """Filling gains at most 1, time nothing; potentials grow with pressure."""
    grid, plant = layout.grid, layout.grid.plant
    r, t, z = grid.reference, grid.temperature, grid.z
    count, columns = layout.shape[:2]
    i, j = mesh(count - 1, columns - 1)
    for corner in CORNERS:
        pressure, warm = r[i + corner[0]], t[j + corner[1]]
        gap = np.maximum(plant.compressor_pressure - pressure * grid.theta(warm), 0.0) * grid.reference_scale.rate(
            pressure
        )
        along = grid.kappa[buffer] * plant.inlet_coefficient * gap / (z[i + 1] - z[i])
        drift = plant.inlet_heating[buffer] + plant.heat_exchange * (plant.ambient_temperature - warm)
        across = drift / (t[j + 1] - t[j])
        nodes = [layout.stock(buffer, *node) for node in corner_nodes(i, j, corner)]
        rows.add(nodes, [along, -along, across, -across], 1 / excess[i, j])
    i, j = mesh(count, columns - 1)
    sign = np.where(t[j] >= plant.ambient_temperature - 1e-9, 1.0, -1.0)
    rows.add([layout.stock(buffer, i, j), layout.stock(buffer, i, j + 1)], [sign, -sign], np.zeros(len(i)))
    i, j = mesh(count - 1, columns)
    rows.add([layout.stock(buffer, i, j), layout.stock(buffer, i + 1, j)], [1.0, -1.0], np.zeros(len(i)))


def _boundary_rows(rows: Rows, layout: Layout, buffer: int) -> None:
    """The boundary term is at most a final potential and its restoring seconds, less the initial potential."""
    grid, z = layout.grid, layout.grid.z
    i, j = mesh(*layout.shape[:2])
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


def _service_rows(rows: Rows, layout: Layout, number: int, price: float, volume: float) -> None:
    """A price's U rises by at most the ceiling and the price of a second."""
    grid, t, y = layout.grid, layout.grid.vehicle_temperature, layout.grid.y
    i, j = mesh(layout.shape[2] - 1, layout.shape[3] - 1)
    for a, b in CORNERS:
        columns = [layout.service(number, *node) for node in corner_nodes(i, j, (a, b))]
        for node, flow in enumerate((0.0, *layout.flows)):
            rise, drift = rises(grid, volume, grid.pressure[i + a], t[j + b], np.full(len(i), flow))
            along, across = rise / (y[i + 1] - y[i]), drift / (t[j + 1] - t[j])
            extra = [layout.ceiling(i, a, np.full(len(i), node - 1))] if node else []
            values: list[Floats | float] = [along, -along, across, -across]
            values += [-1.0] if node else []
            rows.add([*columns, *extra], values, np.full(len(i), price))


def _draw_rows(rows: Rows, layout: Layout, buffer: int) -> tuple[Floats, Floats]:
    """A draw costs at least the ceiling; of each row the vehicle's pressure and the flow."""
    grid, plant, flows = layout.grid, layout.grid.plant, layout.flows
    r, t, z, against = grid.reference, grid.temperature, grid.z, grid.pressure
    every = mesh(len(r) - 1, len(t) - 1, len(against) - 1)
    pressures, drawn = [], []
    for number in range(8):
        corner, end = (number & 1, number >> 1 & 1), number >> 2
        i, j, k = every
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
        columns += [layout.stock(buffer, *item) for item in corner_nodes(i, j, corner)]
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
                found = linprog(cost, system, right, bounds=limits, method="highs-ds")
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
        cost[first:last] = np.tile(each * start_weights(grid, self.start), layout.services)
        cost[layout.boundary :] = -1.0
        tilt = np.zeros(layout.shape[:2])
        tilt[:, 0] += 1.0
        tilt[:, -1] += 1.0
        tilt[:, grid.ambient] -= 2.0
        cost[:first] += _TILT * self.vehicles * np.tile(tilt.ravel(), 3)
        limits: list[tuple[float | None, float | None]] = [(None, None)] * layout.width
        for buffer in range(3):
            limits[buffer * layout.shape[0] * layout.shape[1]] = (0.0, 0.0)
        limits[first:last] = service_limits(grid) * layout.services
        limits[last : layout.boundary] = [(0.0, None)] * (layout.boundary - last)
        return cost, limits
