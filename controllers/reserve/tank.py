"""A buffer known by bounds, one second on: its pressure from below and above, its temperature from both sides.

Pressure is p = m a (T + K) with a = R / (M V). While the compressor is asked for each second and only the temperature
limit may deny it, the on-seconds cannot be told one by one, but they can be counted: y = m - phi T rises in every
second by at least phi c_Tn (T - T_env), filled or not, as long as a filled second brings at least phi times its
heating. That is the second bound on pressure below: how much has been compressed follows from how warm the buffer has
stayed. phi falls as the buffer fills: y + (phi - phi') T takes the bound from one to the other. The same with `most`
for `least` bounds pressure above.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from station.compiled import kernel
from station.geometry import KELVIN
from station.limits import buffer_temperature_margin
from station.plants.thesis import SPECIFIC_GAS, PlantConstants, exchange_rate, inlet_flow

OUTWARD = 1e-11
"""Relative widening of every bound and second, for the rounding of double arithmetic: some ten operations of 1e-16."""

HEADROOM = 1.003
"""What is compressed is counted at the flow of a buffer so much above the highest that has the least m - phi T."""

NO, YES, MAYBE = 0, 1, 2
"""Whether the compressor turns to a buffer in a second, for every state within the bounds."""


class Tank(NamedTuple):
    """Bounds on a buffer. Those on `lean` and `heat` hold while it has never been full."""

    low: float  # pressure [bar]
    high: float
    cold: float  # temperature [deg C]
    warm: float
    lean: float  # coldest of those that have never been full [deg C]
    ripe: float  # coldest of those that have [deg C]; inf for none
    phi: float  # [g/K]
    heat: float  # lower bound of m - phi T of those [g]
    psi: float  # [g/K]
    load: float  # upper bound of m - psi T of all [g]


class Law(NamedTuple):
    """Constants of a buffer within a proof."""

    buffer: int
    density: float  # a = R / (M V) [bar/(g K)]
    warmest: float  # at which an inlet may still open [deg C]
    stop: float  # pressure from which it counts as full [bar]
    slack: float  # how far a buffer that has been full may fall back while it has its turns [bar]
    falls_to: float  # the turns keep it above this, or above where it begins [deg C]


@kernel
def settled_of(buffer: int, plant: PlantConstants) -> float:
    """The temperature a buffer that is filled without end tends to [deg C]; the limit where nothing cools it."""
    if plant.heat_exchange <= 0.0:
        return plant.limits.buffer_temperature_max
    rise = plant.inlet_heating[buffer] / plant.heat_exchange
    return min(plant.limits.buffer_temperature_max, (plant.ambient_temperature + rise) * (1.0 + OUTWARD))


@kernel
def law_of(buffer: int, stop: float, warm: float, turn: tuple[float, float], plant: PlantConstants) -> Law:
    """The constants of a buffer that is at most `warm` deg C at first.

    `turn`: how long the compressor is asked for it, and how long it then goes without at most [s]. A buffer that has
    been full keeps its mass, and its temperature does not fall below where such turns hold it, so that its pressure
    does not fall by more than `slack`.
    """
    # margin(T) = margin(0) - (1 - c) T is affine, whatever the pressure: its root is the warmest T.
    warmest = buffer_temperature_margin(buffer, 0.0, 0.0, plant, 1.0) / (1.0 - plant.heat_exchange)
    hottest = max(warm, settled_of(buffer, plant))
    held = plant.limits.buffer_temperature_max
    if plant.heat_exchange > 0.0:
        held = plant.ambient_temperature + (
            plant.inlet_heating[buffer] / plant.heat_exchange * turn[0] / (turn[0] + turn[1])
        )
    cooling = plant.heat_exchange * max(hottest - plant.ambient_temperature, 0.0)
    falls_to = max(min(warmest, held) - (turn[1] + 2.0) * cooling, -KELVIN)
    slack = stop * max(hottest - falls_to, 0.0) / (hottest + KELVIN) * (1.0 + 1e-9)
    density = SPECIFIC_GAS / plant.buffer_volume[buffer]
    return Law(buffer, density, warmest - OUTWARD * KELVIN, stop, slack, falls_to)


@kernel
def start_tank(low: float, high: float, cold: float, warm: float, law: Law, plant: PlantConstants) -> Tank:
    """A buffer within these bounds."""
    phi, psi = 0.0, np.inf
    heating = plant.inlet_heating[law.buffer]
    if heating > 0.0:
        phi = max(inlet_flow(low, plant), 0.0) / heating  # lowered to that of the cap before it is used
        psi = max(inlet_flow(low, plant), 0.0) / heating * (1.0 + OUTWARD)
    load = loaded(high, cold, psi, law) if psi < np.inf else np.inf
    ripe = cold if high >= law.stop else np.inf
    return Tank(low, high, cold, warm, cold, ripe, phi, anchored(low, warm, phi, law), psi, load)


@kernel
def anchored(low: float, warm: float, phi: float, law: Law) -> float:
    """The least m - phi T of a buffer at a pressure of at least `low` [bar] that is at most `warm` [deg C]."""
    return low / (law.density * (warm + KELVIN)) * (1.0 - OUTWARD) - phi * warm


@kernel
def loaded(high: float, cold: float, psi: float, law: Law) -> float:
    """The greatest m - psi T of a buffer at a pressure of at most `high` [bar] that is at least `cold` deg C."""
    return high / (law.density * (cold + KELVIN)) * (1.0 + OUTWARD) - psi * cold


@kernel
def cooled(temperature: float, plant: PlantConstants) -> float:
    """A temperature a second on, of a buffer that is neither filled nor opened [deg C]."""
    return temperature + exchange_rate(temperature, plant)


@kernel
def quiet_ratio(temperature: float, cooling: float, plant: PlantConstants) -> float:
    """Pressure by pressure a second before, of a buffer that is not filled, per gram it holds."""
    return (cooled(temperature, plant) - cooling + KELVIN) / (temperature + KELVIN)


@kernel
def least_ratio(cold: float, warm: float, cooling: float, plant: PlantConstants) -> float:
    """The least of `quiet_ratio`; it is monotone in the temperature, so an end attains it."""
    return min(quiet_ratio(cold, cooling, plant), quiet_ratio(warm, cooling, plant)) * (1.0 - OUTWARD)


@kernel
def most_ratio(cold: float, warm: float, cooling: float, plant: PlantConstants) -> float:
    """The greatest of `quiet_ratio`."""
    return max(quiet_ratio(cold, cooling, plant), quiet_ratio(warm, cooling, plant)) * (1.0 + OUTWARD)


@kernel
def _filled_low(tank: Tank, law: Law, plant: PlantConstants) -> float:
    """The least pressure after a second of filling, of a buffer at its lowest pressure."""
    heating = plant.inlet_heating[law.buffer]
    ratio = min(quiet_ratio(tank.cold, -heating, plant), quiet_ratio(tank.warm, -heating, plant))
    gained = inlet_flow(tank.low, plant) * law.density * (cooled(tank.cold, plant) + heating + KELVIN)
    return (tank.low * ratio + max(gained, 0.0)) * (1.0 - OUTWARD)


@kernel
def _filled_high(pressure: float, tank: Tank, law: Law, plant: PlantConstants) -> float:
    """The greatest pressure after a second of filling from `pressure`."""
    heating = plant.inlet_heating[law.buffer]
    ratio = max(quiet_ratio(tank.cold, -heating, plant), quiet_ratio(tank.warm, -heating, plant))
    gained = inlet_flow(pressure, plant) * law.density * (cooled(tank.warm, plant) + heating + KELVIN)
    return (pressure * ratio + max(gained, 0.0)) * (1.0 + OUTWARD)


@kernel
def _coldest(cold: float, asked: int, law: Law, plant: PlantConstants) -> float:
    """The least temperature a second on of a buffer that is not full and of at least `cold` deg C."""
    if asked != YES or cold > law.warmest:
        return cooled(cold, plant)
    return min(cooled(cold, plant) + plant.inlet_heating[law.buffer], cooled(law.warmest, plant))


@kernel
def _ripening(tank: Tank, law: Law) -> float:
    """The coldest of those that become full in this second [deg C]: filling has warmed them as m - psi T says.

    The root is sought from the left, where Newton's steps on a concave function stay.
    """
    if tank.high < law.stop:
        return np.inf
    temperature = tank.lean
    if tank.load == np.inf:
        return temperature
    for _ in range(3):
        mass = law.stop / (law.density * (temperature + KELVIN)) * (1.0 - OUTWARD)
        lack = mass - tank.load - tank.psi * temperature
        if lack <= 0.0:
            break
        temperature += lack / (tank.psi + mass / (temperature + KELVIN)) * (1.0 - 1e-9)
    return temperature


@kernel
def _counted_low(tank: Tank, quiet: float, warm: float, law: Law, plant: PlantConstants) -> tuple[float, float]:
    """The phi of this second, and the least m - phi T a second on of those never full.

    phi is that of a buffer at `cap`: one that comes from above it has at least the mass that goes with the cap.
    """
    heating = plant.inlet_heating[law.buffer]
    at_warmest = (tank.heat + tank.phi * tank.warm) * law.density * (tank.warm + KELVIN)
    cap = min(tank.high, max(tank.low, at_warmest) * HEADROOM)
    phi = tank.phi
    if heating > 0.0:
        phi = min(phi, max(inlet_flow(min(cap, law.stop), plant), 0.0) / heating * (1.0 - OUTWARD))
    heat = (
        tank.heat + (tank.phi - phi) * tank.lean + phi * plant.heat_exchange * (tank.lean - plant.ambient_temperature)
    )
    heat -= OUTWARD * (abs(heat) + tank.phi * KELVIN)
    return phi, heat if tank.high <= cap else min(heat, anchored(cap * quiet, warm, phi, law))


@kernel
def _counted_high(tank: Tank, law: Law, plant: PlantConstants) -> tuple[float, float]:
    """The psi of this second, and the greatest m - psi T a second on."""
    heating = plant.inlet_heating[law.buffer]
    if heating <= 0.0:
        return np.inf, np.inf
    psi = max(inlet_flow(tank.low, plant), 0.0) / heating * (1.0 + OUTWARD)
    load = tank.load + (tank.psi - psi) * (tank.warm if tank.psi > psi else tank.cold)
    load += psi * plant.heat_exchange * (tank.warm - plant.ambient_temperature)
    return psi, load + OUTWARD * (abs(load) + (psi + tank.psi) * KELVIN)


@kernel
def step_tank(tank: Tank, asked: int, law: Law, plant: PlantConstants) -> Tank:
    """The bounds a second on of a buffer whose outlet is closed.

    `asked`: whether the compressor turns to it (NO, YES, MAYBE) where it is neither full nor too warm.
    """
    heating = plant.inlet_heating[law.buffer]
    margin = OUTWARD * KELVIN
    allowed_to = law.warmest + 3.0 * margin  # nothing warmer is ever filled
    may_fill = asked != NO and tank.cold <= allowed_to and tank.low < law.stop
    quiet = least_ratio(tank.cold, tank.warm, 0.0, plant)
    low = tank.low * quiet
    if asked == YES and tank.warm <= law.warmest:  # a full one is not filled: it stays above what `stop` falls to
        low = max(low, min(_filled_low(tank, law, plant), law.stop * quiet))
    high = tank.high * most_ratio(tank.cold, tank.warm, 0.0, plant)
    warm = cooled(tank.warm, plant)
    if may_fill:
        high = max(high, _filled_high(min(tank.high, law.stop), tank, law, plant))
        warm = max(warm, cooled(min(tank.warm, allowed_to), plant) + heating)
    warm += margin
    lean = _coldest(tank.lean, asked, law, plant) - margin
    ripe = min(tank.ripe, _ripening(tank, law))
    ripe = cooled(ripe, plant) - margin if ripe < np.inf else np.inf
    cold = min(lean, ripe)
    psi, load = _counted_high(tank, law, plant)
    if load < np.inf:
        high = min(high, max(load + psi * warm, 0.0) * law.density * (warm + KELVIN) * (1.0 + OUTWARD))
        load = min(load, loaded(high, cold, psi, law))
    phi, heat = _counted_low(tank, quiet, warm, law, plant)
    by_heat = (heat + phi * lean) * law.density * (lean + KELVIN) * (1.0 - OUTWARD)
    low = max(low, min(by_heat, law.stop - law.slack))
    return Tank(low, high, cold, warm, lean, ripe, phi, max(heat, anchored(low, warm, phi, law)), psi, load)
