"""U proposed by linear programs from the prices of a proved stock; `station.bounds.service` proves it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix, eye, hstack, vstack

from station.bounds.grid import Grid
from station.bounds.lattice import Lattice
from station.bounds.linear import nearly_least
from station.bounds.proof import BufferPotential
from station.bounds.rows import SHARES, Ints, Rows, Samples, bends, growing, mesh, rises, service_limits, start_weights
from station.bounds.service import service_rises, tidy_service
from station.bounds.spline import Floats

_ROUNDS = 5
_EXCESS = 2e-4
_CUT_ROUNDS = 6
_CUTS = 3000
_KEPT = 2
_FREE = 1e6
_FLOWS = 36
_BEND = 0.02
_PER_CELL = 6
_WARMTHS = 6


class ServiceProposer:
    """Linear programs for U over the prices of proved stocks; their rows serve every stock and price of a grid."""

    def __init__(self, grid: Grid, volume: tuple[float, float], start: float) -> None:
        self.grid, self.volume = grid, volume
        shape = grid.service_axes[0].count, grid.service_axes[1].count
        self._bends = bends(shape)
        low, high = service_limits(grid)
        count = self._bends.shape[0]
        self._cost = np.concatenate((start_weights(grid, start), np.full(count, _BEND)))
        self._low, self._high = np.concatenate((low, np.zeros(count))), np.concatenate((high, np.full(count, np.inf)))
        size = -eye(count)
        self._bent = vstack([hstack([self._bends, size]), hstack([-self._bends, size])])
        lattice = Lattice.of(grid)
        share = np.linspace(0, 1, _FLOWS) ** 2
        self._gaps = np.unique(np.round(share * (len(lattice.gap) - 1)).astype(int))
        self._fixed, self._fixed_bounds, self._still, self._still_cells, self._still_shares = self._closed_rows()
        self._open, self._open_cells, self._at, self._speeds = self._open_rows(lattice)

    def propose(self, stock: BufferPotential, price: float) -> Floats:
        """Coefficients of U, with as large a gain as the prices of a proved stock and `price` allow.

        What the proof finds above the price in a cell of pressure is taken off there, and the program solved anew.
        """
        shape = tuple(axis.count for axis in self.grid.service_axes)
        limits = stock.prices[self._at]
        limits = np.where(np.isfinite(limits), limits, _FREE) + price
        active = self._tightest(limits)
        cells = len(self.grid.pressure) - 1
        off, drawn_off = np.zeros(cells), np.zeros(cells)
        best, least = np.zeros(shape), np.inf
        for _ in range(_ROUNDS):
            still = price - off[self._still_cells] * self._still_shares
            found = self._solve(still, limits - drawn_off[self._open_cells], active)
            if found is None:
                break
            coefficients = tidy_service(found.reshape(shape))
            over = [part - price for part in service_rises(self.grid, stock, coefficients, self.volume)]
            worst = max(float(part.max()) for part in over)
            if worst < least:
                best, least = coefficients, worst
            if worst < _EXCESS:
                break
            off, drawn_off = _less(off, over[0]), _less(drawn_off, over[1])
        return best

    def _solve(self, still: Floats, limits: Floats, active: NDArray[np.bool_]) -> Floats | None:
        """Coefficients, rows of draws added as they are violated; None if there is no solution."""
        best, count = None, self._open.shape[1]
        for _ in range(_CUT_ROUNDS):
            system = vstack([self._fixed, self._still, self._open[active]], format="csr")
            system.resize(system.shape[0], len(self._cost))
            system = vstack([system, self._bent], format="csr")
            right = np.concatenate((self._fixed_bounds, still, limits[active], np.zeros(self._bent.shape[0])))
            found = nearly_least(self._cost, system, right, self._low, self._high)
            if found is None:
                return best
            best = found[:count]
            violated = self._open @ best - limits
            worst = np.argsort(-violated)[:_CUTS]
            if violated[worst[0]] < _EXCESS:
                break
            active[worst[violated[worst] > 0]] = True
        return best

    def _tightest(self, limits: Floats) -> NDArray[np.bool_]:
        """The rows of draws to begin with: at each point those that leave a slope the least room."""
        count = len(self._gaps)
        order = np.argsort((limits / self._speeds).reshape(-1, count), axis=1)[:, :_KEPT]
        active = np.zeros(limits.shape, dtype=bool)
        active[(order + count * np.arange(len(order))[:, None]).ravel()] = True
        return active

    def _closed_rows(self) -> tuple[csr_matrix, Floats, csr_matrix, Ints, Floats]:
        """U grows with pressure; then seconds with closed outlets, of each the cell and its share of the most drift."""
        grid, axes = self.grid, self.grid.service_axes
        shape = axes[0].count, axes[1].count
        grow, still = Rows(shape[0] * shape[1]), Rows(shape[0] * shape[1])
        before, after = growing(shape, 0)
        grow.add([before, after], [1.0, -1.0], np.zeros(len(before)))
        i, a, j, b = mesh(axes[0].cells, len(SHARES), axes[1].cells, len(SHARES))
        point = Samples.of(axes, (i, SHARES[a]), (j, SHARES[b]))
        pressure = grid.pressure_scale.pressure(axes[0].points(2)[i, a])
        moves = rises(grid, self.volume[0], pressure, axes[1].points(2)[j, b], np.zeros(len(i)))
        still.add(point.columns, point.moved(*moves), np.zeros(len(i)))
        drifts = np.abs(moves[1])
        return *grow.system(), still.system()[0], i, drifts / max(float(drifts.max()), 1e-12)

    def _open_rows(self, lattice: Lattice) -> tuple[csr_matrix, Ints, tuple[Ints, Ints], Floats]:
        """In a second that draws; of each row the cell, the place in the table of prices and the rise on the scale."""
        grid, axes = self.grid, self.grid.service_axes
        wanted = grid.pressure_scale.pressure(axes[0].points(_PER_CELL).ravel())
        nodes = np.unique(np.clip(np.round((wanted - lattice.vehicle[0]) / lattice.step), 0, len(lattice.vehicle) - 1))
        warm = np.unique(axes[1].points(_WARMTHS))
        n, j, g = mesh(len(nodes), len(warm), len(self._gaps))
        node, gap = nodes.astype(int)[n], self._gaps[g]
        pressure = lattice.vehicle[node]
        place = axes[0].place(grid.pressure_scale.position(pressure))
        point = Samples.of(axes, place, axes[1].place(warm[j]))
        moves = rises(grid, self.volume[0], pressure, warm[j], lattice.flow[gap])
        rows = Rows(axes[0].count * axes[1].count)
        rows.add(point.columns, point.moved(*moves), np.zeros(len(n)))
        return rows.system()[0], place[0], (lattice.offset + node + gap, gap), moves[0]


def _less(off: Floats, over: Floats) -> Floats:
    """What to take off a cell's limits, after a proof exceeded them (or fell short of them: then slowly back)."""
    return np.asarray(np.maximum(off + np.maximum(over, over / 4), 0.0))
