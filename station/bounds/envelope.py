"""Lower envelopes over parts of cells: what a quantity that is linear in flow is at least, by pressure and flow.

On a part of a cell the quantity is f alpha(x, T) - delta(x, T). A smooth function differs from the bilinear one through
its values at the part's corners by at most h^2/8 of its second derivative along one side plus the same along the other.
So with any beta, f alpha - delta - beta p is on the whole part at least its least corner less that difference, and
f alpha - delta has a bound affine in the pressure p.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d

from station.bounds.spline import Floats

MARGIN = 1e-9
"""Relative safety of every proved figure against rounding in its own evaluation."""


def corners(ends: Floats) -> Floats:
    """Values at the four corners of each part, (4, rows, columns); `ends` is (cells, parts + 1, cells, parts + 1)."""
    rows, columns = ends.shape[0] * (ends.shape[1] - 1), ends.shape[2] * (ends.shape[3] - 1)
    low, high = ends[:, :-1], ends[:, 1:]
    four = [side[:, :, :, shift] for side in (low, high) for shift in (slice(None, -1), slice(1, None))]
    return np.stack([item.reshape(rows, columns) for item in four])


@dataclass(frozen=True)
class Parts:
    """Corner values (4, rows, columns) and how far within a part each is from its bilinear interpolation at most."""

    pressure: Floats  # [bar]; grows along rows and columns
    alpha: Floats
    delta: Floats
    off_pressure: Floats  # (rows, columns)
    off_alpha: Floats
    off_delta: Floats

    def _tilt(self, values: Floats) -> Floats:
        """The slope by pressure that fits a quantity best at the corners of each part; any slope is right."""
        off, at = values - values.mean(axis=0), self.pressure - self.pressure.mean(axis=0)
        return np.asarray((off * at).sum(axis=0) / (at * at).sum(axis=0))

    def delta_low(self) -> Floats:
        """A lower bound of the quantity without flow on each part (rows, columns)."""
        return np.asarray((-self.delta).min(axis=0) - self.off_delta)

    def least(self, nodes: Floats, flows: Floats) -> Floats:
        """A table (nodes, flows): the quantity is nowhere below its linear interpolation along pressure.

        At the given flows; infinite at nodes beside which no part lies.
        """
        tilt_alpha, tilt_delta = self._tilt(self.alpha), self._tilt(self.delta)
        alpha, delta = self.alpha - tilt_alpha * self.pressure, self.delta - tilt_delta * self.pressure
        off_alpha = self.off_alpha + np.abs(tilt_alpha) * self.off_pressure
        off_delta = self.off_delta + np.abs(tilt_delta) * self.off_pressure
        best = np.full((len(nodes), len(flows)), np.inf)
        before, after = np.append(-np.inf, nodes[:-1]), np.append(nodes[1:], np.inf)
        for j in range(alpha.shape[2]):
            lows = flows * (alpha[0, :, j, None] - off_alpha[:, j, None]) - delta[0, :, j, None]
            for corner in (1, 2, 3):
                other = flows * (alpha[corner, :, j, None] - off_alpha[:, j, None]) - delta[corner, :, j, None]
                lows = np.minimum(lows, other)
            lows -= off_delta[:, j, None]
            slopes = flows * tilt_alpha[:, j, None] - tilt_delta[:, j, None]
            first = np.searchsorted(self.pressure[3, :, j], before, side="left")
            last = np.searchsorted(self.pressure[0, :, j], after, side="right") - 1
            for shift in range(int((last - first).max()) + 1):
                met = np.flatnonzero(first + shift <= last)
                row = first[met] + shift
                best[met] = np.minimum(best[met], lows[row] + slopes[row] * nodes[met, None])
        return best


def averaged(table: Floats, step: float, low: Floats, high: Floats) -> Floats:
    """The least mean of a table's interpolation along a second: from p to p + shift, low <= shift <= high.

    `table` is (nodes, flows) at nodes one `step` apart, low and high are shifts at each flow [bar]. Of the table that
    comes back the same holds: no mean lies below its interpolation. Beyond its ends the given one is continued by its
    last values.
    """
    reach = np.maximum(np.abs(low), np.abs(high))
    pad = 2 + int(np.ceil(float(reach.max()) / step))
    filled = _continued(np.pad(table, ((pad, pad), (0, 0)), mode="edge"))
    place = step * np.arange(len(filled))
    change = np.diff(filled, axis=0)
    sums = np.vstack((np.zeros(filled.shape[1]), np.cumsum(step * (filled[:-1] + filled[1:]) / 2, axis=0)))
    at = place[pad:-pad]
    means = np.empty_like(table)
    for column in range(table.shape[1]):
        shift = (low[column] + high[column]) / 2
        if abs(shift) < 1e-6 * step:
            shift = 1e-6 * step
        cell = np.clip(((at + shift) // step).astype(int), 0, len(change) - 1)
        part = at + shift - place[cell]
        values = filled[:, column]
        to = sums[cell, column] + part * (values[cell] + part * change[cell, column] / (2 * step))
        means[:, column] = (to - sums[pad:-pad, column]) / shift
    # Interpolation between nodes, and shifts beside the middle one.
    size = 2 * pad - 1
    bends = np.vstack((np.zeros(filled.shape[1]), np.maximum(np.diff(change, axis=0), 0.0), np.zeros(filled.shape[1])))
    slope = np.vstack((np.abs(change), np.abs(change[-1:]))) / step
    near_bend = maximum_filter1d(bends, size, axis=0)[pad:-pad]
    near_slope = maximum_filter1d(slope, size, axis=0)[pad:-pad]
    found = means - near_bend / 4 - near_slope * (high - low) / 4
    return np.where(np.isfinite(table), found - MARGIN * np.abs(found), np.inf)


def _continued(table: Floats) -> Floats:
    """Nodes without a value take that of the nearest node before, or else after, that has one."""
    known = np.isfinite(table).all(axis=1)
    if not known.any():
        return np.zeros_like(table)
    index = np.maximum.accumulate(np.where(known, np.arange(len(table)), -1))
    return np.asarray(table[np.where(index < 0, int(np.argmax(known)), index)])
