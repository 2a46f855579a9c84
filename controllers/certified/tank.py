"""A buffer known by bounds, one second on: its pressure from below and above, its temperature from both sides.

Pressure is p = m a (T + K) with a = R / (M V). While the compressor is asked for each second and only the temperature
limit may deny it, the on-seconds cannot be told one by one, but they can be counted: y = m - phi T rises in every
second by at least phi c_Tn (T - T_env), filled or not, as long as a filled second brings at least phi times its
heating. That is the second bound on pressure below: how much has been compressed follows from how warm the buffer has
stayed. The same with `most` for `least` bounds it above.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from station.compiled import kernel
from station.limits import buffer_temperature_margin
from station.plant import KELVIN, SPECIFIC_GAS, PlantConstants, exchange_rate, inlet_flow

OUTWARD = 1e-11
"""Relative widening of every bound and second, for the rounding of double arithmetic: some ten operations of 1e-16."""

NO, YES, MAYBE = 0, 1, 2
"""Whether something happens in a second, for every state within the bounds."""


class Tank(NamedTuple):
    """Bounds on a buffer. Those on `heat` and `lean` hold while it has not been above the aim."""

    low: float  # pressure [bar]
    high: float
    cold: float  # temperature [deg C]
    warm: float
    lean: float  # coldest of those that have not been above the aim [deg C]
    heat: float  # lower bound of y = m - phi T of those [g]
    load: float  # upper bound of m - phi_high T [g]


class Law(NamedTuple):
    """What stays the same of a buffer within a proof."""

    buffer: int
    density: float  # a = R / (M V) [bar/(g K)]
    aim: float  # pressure above which nothing is claimed [bar]
    phi: float  # [g/K]
    warmest: float  # at which an inlet may still open [deg C]
    stop: float  # pressure from which it counts as full [bar]
    slack: float  # how far a buffer that has reached `aim` may fall back while it is asked for [bar]
    floor: float  # pressure down to which `load` counts [bar]
    phi_high: float  # [g/K]
    falls_to: float  # the turns keep it above this, or above where it begins [deg C]


@kernel
def settled_of(buffer: int, plant: PlantConstants) -> float:
    """The temperature a buffer that is filled without end tends to [deg C]; the limit where nothing cools it."""
    if plant.heat_exchange <= 0.0:
        return plant.buffer_temperature_max
    rise = plant.inlet_heating[buffer] / plant.heat_exchange
    return min(plant.buffer_temperature_max, (plant.ambient_temperature + rise) * (1.0 + OUTWARD))


@kernel
def law_of(
    buffer: int, floor: float, aim: float, stop: float, warm: float, turn: tuple[float, float], plant: PlantConstants
) -> Law:
    """The constants of a buffer that is at most `warm` deg C at first.

    `turn`: how long the compressor is asked for it, and how long it then goes without at most [s]. A buffer that has
    been above the aim keeps its mass, and its temperature does not fall below where such turns hold it, so that its
    pressure does not fall by more than `slack`.
    """
    density = SPECIFIC_GAS / plant.buffer_volume[buffer]
    heating = plant.inlet_heating[buffer]
    phi, phi_high = 0.0, 1e9
    if heating > 0.0:
        phi = inlet_flow(aim, plant) / heating * (1.0 - OUTWARD)
        phi_high = inlet_flow(floor, plant) / heating * (1.0 + OUTWARD)
    # margin(T) = margin(0) - (1 - c) T is affine: its root is the warmest T.
    warmest = buffer_temperature_margin(buffer, 0.0, plant, 1.0) / (1.0 - plant.heat_exchange)
    settled = settled_of(buffer, plant)
    hottest = max(warm, settled)
    ambient = plant.ambient_temperature
    held = plant.buffer_temperature_max
    if plant.heat_exchange > 0.0:
        held = ambient + heating / plant.heat_exchange * turn[0] / (turn[0] + turn[1])
    cooling = plant.heat_exchange * max(hottest - ambient, 0.0)
    falls_to = min(warmest, held) - (turn[1] + 2.0) * cooling
    slack = aim * max(hottest - falls_to, 0.0) / (hottest + KELVIN) * (1.0 + 1e-9)
    return Law(buffer, density, aim, phi, warmest - OUTWARD * KELVIN, stop, slack, floor, phi_high, falls_to)


@kernel
def start_tank(low: float, high: float, cold: float, warm: float, law: Law) -> Tank:
    """A buffer within these bounds."""
    return Tank(low, high, cold, warm, cold, anchored(low, warm, law), loaded(high, cold, law))


@kernel
def anchored(low: float, warm: float, law: Law) -> float:
    """The least y of a buffer at a pressure of at least `low` [bar] that is at most `warm` [deg C]."""
    return low / (law.density * (warm + KELVIN)) * (1.0 - OUTWARD) - law.phi * warm


@kernel
def loaded(high: float, cold: float, law: Law) -> float:
    """The greatest m - phi_high T of a buffer at a pressure of at most `high` [bar] that is at least `cold` deg C."""
    return high / (law.density * (cold + KELVIN)) * (1.0 + OUTWARD) - law.phi_high * cold


@kernel
def dissolved(tank: Tank, law: Law) -> Tank:
    """The same bounds where what has been above the aim is no longer asked for: it counts anew from where it can be."""
    heat = min(tank.heat, anchored(law.aim - law.slack, tank.warm, law))
    return Tank(tank.low, tank.high, tank.cold, tank.warm, tank.cold, heat, tank.load)


@kernel
def worse(a: Tank, b: Tank) -> Tank:
    """Bounds that hold where either's do; both of one law."""
    return Tank(
        min(a.low, b.low), max(a.high, b.high), min(a.cold, b.cold), max(a.warm, b.warm), min(a.lean, b.lean),
        min(a.heat, b.heat), max(a.load, b.load),
    )  # fmt: skip


@kernel
def _cooled(temperature: float, plant: PlantConstants) -> float:
    return temperature + exchange_rate(temperature, plant)


@kernel
def quiet_ratio(temperature: float, cooling: float, plant: PlantConstants) -> float:
    """Pressure by pressure a second before, of a buffer that is not filled, per gram it holds."""
    return (_cooled(temperature, plant) - cooling + KELVIN) / (temperature + KELVIN)


@kernel
def least_ratio(tank: Tank, cooling: float, plant: PlantConstants) -> float:
    """The least of `quiet_ratio`; it is monotone in the temperature, so an end attains it."""
    return min(quiet_ratio(tank.cold, cooling, plant), quiet_ratio(tank.warm, cooling, plant)) * (1.0 - OUTWARD)


@kernel
def most_ratio(tank: Tank, cooling: float, plant: PlantConstants) -> float:
    """The greatest of `quiet_ratio`."""
    return max(quiet_ratio(tank.cold, cooling, plant), quiet_ratio(tank.warm, cooling, plant)) * (1.0 + OUTWARD)


@kernel
def _filled_low(tank: Tank, law: Law, plant: PlantConstants) -> float:
    """The least pressure after a second of filling, of a buffer at its lowest pressure."""
    heating = plant.inlet_heating[law.buffer]
    ratio = min(quiet_ratio(tank.cold, -heating, plant), quiet_ratio(tank.warm, -heating, plant))
    gained = inlet_flow(tank.low, plant) * law.density * (_cooled(tank.cold, plant) + heating + KELVIN)
    return (tank.low * ratio + max(gained, 0.0)) * (1.0 - OUTWARD)


@kernel
def _filled_high(pressure: float, tank: Tank, law: Law, plant: PlantConstants) -> float:
    """The greatest pressure after a second of filling from `pressure`."""
    heating = plant.inlet_heating[law.buffer]
    ratio = max(quiet_ratio(tank.cold, -heating, plant), quiet_ratio(tank.warm, -heating, plant))
    gained = inlet_flow(pressure, plant) * law.density * (_cooled(tank.warm, plant) + heating + KELVIN)
    return (pressure * ratio + max(gained, 0.0)) * (1.0 + OUTWARD)


@kernel
def _coldest(cold: float, asked: int, law: Law, plant: PlantConstants) -> float:
    """The least temperature a second on of a buffer that is not full and of at least `cold` deg C."""
    if asked != YES or cold > law.warmest:
        return _cooled(cold, plant)
    return min(_cooled(cold, plant) + plant.inlet_heating[law.buffer], _cooled(law.warmest, plant))


@kernel
def step_tank(tank: Tank, asked: int, outlet: int, law: Law, plant: PlantConstants) -> Tank:
    """The bounds a second on, without what an outlet takes out.

    `asked`: whether the compressor turns to this buffer (NO, YES, MAYBE) where it is neither full nor too warm;
    `outlet`: whether its outlet is open, which cools it.
    """
    heating = plant.inlet_heating[law.buffer]
    cooling = plant.outlet_cooling[law.buffer] if outlet != NO else 0.0
    sure = cooling if outlet == YES else 0.0
    margin = OUTWARD * KELVIN
    allowed_to = law.warmest + 3.0 * margin  # nothing warmer is ever filled
    may_fill = asked != NO and tank.cold <= allowed_to and tank.low < law.stop
    quiet = least_ratio(tank, cooling, plant)
    low = tank.low * quiet
    if asked == YES and tank.warm <= law.warmest:  # a full one is not filled: it stays above what `stop` falls to
        low = max(low, min(_filled_low(tank, law, plant), law.stop * quiet))
    high = tank.high * most_ratio(tank, sure, plant)
    warm = _cooled(tank.warm, plant) - sure
    if may_fill:
        high = max(high, _filled_high(min(tank.high, law.stop), tank, law, plant))
        warm = max(warm, _cooled(min(tank.warm, allowed_to), plant) + heating)
    warm += margin
    full = tank.high >= law.stop
    cold = _coldest(tank.cold, MAYBE if full else asked, law, plant) - cooling - margin
    if outlet != NO:
        return Tank(low, high, cold, warm, cold, anchored(low, warm, law), loaded(high, cold, law))
    load = np.inf
    if tank.low >= law.floor:
        load = tank.load + law.phi_high * plant.heat_exchange * (tank.warm - plant.ambient_temperature)
        load += OUTWARD * (abs(load) + law.phi_high * KELVIN)
        high = min(high, max(load + law.phi_high * warm, 0.0) * law.density * (warm + KELVIN) * (1.0 + OUTWARD))
        load = min(load, loaded(high, cold, law))
    lean = max(cold, _coldest(tank.lean, asked, law, plant) - margin)
    heat = tank.heat + law.phi * plant.heat_exchange * (tank.lean - plant.ambient_temperature)
    heat -= OUTWARD * (abs(heat) + law.phi * KELVIN)
    by_heat = (heat + law.phi * lean) * law.density * (lean + KELVIN) * (1.0 - OUTWARD)
    low = max(low, min(by_heat, law.aim - law.slack))
    return Tank(low, high, cold, warm, lean, max(heat, anchored(low, warm, law)), load)
