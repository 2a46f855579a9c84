"""From the banks into the vehicle: valves, ramp and nozzle, precooler and line, for one period."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from station.compiled import uncounted
from station.plants.real_gas.flow import implicit_flow, orifice_flow
from station.plants.real_gas.gas import density_and_enthalpy, enthalpy, temperature_of_enthalpy
from station.plants.real_gas.layout import (
    AIM,
    BANKS,
    BLOCK,
    DELIVERY,
    HEAT,
    LINE_ENERGY,
    LINE_MASS,
    RealGasStation,
    Visit,
    bank_at,
)
from station.plants.real_gas.precooler import cooled
from station.plants.real_gas.tables import GasTables
from station.plants.real_gas.tank import ENERGY, MASS, Tank, add, draw, look, look_closely, stiffness

_WINDUP = 5.0
"""The aim of the ramp runs no further ahead of the vehicle than the ramp does in so long [s]."""


class Wanted(NamedTuple):
    """Mass that ramp, nozzle and the ends of a fill let flow in a period, and what it does to the vehicle."""

    mass: float  # [kg]
    pressure: float  # of the vehicle before [Pa]
    rise: float  # of it by a kilogram [Pa/kg]
    aim: float  # of the ramp after it [Pa]


@uncounted
def wanted(
    state: np.ndarray, vehicle: Tank, visit: Visit, station: RealGasStation, period: float, gas: GasTables
) -> Wanted:
    """Mass that may flow into the vehicle in a period, if a bank gives it."""
    at, tail = station.vehicle_at, station.rest_at
    p, _, by_rho, by_u, _ = look_closely(state, at, vehicle, gas)
    held = state[at + MASS]
    h = enthalpy(p, state[tail + BLOCK], gas)
    rise = stiffness(held / vehicle.volume, state[at + ENERGY] / held, by_rho, by_u, h, vehicle.volume)
    step = visit.ramp * period
    aim = min(state[tail + AIM] + step, p + visit.ramp * _WINDUP, visit.pressure_max)
    mass = (aim - p + by_u * state[tail + HEAT] / held) / rise
    mass = min(mass, station.line.flow_max * period, visit.mass - held)
    return Wanted(max(mass, 0.0), p, rise, max(aim, p))


@uncounted
def _take(
    state: np.ndarray, command: int, asked: float, p: float, rise: float, station: RealGasStation, period: float,
    gas: GasTables,
) -> tuple[float, float]:  # fmt: skip
    """Take gas from the banks whose outlets are open: mass [kg] and enthalpy [J], not more than asked."""
    flows = (0.0, 0.0, 0.0)
    total = 0.0
    for place in range(BANKS):
        if command >> (BANKS + place) & 1:
            at, bank = place * station.stride, bank_at(place, station)
            source, kelvin, by_rho, by_u, _ = look_closely(state, at, bank, gas)
            rho, u = state[at + MASS] / bank.volume, state[at + ENERGY] / state[at + MASS]
            falls = stiffness(rho, u, by_rho, by_u, u + source / rho, bank.volume)
            explicit = orifice_flow(station.line.area, source, kelvin, p, gas)
            flow = implicit_flow(explicit, source - p, rise + falls, period)
            flows = (
                flow if place == 0 else flows[0], flow if place == 1 else flows[1], flow if place == 2 else flows[2]
            )  # fmt: skip
            total += flow * period
    if total <= 0.0 or asked <= 0.0:
        return 0.0, 0.0
    share = min(asked / total, 1.0) * period
    mass, carried = 0.0, 0.0
    for place in range(BANKS):
        if flows[place] > 0.0:
            carried += draw(state, place * station.stride, bank_at(place, station), flows[place] * share, gas)
            mass += flows[place] * share
    return mass, carried


@uncounted
def _through_line(
    tail: np.ndarray, mass: float, carried: float, most: float, p: float, kelvin: float, volume: float, gas: GasTables
) -> tuple[float, float]:
    """What leaves the line for the vehicle, `most` of it, when a mass [kg] with its enthalpy [J] enters.

    The line ends at the vehicle's pressure [Pa] and the delivery temperature [K]; until it has its gas nothing leaves.
    """
    rho, h = density_and_enthalpy(p, kelvin, gas)
    kept = rho * volume
    passed = mass - (kept - tail[LINE_MASS])
    if passed < abs(kept - tail[LINE_MASS]):
        tail[LINE_MASS] += mass
        tail[LINE_ENERGY] += carried
        return 0.0, 0.0
    passed = min(passed, most)
    kept = tail[LINE_MASS] + mass - passed
    energy = kept * (h - p / rho)
    given = carried + tail[LINE_ENERGY] - energy
    tail[LINE_ENERGY] = energy
    tail[LINE_MASS] = kept
    return passed, given


@uncounted
def dispense(
    state: np.ndarray, vehicle: Tank, visit: Visit, command: int, station: RealGasStation, period: float,
    gas: GasTables,
) -> tuple[float, float]:  # fmt: skip
    """Let gas flow through precooler and line into the vehicle; the mass that entered it [kg], the heat cooled [J]."""
    tail = state[station.rest_at :]
    asked, p, rise, tail[AIM] = wanted(state, vehicle, visit, station, period, gas)
    mass, carried = _take(state, command, asked, p, rise, station, period, gas)
    if mass <= 0.0:
        return 0.0, 0.0
    return _deliver(state, visit, mass, carried, p + 0.5 * mass * rise, station, period, gas)


@uncounted
def seep(
    state: np.ndarray, place: int, mass: float, vehicle: Tank, visit: Visit, station: RealGasStation, gas: GasTables
) -> None:
    """Let a mass [kg] flow from a bank, whose outlet is closed, through precooler and line to the vehicle."""
    tail = state[station.rest_at :]
    carried = draw(state, place * station.stride, bank_at(place, station), mass, gas)
    p = look(state, station.vehicle_at, vehicle, gas)[0]
    _, heat = _deliver(state, visit, mass, carried, p, station, 1.0, gas)
    tail[BLOCK] += heat / station.precooler.capacity


@uncounted
def _deliver(
    state: np.ndarray, visit: Visit, mass: float, carried: float, nozzle: float, station: RealGasStation,
    period: float, gas: GasTables,
) -> tuple[float, float]:  # fmt: skip
    """Let a mass [kg] with its enthalpy [J] through; what entered the vehicle [kg], the heat cooled [J].

    `nozzle` is the pressure behind the line [Pa].
    """
    at, tail = station.vehicle_at, state[station.rest_at :]
    h = cooled(carried / mass, nozzle, tail[BLOCK], station.precooler, gas)
    heat = carried - mass * h
    tail[DELIVERY] = temperature_of_enthalpy(nozzle, h, tail[BLOCK], gas)
    most = min(visit.mass - state[at + MASS], station.line.flow_max * period)
    passed, given = _through_line(tail, mass, mass * h, most, nozzle, tail[DELIVERY], station.line.volume, gas)
    add(state, at, passed, given)
    return passed, heat
