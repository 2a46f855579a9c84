"""Terminal cost of a plan: compressor-seconds to restore the buffers, cost of the fills to do."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from controllers.switched.model import Demand, Prices
from station.compiled import inlined, kernel
from station.geometry import KELVIN
from station.planning import (
    Model,
    closing,
    driving_pressure,
    effort,
    fastest_rise,
    gas_mass,
    gas_pressure,
    inlet_flow,
    is_thesis,
    mean_effort,
    most_dispensed,
    nozzle_flow,
)
from station.plants.interface import REFERENCE_TEMPERATURE
from station.plants.thesis import SPECIFIC_GAS

POINTS = 128
"""Pressures at which the cost of filling is tabulated, from an empty tank to the highest finish pressure."""

QUEUES = 2
"""Rows of that table: nobody waits, somebody does."""

FILL_ROWS = 2 * QUEUES
"""And those of the seconds that grams take."""

GAPS = 200

FILL_WEIGHT = 1.5
"""On the estimated cost of fills to be done, which takes each gram from the best pressure there could be."""

FILL_END_MARGIN = 10.0
"""By how much the buffer that ends a fill must exceed finish pressure and gap: it falls while it does [bar]."""

RESTORING_PREMIUM = 0.1
"""How much more than its compression at 25 deg C missing gas is worth: buffers are warmer when they are filled."""

SURPLUS_SHARE = 0.7
"""What gas beyond the target is worth, by that compression: nobody asks for it."""

FULL_SHARE = 0.04
"""Within this share of the compressor's pressure a gram is worth no more than where it begins: the compressor's own
price grows without limit there, and a buffer that happens to be that full would never be drawn from."""


@inlined
def restoring_cost(missing: float) -> float:
    """Terminal cost of `missing` seconds of compressor at the end of a plan [s of compressor]."""
    return missing * (1.0 + RESTORING_PREMIUM) if missing > 0.0 else missing * SURPLUS_SHARE


@inlined
def fill_end_pressure(demand: Demand, model: Model) -> float:
    """Pressure from which a buffer can end the fills a plan reckons with [bar]; the compressor can reach it."""
    needed = max(demand.finish, demand.next_finish) + model.limits.outlet_gap_min
    return min(needed + FILL_END_MARGIN, 0.5 * (max(needed, 0.0) + model.compressor_pressure))


@inlined
def fill_end_time(mass: float, temperature: float, target: float, buffer: int, model: Model) -> float:
    """Seconds of filling until a buffer reaches `target` [bar], which is below the compressor's, at its temperature."""
    volume = model.buffer_volume[buffer]
    pressure = gas_pressure(mass, temperature, volume, model)
    if pressure >= target:
        return 0.0
    if not is_thesis(model):
        return (gas_mass(target, temperature, volume, model) - mass) / inlet_flow(0.5 * (pressure + target), model)
    distance = (driving_pressure(model) - target) / (driving_pressure(model) - pressure)
    return math.log(distance) / math.log(1.0 - closing(model.inlet_coefficient, pressure, mass, volume, model))


@inlined
def finish_max(model: Model) -> float:
    """The highest pressure a vehicle can reach [bar]."""
    return model.compressor_pressure - model.limits.outlet_gap_min


class TerminalCost(NamedTuple):
    """Constants of a buffer's terminal cost."""

    reference: float  # mass to which it is restored [g]
    enough: float  # mass from which it can end a fill [g], at 25 deg C
    floor: float  # bar below the driving pressure from which on a gram is worth no more
    missing: float  # bar below it at the reference, at 25 deg C
    decay: float  # logarithm of the share of that which a second leaves
    extra_seconds: float  # seconds by which restoring from `enough` takes longer than it would at its rate there


@inlined
def restored_temperature(model: Model) -> float:
    """The temperature at which buffers are thought restored [deg C]: 25 in the thesis, else that of the air."""
    return REFERENCE_TEMPERATURE if is_thesis(model) else model.ambient_temperature


@inlined
def _unpressed(mass: float, buffer: int, model: Model) -> float:
    """By how much a buffer of `mass` [g] is below the driving pressure where it is restored [bar]."""
    return driving_pressure(model) - gas_pressure(mass, restored_temperature(model), model.buffer_volume[buffer], model)


@inlined
def _restoring_seconds(mass: float, terminal: TerminalCost, buffer: int, model: Model) -> float:
    """Time in which a buffer of `mass` [g] is restored [s], at the flow between; else than in the thesis."""
    now = max(_unpressed(mass, buffer, model), terminal.floor)
    return (terminal.reference - mass) / (model.inlet_coefficient * (0.5 * (now + terminal.missing)))


@inlined
def restore(mass: float, terminal: TerminalCost, buffer: int, model: Model) -> float:
    """Compressor-seconds from `mass` [g] to the reference at `restored_temperature`; negative for a surplus.

    Beyond the floor they grow as they do there. Else than in the thesis: the grams missing at the flow between.
    """
    now = _unpressed(mass, buffer, model)
    if not is_thesis(model):
        top = driving_pressure(model)
        work = mean_effort(top - max(now, terminal.floor), top - terminal.missing, model)
        return _restoring_seconds(mass, terminal, buffer, model) * work
    if now >= terminal.floor:
        return math.log(terminal.missing / now) / terminal.decay
    return (math.log(terminal.missing / terminal.floor) + (1.0 - now / terminal.floor)) / terminal.decay


@inlined
def _extra_seconds(begin: float, target: float, terminal: TerminalCost, buffer: int, model: Model) -> float:
    """Seconds by which restoring from `begin` [g] takes longer than it would at the rate at `target` [bar]."""
    there = (terminal.reference - begin) / (model.inlet_coefficient * (driving_pressure(model) - target))
    return restore(begin, terminal, buffer, model) - there * effort(target, model)


@kernel
def terminal_cost_of(buffer: int, reference: float, demand: Demand, model: Model) -> TerminalCost:
    """The constants of a buffer that is restored to `reference` [g], at most to the floor."""
    rise = SPECIFIC_GAS * (REFERENCE_TEMPERATURE + KELVIN) / model.buffer_volume[buffer]
    target = fill_end_pressure(demand, model)
    floor = FULL_SHARE * model.compressor_pressure
    full = gas_pressure(reference, restored_temperature(model), model.buffer_volume[buffer], model)
    missing = max(floor, driving_pressure(model) - full)
    enough = target / rise
    if not is_thesis(model):
        enough = gas_mass(target, restored_temperature(model), model.buffer_volume[buffer], model)
    terminal = TerminalCost(reference, enough, floor, missing, math.log(1.0 - model.inlet_coefficient * rise), 0.0)
    extra = _extra_seconds(terminal.enough, target, terminal, buffer, model)
    return TerminalCost(reference, terminal.enough, floor, missing, terminal.decay, extra)


@inlined
def terminal_cost(
    mass: float, missing: float, terminal: TerminalCost, target: float, waiting: int, gas: float, buffer: int,
    model: Model,
) -> float:  # fmt: skip
    """Terminal cost of a buffer of `mass` [g] with `missing` seconds to restore at a plan's end [s of compressor].

    While vehicles wait a missing second costs `gas` more, whatever work it takes. What its last part, above the
    pressure `target` at which a fill can be ended, costs more than it would there is spread over them: it is paid once,
    however many are served.
    """
    worth = restoring_cost(missing)
    if waiting > 0:
        worth += gas * (missing if is_thesis(model) else _restoring_seconds(mass, terminal, buffer, model))
        if max(mass, terminal.enough) < terminal.reference:
            extra = (
                terminal.extra_seconds
                if mass <= terminal.enough
                else _extra_seconds(mass, target, terminal, buffer, model)
            )
            worth -= (1.0 + RESTORING_PREMIUM) * extra * waiting / (1.0 + waiting)
    return worth


@kernel
def fill_cost(model: Model, temperature: float, volume: float, prices: Prices, stored: float) -> np.ndarray:
    """Costs of filling a tank from nothing to each of POINTS pressures, a cubic metre of it, (FILL_ROWS, POINTS).

    The first QUEUES rows are compressor-seconds, in the thesis's model with the price of the time it takes, the others
    the seconds that nozzle and outlet take at any rate; `remaining_fill_cost` heeds the ramp. Each gram comes from
    the gap that costs least, and is restored at the pressure it leaves, or at `stored` [bar] where no bank is kept
    below. `volume` [m3] is that of the tank whose ramp holds the flow where a gap is chosen.
    """
    top = model.compressor_pressure
    grid = np.linspace(0.0, finish_max(model), POINTS)
    grams = (grid[1] - grid[0]) / (SPECIFIC_GAS * (temperature + KELVIN))
    shares = np.linspace(0, 1, GAPS)
    table = np.zeros((FILL_ROWS, POINTS))
    for place in range(1, POINTS):
        mean = (grid[place] + grid[place - 1]) / 2
        if not is_thesis(model):
            upper = gas_mass(grid[place], temperature, 1.0, model)
            grams = upper - gas_mass(grid[place - 1], temperature, 1.0, model)
        most = most_dispensed(gas_mass(mean, temperature, volume, model), temperature, mean, volume, model, 1.0)
        room = max(0.98 * top - mean, 0.5 * (top - mean))
        highest = min(room, model.limits.dispenser_flow_max / model.outlet_coefficient)
        lowest = min(model.limits.outlet_gap_min, highest)
        gap = lowest + (highest - lowest) * shares
        level = np.maximum(mean + gap, stored)
        work = np.array([effort(each, model) for each in level])
        compress = 1.0 / (model.inlet_coefficient * (driving_pressure(model) - level))
        for row in range(QUEUES):
            second = prices.dispensing + prices.occupancy + row * prices.waiting
            flow = np.minimum(model.outlet_coefficient * gap, most)
            weight = work + row * prices.gas
            cost = compress * weight + second / flow
            best = int(np.argmin(cost))
            a_gram, seconds = cost[best], 0.0
            if not is_thesis(model):
                a_gram = compress[best] * weight[best]
                seconds = 1.0 / min(model.outlet_coefficient * gap[best], nozzle_flow(model))
            table[row, place] = table[row, place - 1] + a_gram * grams
            table[QUEUES + row, place] = table[QUEUES + row, place - 1] + seconds * grams
    return table


@inlined
def _filled_to(pressure: float, row: int, top: float, table: np.ndarray) -> float:
    """Interpolated cost of filling 1 m3 from nothing to `pressure`, by a row of a table that goes to `top` [bar]."""
    place = min(max(pressure / top, 0.0), 1.0) * (POINTS - 1)
    cell = min(int(place), POINTS - 2)
    return table[row, cell] + (place - cell) * (table[row, cell + 1] - table[row, cell])


@inlined
def remaining_fill_cost(
    pressure: float, volume: float, finish: float, queue: int, prices: Prices, model: Model, table: np.ndarray
) -> float:
    """Cost of filling a tank of `volume` [m3] from `pressure` to `finish` [bar] while `queue` vehicles wait."""
    if pressure >= finish:
        return 0.0
    row, top = min(queue, QUEUES - 1), finish_max(model)
    cost = volume * (_filled_to(finish, row, top, table) - _filled_to(pressure, row, top, table))
    if is_thesis(model):
        return cost
    place = QUEUES + row
    seconds = volume * (_filled_to(finish, place, top, table) - _filled_to(pressure, place, top, table))
    seconds = max(seconds, (finish - pressure) / fastest_rise(model))
    return cost + (prices.dispensing + prices.occupancy + row * prices.waiting) * seconds
