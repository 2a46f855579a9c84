"""Potentials proposed by linear programs: good guesses, proved by `station.bounds.proof` whatever they are.

The rows state, at points of cells, what a proof needs of the splines. Rows of draws are many and few matter, so they
enter as they are violated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import block_diag, csr_matrix, eye, hstack, vstack

from station.bounds.drift import drift
from station.bounds.grid import Grid
from station.bounds.linear import nearly_least
from station.bounds.proof import filling_gains, tidy
from station.bounds.rows import SHARES, Ints, Rows, Samples, bends, growing, mesh, rises, service_limits, start_weights
from station.bounds.spline import Floats

_ROUNDS = 6
_VIOLATION = 0.004
_CUTS = 4000
_EXCESS = 0.004
_TILT = 3e-5
_BEND = 2e-5
_SIZE = 2e-6
_NEAR = 1.12


@dataclass(frozen=True)
class Layout:
    """Positions of the variables: potentials of the buffers, a U for each price, draw ceilings, boundary terms."""

    grid: Grid
    flows: Floats
    services: int  # prices of a connected second that one potential is to serve

    @property
    def shape(self) -> tuple[int, int]:
        """Coefficients of a buffer's potential."""
        first, second = self.grid.stock_axes
        return first.count, second.count

    @property
    def vehicle(self) -> Floats:
        """Pressures of vehicles at which draws are priced [bar]."""
        return np.asarray(self.grid.pressure_scale.pressure(np.unique(self.grid.service_axes[0].points(2))))

    def stock(self, buffer: int) -> int:
        """The first coefficient of a buffer's potential."""
        return buffer * self.shape[0] * self.shape[1]

    def service(self, number: int) -> int:
        """The first coefficient of a price's U."""
        first, second = self.grid.service_axes
        return self.stock(3) + number * first.count * second.count

    def ceiling(self, place: Ints, flow: Ints) -> Ints:
        """Least that a draw must cost at a pressure of vehicles and a flow."""
        return self.service(self.services) + place * len(self.flows) + flow

    @property
    def boundary(self) -> int:
        """The first of three boundary terms."""
        return self.service(self.services) + len(self.vehicle) * len(self.flows)

    @property
    def width(self) -> int:
        """Number of variables."""
        return self.boundary + 3


def _stock_rows(rows: Rows, layout: Layout, buffer: int, excess: Floats) -> None:
    """Filling gains at most 1, time nothing; potentials grow with pressure."""
    grid, plant, axes = layout.grid, layout.grid.plant, layout.grid.stock_axes
    i, a, j, b = mesh(axes[0].cells, len(SHARES), axes[1].cells, len(SHARES))
    point = Samples.of(axes, (i, SHARES[a]), (j, SHARES[b]))
    pressure, warm = grid.reference_scale.pressure(axes[0].points(2)[i, a]), axes[1].points(2)[j, b]
    room = np.maximum(plant.compressor_pressure - pressure * grid.theta(warm), 0.0)
    speed = grid.kappa[buffer] * plant.inlet_coefficient * room * grid.reference_scale.rate(pressure)
    first = layout.stock(buffer)
    rows.add(point.shifted(first), point.moved(speed, drift(grid, plant.inlet_heating[buffer], warm)), 1 / excess[i, j])
    before, after = growing(layout.shape, 1)
    sign = np.where(before % layout.shape[1] >= grid.ambient, 1.0, -1.0)
    rows.add([first + before, first + after], [sign, -sign], np.zeros(len(before)))
    before, after = growing(layout.shape, 0)
    rows.add([first + before, first + after], [1.0, -1.0], np.zeros(len(before)))


def _boundary_rows(rows: Rows, layout: Layout, buffer: int) -> None:
    """The boundary term is at most a final potential and its restoring seconds, less the initial potential."""
    grid, axes = layout.grid, layout.grid.stock_axes
    start, temperature = grid.start(buffer)
    initial = float(grid.reference_scale.position(np.array([start]))[0])
    z = np.append(np.unique(axes[0].points(4)), initial)
    reference = grid.reference_scale.pressure(z)
    reference[-1] = start
    restoring = grid.restoring(buffer, reference)
    z, restoring = z[np.isfinite(restoring)], restoring[np.isfinite(restoring)]
    ambient = np.full(len(z), grid.plant.ambient_temperature)
    final = Samples.of(axes, axes[0].place(z), axes[1].place(ambient))
    at = np.full(len(z), initial), np.full(len(z), temperature)
    begun = Samples.of(axes, axes[0].place(at[0]), axes[1].place(at[1]))
    first = layout.stock(buffer)
    columns = [np.full(len(z), layout.boundary + buffer), *final.shifted(first), *begun.shifted(first)]
    rows.add(columns, [1.0, *(-weight for weight in final.value), *begun.value], restoring)


def _service_rows(rows: Rows, layout: Layout, number: int, price: float, volume: float) -> None:
    """A price's U rises by at most the ceiling and the price of a second."""
    grid, axes, vehicle = layout.grid, layout.grid.service_axes, layout.vehicle
    warm = np.unique(axes[1].points(2))
    k, j = mesh(len(vehicle), len(warm))
    point = Samples.of(axes, axes[0].place(grid.pressure_scale.position(vehicle[k])), axes[1].place(warm[j]))
    columns = point.shifted(layout.service(number))
    for node, flow in enumerate((0.0, *layout.flows)):
        moved = point.moved(*rises(grid, volume, vehicle[k], warm[j], np.full(len(k), flow)))
        if node:
            ceiling = layout.ceiling(k, np.full(len(k), node - 1))
            rows.add([*columns, ceiling], [*moved, -1.0], np.full(len(k), price))
        else:
            rows.add(columns, moved, np.full(len(k), price))
    before, after = growing((axes[0].count, axes[1].count), 0)
    first = layout.service(number)
    rows.add([first + before, first + after], [1.0, -1.0], np.zeros(len(before)))


def _draw_rows(rows: Rows, layout: Layout, buffer: int) -> tuple[Floats, Floats]:
    """A draw costs at least the ceiling; of each row the vehicle's pressure and the flow."""
    grid, plant, axes = layout.grid, layout.grid.plant, layout.grid.stock_axes
    j, b, k, f = mesh(axes[1].cells, len(SHARES), len(layout.vehicle), len(layout.flows))
    warm, flow = axes[1].points(2)[j, b], layout.flows[f]
    pressure = layout.vehicle[k] + flow / plant.outlet_coefficient
    met = (pressure <= grid.pressure_max) & (pressure <= grid.reference[-1] * grid.theta(warm))
    j, b, k, f, warm, flow, pressure = (item[met] for item in (j, b, k, f, warm, flow, pressure))
    reference = pressure / grid.theta(warm)
    place = axes[0].place(grid.reference_scale.position(reference))
    point = Samples.of(axes, place, (j, SHARES[b]))
    along = grid.kappa[buffer] * flow * grid.reference_scale.rate(reference)
    moved = point.moved(-along, drift(grid, -plant.outlet_cooling[buffer], warm))
    rows.add([layout.ceiling(k, f), *point.shifted(layout.stock(buffer))], [1.0, *moved], np.zeros(len(k)))
    return layout.vehicle[k], flow


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
        self._bends = self._bend_rows()
        size = -eye(self._bends.shape[0])
        self._bent = vstack([hstack([self._bends, size]), hstack([-self._bends, size])])
        self._excess = [np.ones((len(grid.reference) - 1, len(grid.temperature) - 1)) for _ in range(3)]

    def propose(self, prices: Sequence[float]) -> list[Floats]:
        """Potentials of the buffers that make the bound large if equally many vehicles pay each price, as coefficients.

        A price is in compressor-seconds a connected second.
        """
        layout = self.layout
        cost, low, high = self._objective()
        best, active = np.zeros(layout.width), self._promising(max(prices)) | self._promising(min(prices))
        for _ in range(_ROUNDS):
            rows = Rows(layout.width)
            for buffer in range(3):
                _stock_rows(rows, layout, buffer, self._excess[buffer])
                _boundary_rows(rows, layout, buffer)
            for number, price in enumerate(prices):
                _service_rows(rows, layout, number, price, self.volume)
            matrix, bound = rows.system()
            system = vstack([matrix, self._draws[active]], format="csr")
            system.resize(system.shape[0], len(cost))
            system = vstack([system, self._bent], format="csr")
            right = np.concatenate((bound, self._draw_bounds[active], np.zeros(self._bent.shape[0])))
            found = nearly_least(cost, system, right, low, high)
            if found is None:
                break
            best = found[: layout.width]
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
        """The buffers' coefficients in a solution."""
        layout = self.layout
        return [found[layout.stock(b) : layout.stock(b + 1)].reshape(layout.shape) for b in range(3)]

    def _measure(self, found: Floats) -> float:
        """Note where a second of filling gains more than 1 by the proof's measure, for the next round; the most."""
        worst = 0.0
        for buffer, values in enumerate(self._stocks(found)):
            gains = np.maximum(filling_gains(self.layout.grid, buffer, tidy(values, self.layout.grid)), 1.0)
            self._excess[buffer] *= gains
            worst = max(worst, float(gains.max()) - 1)
        return worst

    def _objective(self) -> tuple[Floats, Floats, Floats]:
        """U at the start, as often as there are vehicles, and the boundary terms; the normalisation."""
        grid, layout = self.layout.grid, self.layout
        first, last = layout.service(0), layout.service(layout.services)
        cost, low, high = np.zeros(layout.width), np.full(layout.width, -np.inf), np.full(layout.width, np.inf)
        each = self.vehicles / layout.services
        cost[first:last] = np.tile(each * start_weights(grid, self.start), layout.services)
        cost[layout.boundary :] = -1.0
        tilt = np.full(layout.shape, _SIZE)
        tilt[:, 0] += _TILT
        tilt[:, -1] += _TILT
        tilt[:, grid.ambient] -= 2 * _TILT
        cost[:first] += self.vehicles * np.tile(tilt.ravel(), 3)
        for buffer in range(3):
            low[layout.stock(buffer) + grid.ambient] = high[layout.stock(buffer) + grid.ambient] = 0.0
        low[first:last], high[first:last] = (np.tile(limit, layout.services) for limit in service_limits(grid))
        low[last : layout.boundary] = 0.0
        count = self._bends.shape[0]
        cost = np.concatenate((cost, np.full(count, _BEND * self.vehicles)))
        return cost, np.concatenate((low, np.zeros(count))), np.concatenate((high, np.full(count, np.inf)))

    def _bend_rows(self) -> csr_matrix:
        """Third differences of every potential and U."""
        layout, axes = self.layout, self.layout.grid.service_axes
        stock = bends(layout.shape, layout.grid.ambient)
        service = bends((axes[0].count, axes[1].count))
        found = block_diag([stock] * 3 + [service] * layout.services, format="csr")
        found.resize(found.shape[0], layout.width)
        return found
