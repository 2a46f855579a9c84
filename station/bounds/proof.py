"""Proofs of potentials, however they were proposed: prices that hold for every state and command of a second.

Over a second a state moves from s by d(s), and a potential changes by the mean of its gradient at the points x of
that segment times d(s). On one cell of the splines gradient(x) . d(x) is smooth, so on a part of the cell it is known
by its corners and its second derivatives (`station.bounds.envelope`); d(s) differs from d(x) by little, which is added.
No sampling, and the proposal's solver is not believed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from station.bounds.drift import drift
from station.bounds.envelope import MARGIN, Parts, averaged, corners
from station.bounds.grid import Grid
from station.bounds.lattice import Lattice
from station.bounds.spline import Floats, Surface
from station.geometry import KELVIN

_FILL_PARTS = (8, 12)
_DRAW_PARTS = (8, 24)
"""Parts of a cell of a buffer's reference pressure and of its temperature."""


@dataclass(frozen=True)
class BufferPotential:
    """A proved potential of the three buffers [compressor-seconds].

    No second of filling raises a buffer's potential by more than 1, and no other second without a draw raises it.
    """

    values: tuple[Floats, Floats, Floats]  # spline coefficients (reference pressure, temperature)
    boundary: float  # least of (final potential + restoring seconds - initial potential), all buffers
    used_most: float  # most that can be drawn from the initial stock, all buffers
    lattice: Lattice
    prices: Floats  # (lattice.buffer, lattice.gap): least fall of the potential in a second that draws


def tidy(coefficients: Floats, grid: Grid) -> Floats:
    """The least coefficients above a proposal with which time cannot raise a potential and mass does.

    Temperature only ever moves towards the ambient one while the valves are closed, mass stays. A spline grows
    where its coefficients do.
    """
    tidied, middle = coefficients.copy(), grid.ambient
    tidied[:, middle:] = np.maximum.accumulate(coefficients[:, middle:], axis=1)
    tidied[:, : middle + 1] = np.maximum.accumulate(coefficients[:, middle::-1], axis=1)[:, ::-1]
    return np.asarray(np.maximum.accumulate(tidied, axis=0))


@dataclass(frozen=True)
class _Potential:
    """One buffer's potential Psi(z, T), its slopes and what bounds them on each cell."""

    grid: Grid
    buffer: int
    psi: Surface

    @cached_property
    def along(self) -> Surface:
        """dPsi/dz."""
        return self.psi.slope(0)

    @cached_property
    def across(self) -> Surface:
        """dPsi/dT."""
        return self.psi.slope(1)

    def nodes(self, parts: tuple[int, int]) -> tuple[Floats, Floats, Floats]:
        """Reference pressure r and dz/dr as (cells, ends, 1, 1), temperature as (cells, ends)."""
        grid = self.grid
        z = grid.stock_axes[0].points(parts[0])[:, :, None, None]
        r = grid.reference_scale.pressure(z)
        r[0, 0], r[-1, -1] = grid.reference[0], grid.reference[-1]
        return r, grid.reference_scale.rate(r), grid.stock_axes[1].points(parts[1])

    def sides(self, parts: tuple[int, int]) -> tuple[Floats, Floats]:
        """An eighth of the square of a part's side, (cells, 1) and (1, cells)."""
        dz, dt = self.psi.widths
        return (dz / parts[0])[:, None] ** 2 / 8, (dt / parts[1])[None] ** 2 / 8

    def scale(self) -> tuple[Floats, NDArray[np.bool_]]:
        """The most of dz/dr on cells (cells, 1), and whether dz/dr grows there."""
        rate = self.grid.reference_scale.rate(self.grid.reference[1:])[:, None]
        return rate, (self.grid.reference[1:] <= self.grid.plant.compressor_pressure * (1 + MARGIN))[:, None]


def spread(cells: Floats, parts: tuple[int, int]) -> Floats:
    """A figure of each cell for each of its parts."""
    return np.repeat(np.repeat(cells, parts[0], axis=0), parts[1], axis=1)


def filling_gains(grid: Grid, buffer: int, coefficients: Floats) -> Floats:
    """Most by which a second of filling raises the potential, for every admissible state; an array over the cells."""
    plant, parts = grid.plant, _FILL_PARTS
    item = _Potential(grid, buffer, Surface.of(grid.stock_axes, coefficients))
    r, rate, t = item.nodes(parts)
    heating, speed_of = plant.inlet_heating[buffer], grid.kappa[buffer] * plant.inlet_coefficient
    top, theta, warming = plant.compressor_pressure, grid.theta(t), drift(grid, heating, t)
    speed = speed_of * rate * (top - r * theta)
    gain = item.along.at(parts) * speed + item.across.at(parts) * warming
    # Second derivatives, cell by cell.
    steep, grows = item.scale()
    warm_of = 1 / (plant.ambient_temperature + KELVIN)
    room = np.abs(top - grid.reference_scale.end * theta).max(axis=1)
    bend = np.where(grows, speed_of * steep * room, speed_of * theta[:, -1])
    fastest = np.abs(speed).max(axis=(1, 3))
    hottest = np.abs(warming).max(axis=1)
    high = grid.reference[1:, None]
    a, b = item.along, item.across
    by_pressure = (2 * a.slope(0).most() + np.where(grows, a.most(), 0.0)) * bend
    by_pressure += b.slope(0).slope(0).most() * hottest
    by_heat = (
        a.slope(1).slope(1).most() * fastest
        + 2 * a.slope(1).most() * speed_of * steep * high * warm_of
        + 2 * b.slope(1).most() * plant.heat_exchange
    )
    first, second = item.sides(parts)
    # The start of a second lies before x: colder, emptier, so that filling there is faster.
    step = hottest / (1 - plant.heat_exchange)
    low = np.maximum(grid.reference[:-1, None] - speed_of * top, 0.0)
    most = np.maximum(top - low * (theta[:, 0] - step * warm_of), 0.0) * speed_of
    ahead = most * theta[:, -1] + high * max(0.0, float(warming.max())) * warm_of
    late = a.most() * steep * speed_of * ahead + b.most() * plant.heat_exchange * step
    found = corners(gain).max(axis=0) + spread(first * by_pressure + second * by_heat + late, parts)
    reached = corners(r * (theta - step[:, None] * warm_of)).min(axis=0) - spread(most * theta[:, -1], parts) < top
    found = np.where(reached, found, -np.inf)
    shape = len(grid.reference) - 1, parts[0], len(grid.temperature) - 1, parts[1]
    return np.asarray(found.reshape(shape).max(axis=(1, 3)))


def draw_prices(grid: Grid, buffer: int, coefficients: Floats, lattice: Lattice) -> Floats:
    """Least fall of one buffer's potential in a second that draws from it, (lattice.buffer, lattice.table)."""
    plant, parts = grid.plant, _DRAW_PARTS
    item = _Potential(grid, buffer, Surface.of(grid.stock_axes, coefficients))
    r, rate, t = item.nodes(parts)
    cooling, kappa = -plant.outlet_cooling[buffer], grid.kappa[buffer]
    theta, cooled = grid.theta(t), drift(grid, cooling, t)
    pressure = corners(r * theta)
    alpha = corners(kappa * rate * item.along.at(parts))
    delta = corners(item.across.at(parts) * cooled)
    steep, grows = item.scale()
    a, b = item.along, item.across
    first, second = item.sides(parts)
    coolest = np.abs(cooled).max(axis=1)
    step = coolest / (1 - plant.heat_exchange)
    curved = np.where(grows, a.most() + 2 * a.slope(0).most(), 0.0) * kappa * steep
    off_alpha = first * curved + second * kappa * steep * a.slope(1).slope(1).most()
    off_delta = (
        first * b.slope(0).slope(0).most() * coolest
        + (second * 2 * b.slope(1).most() + b.most() * step) * plant.heat_exchange
    )
    scale = grid.reference_scale
    off_pressure = first * np.where(grows, scale.end - grid.reference[:-1, None], 0.0) * theta[:, -1]
    parts_of = Parts(pressure, alpha, delta, *(spread(off, parts) for off in (off_pressure, off_alpha, off_delta)))
    table = parts_of.least(lattice.buffer, lattice.table)
    # From the start of a second its points lie below by kappa f theta, and by what cooling takes.
    taken = kappa * lattice.table
    warm_of = 1 / (plant.ambient_temperature + KELVIN)
    thermal = np.minimum(grid.reference[-1], grid.pressure_max / theta[:, :1]) * cooled * warm_of
    low = -taken * (theta[-1, -1] + step.max() * warm_of) + min(0.0, float(thermal.min()))
    most = -taken * (theta[0, 0] - step.max() * warm_of) + max(0.0, float(thermal.max()))
    found = averaged(table, lattice.step, *between_flows(low, most))
    found[lattice.buffer > grid.pressure_max + lattice.step] = np.inf  # no second starts there
    return found


def between_flows(low: Floats, high: Floats) -> tuple[Floats, Floats]:
    """Ranges at nodes of flow that hold between a node and its neighbours, too."""
    low, high = np.pad(low, 1, mode="edge"), np.pad(high, 1, mode="edge")
    return np.minimum(np.minimum(low[:-2], low[2:]), low[1:-1]), np.maximum(np.maximum(high[:-2], high[2:]), high[1:-1])


def on_gaps(lattice: Lattice, table: Floats) -> Floats:
    """A table by flow, interpolated to the flows of the lattice's gaps."""
    cell = np.clip(np.searchsorted(lattice.table, lattice.flow, side="right") - 1, 0, len(lattice.table) - 2)
    share = (lattice.flow - lattice.table[cell]) / (lattice.table[cell + 1] - lattice.table[cell])
    with np.errstate(invalid="ignore"):
        found = (1 - share) * table[:, cell] + share * table[:, cell + 1]
    return np.where(np.isfinite(table[:, :1]), found, np.inf)


def prove_buffer_potential(grid: Grid, proposed: list[Floats]) -> BufferPotential:
    """A proved potential from proposed coefficients: made monotone, divided by the most a second of filling gains."""
    lattice = Lattice.of(grid)
    proved, boundary, used = [], 0.0, 0.0
    table = np.full((len(lattice.buffer), len(lattice.table)), np.inf)
    for buffer in range(3):
        coefficients = tidy(proposed[buffer], grid)
        coefficients = coefficients / (max(float(filling_gains(grid, buffer, coefficients).max()), 1e-3) * (1 + MARGIN))
        proved.append(coefficients)
        initial = grid.stock_value(coefficients, *grid.start(buffer))
        boundary += _least_final(grid, buffer, coefficients) - initial
        used += initial - _least_value(grid, buffer, coefficients)
        table = np.minimum(table, draw_prices(grid, buffer, coefficients, lattice))
    return BufferPotential((proved[0], proved[1], proved[2]), boundary, used, lattice, on_gaps(lattice, table))


def _least_final(grid: Grid, buffer: int, coefficients: Floats) -> float:
    """Least of a buffer's final potential and its restoring seconds.

    At one mass the potential is least at the ambient temperature. There the restoring seconds are smooth on their scale
    on either side of the initial pressure, and the potential is quadratic on a cell: their least on a part is that of
    its ends, less an eighth of its side squared times the second derivative.
    """
    axis = grid.stock_axes[0]
    start = float(grid.reference_scale.position(np.array([grid.start(buffer)[0]]))[0])
    z = np.append(axis.points(64)[:, :-1].ravel(), axis.knots[-1])
    z = np.sort(np.append(z, np.clip(start, z[0], z[-1])))
    cell, _ = axis.place((z[:-1] + z[1:]) / 2)
    middle = coefficients[:, grid.ambient]
    curve = np.einsum("cab,cb->ca", axis.extraction, middle[axis.first[:, None] + np.arange(3)])
    second = 2 * (curve[:, 0] - 2 * curve[:, 1] + curve[:, 2]) / np.diff(axis.knots) ** 2
    local = axis.local(*axis.place(z))
    potential = (local.value * middle[local.first[:, None] + np.arange(3)]).sum(axis=1)
    reference = grid.reference_scale.pressure(z)
    reference[z >= start] = np.maximum(reference[z >= start], grid.start(buffer)[0])
    total = potential + grid.restoring(buffer, reference)
    bend = np.maximum(second, 0.0)[cell] + grid.restoring_bend(buffer)
    ends = np.minimum(total[:-1], total[1:])
    return float((ends - np.diff(z) ** 2 / 8 * bend).min())


def _least_value(grid: Grid, buffer: int, coefficients: Floats) -> float:
    """Least a buffer's potential ever is."""
    return grid.stock_value(coefficients, grid.lowest(buffer), grid.plant.ambient_temperature)


def time_only(grid: Grid) -> BufferPotential:
    """The potential that is zero: a second that draws costs nothing, so that only time is priced."""
    nothing = np.zeros((grid.stock_axes[0].count, grid.stock_axes[1].count))
    stock = prove_buffer_potential(grid, [nothing, nothing, nothing])
    return BufferPotential(stock.values, 0.0, 0.0, stock.lattice, np.maximum(stock.prices, 0.0))
