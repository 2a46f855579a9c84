"""U proposed by linear programs from the prices of a proved stock; `station.bounds.service` proves it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.sparse import vstack

from station.bounds.grid import Floats, Grid
from station.bounds.proof import Stock
from station.bounds.rows import CORNERS, Ints, Rows, corner_nodes, mesh, rises, service_limits, start_weights
from station.bounds.service import service_rises, tidy_service

_ROUNDS = 6
_EXCESS = 1e-4
_CUT_ROUNDS = 6
_CUTS = 4000
_KEPT = 10
_FREE = 1e6


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
        for _ in range(_ROUNDS):
            closed = price - off[self._closed_cells] * self._closed_weights
            found = self._solve(closed, limits - drawn_off[self._open_cells], active)
            if found is None:
                break
            values = tidy_service(found.reshape(shape))
            over = [np.maximum(part - price, 0.0) for part in service_rises(self.grid, stock, values, self.volume)]
            worst = max(float(part.max()) for part in over)
            if worst < least:
                best, least = values, worst
            if worst < _EXCESS:
                break
            off, drawn_off = off + over[0], drawn_off + over[1]
        return best

    def _solve(self, closed: Floats, limits: Floats, active: NDArray[np.bool_]) -> Floats | None:
        """Node values, rows of draws added as they are violated; None if there is no solution."""
        cost, box = start_weights(self.grid, self.start), service_limits(self.grid)
        best = None
        for _ in range(_CUT_ROUNDS):
            system = vstack([self._closed, self._open[active]])
            found = linprog(cost, system, np.concatenate((closed, limits[active])), bounds=box, method="highs-ds")
            if found.x is None:
                return best
            best = np.asarray(found.x)
            violated = self._open @ best - limits
            worst = np.argsort(-violated)[:_CUTS]
            if violated[worst[0]] < _EXCESS / 4:
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
        i, j = mesh(len(y) - 1, len(t) - 1)
        weights = []
        for a, b in CORNERS:
            rise, drift = rises(grid, self.volume[1], grid.pressure[i + a], t[j + b], np.zeros(len(i)))
            along, across = rise / (y[i + 1] - y[i]), drift / (t[j + 1] - t[j])
            nodes = [node[0] * len(t) + node[1] for node in corner_nodes(i, j, (a, b))]
            rows.add(nodes, [along, -along, across, -across], np.zeros(len(i)))
            weights.append(np.abs(drift))
        weight = np.concatenate(weights)
        return rows, np.tile(i, len(CORNERS)), weight / max(float(weight.max()), 1e-12)

    def _open_rows(self) -> tuple[Rows, Ints, Floats, Ints, Floats]:
        """In a second that draws; of each row the cell, the pressure, the node of flow and the rise on the scale."""
        grid, t, y = self.grid, self.grid.vehicle_temperature, self.grid.y
        columns = len(t)
        i, j, b, s, node = mesh(len(y) - 1, columns - 1, 2, len(self._shares), len(self._flows))
        share = self._shares[s]
        pressure = grid.pressure_scale.pressure(y[i] + share * (y[i + 1] - y[i]))
        rise, drift = rises(grid, self.volume[1], pressure, t[j + b], self._flows[node])
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
