"""What a state is worth at the end of a plan: compressor-seconds to restore the buffers, cost of the fills to do."""

from __future__ import annotations

import math

import numpy as np

from station.compiled import inlined, kernel
from station.metrics import REFERENCE_TEMPERATURE
from station.plant import KELVIN, SPECIFIC_GAS, PlantConstants, gas_pressure

POINTS = 64
"""Pressures at which the cost of the rest of a fill is tabulated."""

QUEUES = 8
"""Numbers of waiting vehicles that make a difference to it: 0 to 7."""

GAPS = 200

FILL_WEIGHT = 1.2
"""On the estimated cost of fills to be done, which takes each gram from the best pressure there could be."""


STORED_PREMIUM = 0.1
"""How much more than its compression at 25 deg C missing gas is worth: buffers are warmer when they are filled."""

SURPLUS_SHARE = 0.85
"""What gas beyond the initial mass is worth, by that compression: nobody asks for it."""


@inlined
def worth_of(missing: float) -> float:
    """What `missing` seconds of compressor are worth at the end of a plan [s of compressor]."""
    return missing * (1.0 + STORED_PREMIUM) if missing > 0.0 else missing * SURPLUS_SHARE


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


@kernel
def restore(mass: float, reference: float, buffer: int, model: PlantConstants) -> float:
    """Compressor-seconds from `mass` to `reference` [g] at 25 deg C; negative for a surplus."""
    temperature = REFERENCE_TEMPERATURE
    volume = model.buffer_volume[buffer]
    rise = SPECIFIC_GAS * (temperature + KELVIN) / volume
    floor = 1e-3 * model.compressor_pressure
    now = max(floor, model.compressor_pressure - gas_pressure(mass, temperature, volume))
    then = max(floor, model.compressor_pressure - gas_pressure(reference, temperature, volume))
    return math.log(then / now) / math.log(1.0 - model.inlet_coefficient * rise)


@kernel
def fill_cost(
    model: PlantConstants, volume: float, start: float, finish: float, temperature: float, prices: np.ndarray
) -> np.ndarray:
    """Cost of the rest of a fill from POINTS pressures between `start` and `finish`, (len(prices), POINTS).

    Each gram comes from the gap that costs least: compressor-seconds to restore it at the pressure it leaves, plus
    the time it takes at `prices` a second.
    """
    top = model.compressor_pressure
    grid = np.linspace(start, finish, POINTS)
    grams = (grid[1] - grid[0]) * volume / (SPECIFIC_GAS * (temperature + KELVIN))
    shares = np.linspace(0, 1, GAPS)
    table = np.zeros((len(prices), POINTS))
    for place in range(POINTS - 2, -1, -1):
        mean = (grid[place + 1] + grid[place]) / 2
        highest = min(0.98 * top - mean, model.dispenser_flow_max / model.outlet_coefficient)
        lowest = min(model.outlet_gap_min, highest)
        gap = lowest + (highest - lowest) * shares
        compress = 1 / (model.inlet_coefficient * (top - mean - gap))
        for row, price in enumerate(prices):
            least = np.min(compress + price / (model.outlet_coefficient * gap))
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
