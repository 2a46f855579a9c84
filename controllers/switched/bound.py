"""No plan can cost less than this: what a decision says of how far from optimal it may be.

Two facts add up. (a) phi_b(m) is the seconds of filling from an empty buffer to the mass m at the lowest temperature
the buffer can have within the plan. A colder buffer fills faster, so a second of filling raises phi_b by at most 1,
and the seconds spent are at least phi_b(end) - phi_b(start) plus what draws lowered phi_b by; with the worth of the
end this is a function of the end's mass alone, bounded cell by cell (phi_b rises, the worth falls). (b) A gram that
is drawn at a gap g above the vehicle leaves a buffer that holds at least (p_v + g) / a_hi, a_hi the pressure of a
gram at the highest temperature; as phi_b is convex it lowers phi_b by at least the slope there, and it takes 1 /
(c_out g) seconds with an outlet open. The vehicle needs at least the grams up to its finish pressure at its highest
temperature, and what is not filled within the plan is charged more than that by the worth of its end. Waiting is
counted for fills of the least time.
"""

from __future__ import annotations

import math

import numpy as np

from controllers.switched.model import Demand, Prices
from controllers.switched.value import TerminalCost, fill_end_pressure, restore, terminal_cost
from station.compiled import kernel
from station.geometry import KELVIN
from station.planning import Model, is_thesis
from station.plants.thesis import SPECIFIC_GAS

_CELLS = 64  # of a buffer's mass at the end
_SEGMENTS = 24  # of the grams to fill
_TOLLS = (0.0, 0.25, 0.5, 1.0, 2.0)
_SAFETY = 1e-3  # relative: steps of a plan follow the plant's to some 1e-4


@kernel
def _coldest(buffer: int, temperature: float, seconds: float, model: Model) -> float:
    """No temperature of a buffer within `seconds` lies below this [deg C]: it dispenses all the time."""
    start = min(temperature, model.ambient_temperature)
    if model.heat_exchange <= 0.0:
        return start - model.outlet_cooling[buffer] * seconds
    end = model.ambient_temperature - model.outlet_cooling[buffer] / model.heat_exchange
    return min(start, end + (start - end) * (1.0 - model.heat_exchange) ** seconds)


@kernel
def _seconds_to(mass: float, bar_per_g: float, model: Model) -> float:
    """phi(m): seconds of filling from an empty buffer at the temperature of `bar_per_g`."""
    share = 1.0 - mass * bar_per_g / model.compressor_pressure
    return math.log(share) / math.log(1.0 - model.inlet_coefficient * bar_per_g)


@kernel
def _add_buffer(
    buffer: int, mass: float, temperature: float, terminal: TerminalCost, seconds: float, waiting: int, gas: float,
    target: float, model: Model, total: np.ndarray,
) -> None:  # fmt: skip
    """Add to `total` (tolls,) the least of filling seconds at 1 + toll each, less draws, and worth of the end."""
    cold = SPECIFIC_GAS * (_coldest(buffer, temperature, seconds, model) + KELVIN) / model.buffer_volume[buffer]
    now = _seconds_to(mass, cold, model)
    shrink = (1.0 - model.inlet_coefficient * cold) ** seconds
    most = (model.compressor_pressure - (model.compressor_pressure - mass * cold) * shrink) / cold
    least = np.full(total.size, np.inf)
    for cell in range(_CELLS):
        low, high = most * cell / _CELLS, most * (cell + 1) / _CELLS
        missing = restore(high, terminal, buffer, model)
        end = terminal_cost(high, missing, terminal, target, waiting, gas, buffer, model)
        filled = _seconds_to(low, cold, model) - now
        for place, toll in enumerate(_TOLLS):
            least[place] = min(least[place], filled + toll * max(0.0, filled) + end)
    total += least


@kernel
def _gram(
    vehicle_pressure: float, buffer: int, temperature: float, seconds: float, step: float, price: float,
    model: Model,
) -> float:  # fmt: skip
    """Least cost of a gram drawn from a buffer: a slope of phi and a share of an open second at the best gap."""
    volume = model.buffer_volume[buffer]
    cold = SPECIFIC_GAS * (_coldest(buffer, temperature, seconds, model) + KELVIN) / volume
    hottest = max(temperature, model.ambient_temperature, model.limits.buffer_temperature_max)
    ratio = cold / (SPECIFIC_GAS * (hottest + KELVIN) / volume)
    slope = cold / -math.log(1.0 - model.inlet_coefficient * cold)
    room = model.compressor_pressure - ratio * vehicle_pressure
    # A draw of a whole step lowers phi by the slope at its end: d grams lower, d = c_out g step at most.
    pull = max(ratio - cold * model.outlet_coefficient * step, 1e-6)
    gap = room / (pull + math.sqrt(slope * pull * model.outlet_coefficient / max(price, 1e-9)))
    gap = max(gap, model.limits.outlet_gap_min)
    if pull * gap >= room:
        return np.inf
    return slope / (room - pull * gap) + price / (model.outlet_coefficient * gap)


@kernel
def _fill(
    mass: float, heat: float, volume: float, finish: float, start: float, price: float,
    temperature: tuple[float, float, float], seconds: float, step: float, model: Model,
) -> tuple[float, float]:  # fmt: skip
    """Least cost and least time of the rest of a fill from `mass` [g], or from the pressure `start` if that is more."""
    bar = SPECIFIC_GAS / volume
    hottest = max(heat, model.limits.vehicle_temperature_max, model.ambient_temperature) + KELVIN
    coldest = min(heat, model.ambient_temperature) + KELVIN
    first = max(mass, start / (bar * coldest))
    grams = max(0.0, finish / (bar * hottest) - first) / _SEGMENTS
    cost, shortest = -price * step, -step  # the last step is charged in part
    for segment in range(_SEGMENTS):
        pressure = (first + segment * grams) * bar * coldest
        best = np.inf
        for buffer in range(3):
            best = min(best, _gram(pressure, buffer, temperature[buffer], seconds, step, price, model))
        cost += grams * best if best < np.inf else 0.0
        flow = min(model.limits.dispenser_flow_max, model.outlet_coefficient * (model.compressor_pressure - pressure))
        shortest += grams / flow
    return max(cost, 0.0), max(shortest, 0.0)


@kernel
def _queued(
    waiting: int, coming: np.ndarray, seconds: float, shortest: float, next_shortest: float, connected: bool
) -> float:
    """Least seconds in which somebody waits within a plan: no fill is shorter than the shortest."""
    total, counted = 0.0, 0.0
    free = shortest if connected else 0.0
    for place in range(waiting + coming.size):
        arrival = 0.0 if place < waiting else coming[place - waiting]
        if arrival > seconds:
            break
        begun = max(free, arrival)
        total += max(min(begun, seconds) - max(arrival, counted), 0.0)
        counted = begun
        free = begun + next_shortest
    return total


@kernel
def plan_bound(
    mass: tuple[float, float, float], temperature: tuple[float, float, float], vehicle_mass: float,
    vehicle_temperature: float, connected: bool, waiting: int, coming: np.ndarray,
    terminal: tuple[TerminalCost, TerminalCost, TerminalCost], seconds: float, step: float, demand: Demand,
    prices: Prices, model: Model,
) -> float:  # fmt: skip
    """A lower bound on the cost of every plan from a state, in steps of at most `step` seconds.

    NaN, none, for a model that is not the thesis's: the facts above are of that.
    """
    if not is_thesis(model):
        return np.nan
    shared = np.empty(len(_TOLLS))
    for place, toll in enumerate(_TOLLS):  # the compressors share their time: any price of it gives a bound
        shared[place] = -toll * seconds * model.compressor_count
    for buffer in range(3):
        _add_buffer(
            buffer, mass[buffer], temperature[buffer], terminal[buffer], seconds, waiting, prices.gas,
            fill_end_pressure(demand, model), model, shared,
        )  # fmt: skip
    total = np.max(shared)
    shortest = 0.0
    price = prices.dispensing + prices.occupancy
    if connected:
        cost, shortest = _fill(
            vehicle_mass, vehicle_temperature, demand.volume, demand.finish, 0.0, price, temperature, seconds, step,
            model,
        )  # fmt: skip
        total += cost
    cost, next_shortest = _fill(
        0.0, demand.next_temperature, demand.next_volume, demand.next_finish, demand.next_pressure, price, temperature,
        seconds, step, model,
    )  # fmt: skip
    arrived = waiting
    for due in coming:
        arrived += 1 if due <= seconds else 0
    total += cost * arrived + prices.waiting * _queued(waiting, coming, seconds, shortest, next_shortest, connected)
    return total - _SAFETY * abs(total)
