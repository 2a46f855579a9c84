"""What a state is worth at the end of a plan: compressor-seconds to restore the buffers, cost of the fills to do."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from controllers.switched.model import Demand, Prices
from station.compiled import inlined, kernel
from station.metrics import REFERENCE_TEMPERATURE
from station.plant import KELVIN, SPECIFIC_GAS, PlantConstants, gas_pressure

POINTS = 64
"""Pressures at which the cost of the rest of a fill is tabulated."""

QUEUES = 2
"""Rows of that table: nobody waits, somebody does."""

GAPS = 200

FILL_WEIGHT = 1.5
"""On the estimated cost of fills to be done, which takes each gram from the best pressure there could be."""

LIFT_MARGIN = 10.0
"""By how much the buffer that ends a fill must exceed finish pressure and gap: it falls while it does [bar]."""

STORED_PREMIUM = 0.1
"""How much more than its compression at 25 deg C missing gas is worth: buffers are warmer when they are filled."""

SURPLUS_SHARE = 0.7
"""What gas beyond the initial mass is worth, by that compression: nobody asks for it."""


@inlined
def worth_of(missing: float) -> float:
    """What `missing` seconds of compressor are worth at the end of a plan [s of compressor]."""
    return missing * (1.0 + STORED_PREMIUM) if missing > 0.0 else missing * SURPLUS_SHARE


@inlined
def lift_target(demand: Demand, model: PlantConstants) -> float:
    """Pressure from which a buffer can end a usual fill [bar]."""
    return demand.next_finish + model.outlet_gap_min + LIFT_MARGIN


@inlined
def lift_time(mass: float, temperature: float, target: float, buffer: int, model: PlantConstants) -> float:
    """Seconds of filling until a buffer reaches `target` [bar] at its temperature; infinite beyond the compressor."""
    volume = model.buffer_volume[buffer]
    pressure = gas_pressure(mass, temperature, volume)
    if pressure >= target:
        return 0.0
    if target >= model.compressor_pressure:
        return np.inf
    distance = (model.compressor_pressure - target) / (model.compressor_pressure - pressure)
    return math.log(distance) / math.log(1.0 - model.inlet_coefficient * pressure / mass)


class Stock(NamedTuple):
    """What a buffer's gas is valued by."""

    reference: float  # mass to which it is restored [g]
    enough: float  # mass from which it can end a usual fill [g], at 25 deg C
    floor: float  # bar below the compressor's pressure at which a buffer counts as full
    missing: float  # bar below it at the reference, at 25 deg C
    decay: float  # logarithm of the share of that which a second leaves
    dearer: float  # seconds by which restoring from `enough` takes longer than it would at its rate there


@inlined
def restore(mass: float, stock: Stock, buffer: int, model: PlantConstants) -> float:
    """Compressor-seconds from `mass` [g] to the reference at 25 deg C; negative for a surplus."""
    pressure = gas_pressure(mass, REFERENCE_TEMPERATURE, model.buffer_volume[buffer])
    now = max(stock.floor, model.compressor_pressure - pressure)
    return math.log(stock.missing / now) / stock.decay


@inlined
def _dearer(begin: float, target: float, stock: Stock, buffer: int, model: PlantConstants) -> float:
    """Seconds by which restoring from `begin` [g] takes longer than it would at the rate at `target` [bar]."""
    there = (stock.reference - begin) / (model.inlet_coefficient * (model.compressor_pressure - target))
    return restore(begin, stock, buffer, model) - there


@kernel
def stock_of(buffer: int, reference: float, demand: Demand, model: PlantConstants) -> Stock:
    """By what the gas of a buffer is valued that is restored to `reference` [g]."""
    rise = SPECIFIC_GAS * (REFERENCE_TEMPERATURE + KELVIN) / model.buffer_volume[buffer]
    target = lift_target(demand, model)
    floor = 1e-3 * model.compressor_pressure
    full = gas_pressure(reference, REFERENCE_TEMPERATURE, model.buffer_volume[buffer])
    missing = max(floor, model.compressor_pressure - full)
    stock = Stock(reference, target / rise, floor, missing, math.log(1.0 - model.inlet_coefficient * rise), 0.0)
    dearer = _dearer(stock.enough, target, stock, buffer, model)
    return Stock(reference, stock.enough, floor, missing, stock.decay, dearer)


@inlined
def stock_worth(
    mass: float, missing: float, stock: Stock, target: float, waiting: int, gas: float, buffer: int,
    model: PlantConstants,
) -> float:  # fmt: skip
    """What a buffer of `mass` [g] with `missing` seconds to restore is worth at a plan's end [s of compressor].

    While vehicles wait a missing second costs `gas` more. What its last part, above the pressure `target` at which a
    fill can be ended, costs more than it would there is spread over them: it is paid once, however many are served.
    """
    worth = worth_of(missing)
    if waiting > 0:
        worth += gas * missing
        if max(mass, stock.enough) < stock.reference:
            dearer = stock.dearer if mass <= stock.enough else _dearer(mass, target, stock, buffer, model)
            worth -= (1.0 + STORED_PREMIUM) * dearer * waiting / (1.0 + waiting)
    return worth


@kernel
def fill_cost(
    model: PlantConstants, volume: float, start: float, finish: float, temperature: float, prices: Prices
) -> np.ndarray:
    """Cost of the rest of a fill from POINTS pressures between `start` and `finish`, (QUEUES, POINTS).

    Each gram comes from the gap that costs least: compressor-seconds to restore it at the pressure it leaves, plus
    the price of the time it takes.
    """
    top = model.compressor_pressure
    grid = np.linspace(start, finish, POINTS)
    grams = (grid[1] - grid[0]) * volume / (SPECIFIC_GAS * (temperature + KELVIN))
    shares = np.linspace(0, 1, GAPS)
    table = np.zeros((QUEUES, POINTS))
    for place in range(POINTS - 2, -1, -1):
        mean = (grid[place + 1] + grid[place]) / 2
        highest = min(0.98 * top - mean, model.dispenser_flow_max / model.outlet_coefficient)
        lowest = min(model.outlet_gap_min, highest)
        gap = lowest + (highest - lowest) * shares
        compress = 1 / (model.inlet_coefficient * (top - mean - gap))
        for row in range(QUEUES):
            second = prices.dispensing + prices.occupancy + row * prices.waiting
            least = np.min(compress * (1.0 + row * prices.gas) + second / (model.outlet_coefficient * gap))
            table[row, place] = table[row, place + 1] + least * grams
    return table


@kernel
def rest_of_fill(pressure: float, queue: int, start: float, finish: float, table: np.ndarray) -> float:
    """Interpolated cost of the rest of a fill from `pressure` while `queue` vehicles wait."""
    row = min(queue, table.shape[0] - 1)
    place = (pressure - start) / (finish - start) * (POINTS - 1)
    if place <= 0.0:
        return table[row, 0]
    if place >= POINTS - 1:
        return 0.0
    cell = int(place)
    return table[row, cell] + (place - cell) * (table[row, cell + 1] - table[row, cell])
