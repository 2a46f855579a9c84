"""Proofs of the vehicles' cost: the price of a connected second at which U never outgrows the fall of the stock."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from station.bounds.drift import drift
from station.bounds.envelope import MARGIN, Parts, averaged, corners
from station.bounds.grid import Grid
from station.bounds.proof import BufferPotential, between_flows, on_gaps, spread
from station.bounds.spline import Floats, Surface
from station.geometry import KELVIN

_PARTS = (12, 16)
"""Parts of a cell of a vehicle's pressure and of its temperature."""


@dataclass(frozen=True)
class Service:
    """A proved price of filling vehicles of a range of volumes: compressor-seconds >= gain - price x seconds.

    `seconds` are those a vehicle is connected, `gain` is of its start and finish.
    """

    values: Floats  # spline coefficients of U (vehicle pressure, vehicle temperature), 0 at the highest finish pressure
    price: float  # compressor-seconds a connected second

    def gain(self, grid: Grid, start: float, temperature: float, finish: float) -> float:
        """U at the finish pressure, whatever the temperature, less U at the start."""
        first = grid.service_axes[0]
        (index,), (weights,), _ = first.local(*first.place(grid.pressure_scale.position(np.array([finish]))))
        # A spline lies above its least coefficient.
        end = float((weights @ self.values[index : index + 3]).min())
        return end - grid.service_value(self.values, start, temperature)


def prove_service(grid: Grid, stock: BufferPotential, proposed: Floats, volume: tuple[float, float]) -> Service:
    """The least price of a connected second for which U never rises by more than stock falls plus that price.

    `volume` is the range of the vehicles' tanks [m3].
    """
    coefficients = tidy_service(proposed)
    closed, drawn = service_rises(grid, stock, coefficients, volume)
    price = max(float(closed.max()), float(drawn.max()), 0.0)
    return Service(coefficients, price * (1 + MARGIN) + MARGIN)


def tidy_service(coefficients: Floats) -> Floats:
    """Coefficients above a proposal with which U grows with pressure and is 0 at the highest finish pressure."""
    tidied = np.minimum(np.maximum.accumulate(coefficients, axis=0), 0.0)
    tidied[-1] = 0.0
    return np.asarray(tidied)


def service_rises(
    grid: Grid, stock: BufferPotential, coefficients: Floats, volume: tuple[float, float]
) -> tuple[Floats, Floats]:
    """Most by which a tidy U rises in a second with closed outlets, and above the fall of the stock in one that draws.

    Arrays over the cells of the vehicle's pressure.
    """
    item = Surface.of(grid.service_axes, coefficients)
    closed = _rises(grid, item, 0.0, 0.0)
    rows = len(grid.pressure) - 1
    still = (-closed.delta_low()).reshape(rows, -1).max(axis=1)
    return still, _drawn(grid, stock, item, volume)


def least_vehicle_cost(
    grid: Grid, stock: BufferPotential, volume: float, start: float, temperature: float, finish: float
) -> float:
    """Least cost of a vehicle, however long it stays [compressor-seconds]; 0 or a little less.

    Closed seconds never raise the stock. Open ones do by at most what its lowest price falls short of 0, and they are
    few: each brings the flow at the least gap, and before the last the vehicle lies below its finish pressure.
    """
    short = max(0.0, -float(stock.prices[np.isfinite(stock.prices)].min()))
    kappa, flow = grid.bar_per_gram(volume), grid.flow_range[0]
    cold = float(grid.theta(grid.vehicle_temperature[:1])[0])
    grams = finish / (kappa * cold) - start / (kappa * float(grid.theta(np.array([temperature]))[0]))
    if short == 0:
        return 0.0
    return -short * (grams / flow + 1) * (1 + MARGIN) if flow > 0 else -np.inf


def _rises(grid: Grid, u: Surface, kappa: float, heating: float) -> Parts:
    """How U falls in a second, f alpha - delta, on the parts of its cells; kappa [bar/g] is 0 with closed outlets.

    A second at flow f raises the pressure by kappa theta (1 + w) f + p w, w being the relative warming.
    """
    parts = _PARTS
    plant, end = grid.plant, grid.pressure_scale.end
    kelvin = plant.ambient_temperature + KELVIN
    t = grid.service_axes[1].points(parts[1])
    v = grid.pressure_scale.pressure(grid.service_axes[0].points(parts[0]))[:, :, None, None]
    rate = grid.pressure_scale.rate(v)
    change = drift(grid, heating, t)
    relative, hot = change / (t + KELVIN), grid.theta(t) + change / kelvin
    a, b = u.slope(0), u.slope(1)
    along = a.at(parts)
    alpha = corners(-kappa * rate * along * hot)
    delta = corners(rate * v * along * relative + b.at(parts) * change)
    steep = grid.pressure_scale.rate(grid.pressure[1:])[:, None]
    first, second = (u.widths[0] / parts[0])[:, None] ** 2 / 8, (u.widths[1] / parts[1])[None] ** 2 / 8
    slow, hottest = np.abs(relative).max(axis=1), hot.max(axis=1)
    # Derivatives of the relative warming, and of `hot`, by temperature.
    cold = grid.vehicle_temperature[0] + KELVIN
    turn = (abs(heating) + plant.heat_exchange * kelvin) / cold**2
    turned, hotter = 2 * turn / cold, (1 - plant.heat_exchange) / kelvin
    off_alpha = (
        kappa
        * steep
        * (
            first * (a.most() + 2 * a.slope(0).most()) * hottest
            + second * (a.slope(1).slope(1).most() * hottest + 2 * a.slope(1).most() * abs(hotter))
        )
    )
    off_delta = first * (
        end * steep * (a.most() + 2 * a.slope(0).most()) * slow
        + b.slope(0).slope(0).most() * np.abs(change).max(axis=1)
    ) + second * (
        end * steep * (a.slope(1).slope(1).most() * slow + 2 * a.slope(1).most() * turn + a.most() * turned)
        + 2 * b.slope(1).most() * plant.heat_exchange
    )
    # A second starts elsewhere than at x: temperature by a step, pressure by what it moved.
    step = np.abs(change).max(axis=1) / (1 - plant.heat_exchange)
    moved = kappa * grid.flow_range[1] * (hottest + step / kelvin) + grid.pressure[-1] * (slow + turn * step)
    late = moved * (slow + turn * step) + grid.pressure[1:, None] * turn * step
    off_delta = off_delta + a.most() * steep * late + b.most() * plant.heat_exchange * step
    off_alpha = off_alpha + a.most() * steep * kappa * abs(hotter) * step
    pressure = corners(np.broadcast_to(v, along.shape))
    off_pressure = np.broadcast_to(first * (end - grid.pressure[:-1, None]), a.most().shape)
    return Parts(pressure, alpha, delta, *(spread(off, parts) for off in (off_pressure, off_alpha, off_delta)))


def _drawn(grid: Grid, stock: BufferPotential, u: Surface, volume: tuple[float, float]) -> Floats:
    """Most by which U rises above the fall of the stock in a second that draws, on the cells of a vehicle's pressure.

    Over a square of the lattice, cut along its diagonal of one buffer pressure, the rise of U is at most bilinear and
    the fall of the stock at least linear between pressures and between flows: their difference is nowhere above the
    most of its corners by more than a quarter of its mixed differences.
    """
    lattice, plant = stock.lattice, grid.plant
    kappa = grid.bar_per_gram(volume[0])
    item = _rises(grid, u, kappa, plant.vehicle_heating)
    falls = item.least(lattice.vehicle, lattice.table)
    falls[-1] = np.minimum(falls[-1], 0.0)  # past the highest finish pressure U stays 0, and falls by no less
    falls = averaged(falls, lattice.step, *_shifts(grid, lattice.table, volume))
    rise = -on_gaps(lattice, falls)
    index = lattice.offset + np.arange(len(lattice.vehicle))[:, None] + np.arange(len(lattice.gap))
    over = rise - stock.prices[index, np.arange(len(lattice.gap))]
    most = np.maximum(np.maximum(over[:-1, :-1], over[1:, :-1]), np.maximum(over[:-1, 1:], over[1:, 1:]))
    twist = np.maximum(_mixed(rise), 0.0)
    low, high = index[:-1, :-1], np.arange(len(lattice.gap) - 1)
    bent = np.maximum(_mixed(stock.prices), 0.0)
    worst = (most + (twist + np.maximum(bent[low, high], bent[low + 1, high])) / 4).max(axis=1)
    place = np.clip(np.searchsorted(grid.pressure, lattice.vehicle, side="right") - 1, 0, len(grid.pressure) - 2)
    found = np.full(len(grid.pressure) - 1, -np.inf)
    np.maximum.at(found, place[:-1], worst)
    np.maximum.at(found, place[1:], worst)
    return found


def _mixed(table: Floats) -> Floats:
    """Mixed differences of a table; none where it is infinite."""
    with np.errstate(invalid="ignore"):
        found = np.diff(np.diff(table, axis=0), axis=1)
    return np.where(np.isfinite(found), found, 0.0)


def _shifts(grid: Grid, flows: Floats, volume: tuple[float, float]) -> tuple[Floats, Floats]:
    """Ranges of what a second that draws adds to a vehicle's pressure, at nodes of flow [bar]."""
    t = grid.vehicle_temperature[[0, -1]]
    relative = drift(grid, grid.plant.vehicle_heating, t) / (t + KELVIN)  # falls with temperature
    theta, most = grid.theta(t), grid.pressure[-1]
    low = grid.bar_per_gram(volume[1]) * theta[0] * (1 + relative[1]) * flows + most * min(relative[1], 0.0)
    high = grid.bar_per_gram(volume[0]) * theta[1] * (1 + relative[0]) * flows + most * max(relative[0], 0.0)
    return between_flows(low, high)
