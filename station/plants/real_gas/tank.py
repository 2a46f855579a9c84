"""A tank: mass, internal energy and wall temperatures; what flows in and out, and the heat its wall takes.

State of a tank in a flat array from `place` on: mass [kg], internal energy [J], temperatures of the inner surface and
of the wall's cells from the inside out [K].
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from station.compiled import formula, uncounted
from station.plants.real_gas.gas import energy_of, film, state_and_slopes, state_and_warmth
from station.plants.real_gas.gas import state as gas_state
from station.plants.real_gas.hydrogen import load_data
from station.plants.real_gas.tables import FORCED_EXPONENT, FREE_EXPONENT, GasTables
from station.plants.real_gas.wall import CELLS_PER_LAYER, Layer, Wall, exchange, wall_of

MASS, ENERGY, SURFACE, CELLS = 0, 1, 2, 3
"""Places in the state of a tank; `SURFACE` is followed by the cells."""

_CORRELATION = load_data("heat_transfer.toml")["inner_side"]
_FORCED, _FREE = float(_CORRELATION["forced"]), float(_CORRELATION["free"])


class Tank(NamedTuple):
    """A tank as kernels use it."""

    volume: float  # [m3]
    forced: float  # factor of the forced part, with area and diameters
    free: float  # factor of the free part, with area and diameter
    fixed: float  # heat transfer coefficient times area [W/K] where it is given, or a negative number
    wall: Wall


class Shape(NamedTuple):
    """An equivalent flat-ended cylinder [m], [m3]."""

    volume: float
    diameter: float
    length: float


@formula
def stirring(area: float, diameter: float, inlet: float) -> tuple[float, float]:
    """Factors of the forced and the free part of the inner coefficient, of the inner area [m2] and diameters [m]."""
    per_diameter = area / diameter
    forced = per_diameter * _FORCED * (4 / (math.pi * inlet)) ** FORCED_EXPONENT
    return forced, per_diameter * _FREE * diameter ** (3 * FREE_EXPONENT)


def tank_of(
    shape: Shape, layers: list[Layer], outer_coefficient: float, period: float, inlet_diameter: float | None = None,
    coefficient: float | None = None, cells_per_layer: int = CELLS_PER_LAYER,
) -> Tank:  # fmt: skip
    """A tank for steps of one period.

    The coefficient of the inner side is Nu_D = a Re_d^0.67 + b Ra_D^0.352, the form of Woodfield, Monde and Takano,
    J. Thermal Sci. Technol. 3 (2008) 241, 10.1299/jtst.3.241; a and b stand in the data file heat_transfer.toml.

    Parameters
    ----------
    shape
        Volume, inner diameter and inner length.
    layers
        Of the wall, from the inside out; none for a tank without heat transfer.
    outer_coefficient
        To the surroundings [W/(m2 K)].
    period
        Of the steps [s].
    inlet_diameter
        Of the pipe through which gas enters [m]; where it is unknown the tank's own.
    coefficient
        A constant heat transfer coefficient of the inner side [W/(m2 K)] instead of the correlation.
    cells_per_layer
        Cells that each layer is cut into.
    """
    adiabatic = [Layer("none", 1e-3, 1.0, 1.0, 1.0)]
    wall = wall_of(layers or adiabatic, shape.diameter, shape.length, outer_coefficient, period, cells_per_layer)
    given = 0.0 if not layers else coefficient
    forced, free = stirring(wall.area, shape.diameter, inlet_diameter or shape.diameter)
    return Tank(
        volume=shape.volume,
        forced=forced,
        free=free,
        fixed=-1.0 if given is None else given * wall.area,
        wall=wall,
    )


def state_length(tank: Tank) -> int:
    """How many entries the state of a tank takes."""
    return CELLS + len(tank.wall.capacity)


@uncounted
def fill_state(
    state: np.ndarray, place: int, tank: Tank, pressure: float, kelvin: float, wall_kelvin: float, gas: GasTables
) -> None:
    """Set a tank's state to a pressure [Pa] and temperatures of gas and wall [K]."""
    state[place + MASS], state[place + ENERGY] = energy_of(pressure, kelvin, tank.volume, gas)
    for cell in range(tank.wall.capacity.shape[0] + 1):
        state[place + SURFACE + cell] = wall_kelvin


@uncounted
def look(state: np.ndarray, place: int, tank: Tank, gas: GasTables) -> tuple[float, float]:
    """Pressure [Pa] and temperature [K] of the gas in a tank."""
    mass = state[place + MASS]
    return gas_state(mass / tank.volume, state[place + ENERGY] / mass, gas)


@uncounted
def look_warmly(state: np.ndarray, place: int, tank: Tank, gas: GasTables) -> tuple[float, float, float]:
    """Pressure [Pa], temperature [K] and cv [J/(kg K)] of the gas in a tank; the first two are those of `look`."""
    mass = state[place + MASS]
    return state_and_warmth(mass / tank.volume, state[place + ENERGY] / mass, gas)


@uncounted
def look_closely(state: np.ndarray, place: int, tank: Tank, gas: GasTables) -> tuple[float, float, float, float, float]:
    """Pressure [Pa], temperature [K], dp/drho [J/kg], dp/du [kg/m3] and cv [J/(kg K)] of the gas in a tank."""
    mass = state[place + MASS]
    return state_and_slopes(mass / tank.volume, state[place + ENERGY] / mass, gas)


@uncounted
def stiffness(rho: float, u: float, by_rho: float, by_u: float, h: float, volume: float) -> float:
    """By how much a kilogram of enthalpy `h` [J/kg] raises the pressure of a tank [Pa/kg]."""
    return (by_rho + by_u * (h - u) / rho) / volume


@uncounted
def draw(state: np.ndarray, place: int, tank: Tank, mass: float, gas: GasTables) -> float:
    """Take a mass [kg] out of a tank, by the midpoint rule; gives the enthalpy that leaves with it [J]."""
    held, energy = state[place + MASS], state[place + ENERGY]
    rho = held / tank.volume
    p, _ = gas_state(rho, energy / held, gas)
    left = held - 0.5 * mass
    then = energy - 0.5 * mass * (energy / held + p / rho)
    rho = left / tank.volume
    p, _ = gas_state(rho, then / left, gas)
    gone = mass * (then / left + p / rho)
    state[place + MASS] = held - mass
    state[place + ENERGY] = energy - gone
    return gone


@uncounted
def add(state: np.ndarray, place: int, mass: float, enthalpy: float) -> None:
    """Put a mass [kg] with its enthalpy [J] into a tank."""
    state[place + MASS] += mass
    state[place + ENERGY] += enthalpy


@uncounted
def inner_transfer(p: float, kelvin: float, surface: float, inflow: float, tank: Tank, gas: GasTables) -> float:
    """Heat transfer at the inner surface, coefficient times area [W/K]: Nu_D = a Re_d^0.67 + b Ra_D^0.352.

    `inflow` [kg/s] is what enters through the inlet; gas that leaves stirs nothing.
    """
    if tank.fixed >= 0.0:
        return tank.fixed
    forced, free = film(p, 0.5 * (kelvin + surface), gas)
    found = 0.0
    if inflow > 0.0:
        found = tank.forced * forced * inflow**FORCED_EXPONENT
    gap = p * p * abs(kelvin - surface)
    if gap > 0.0:
        found += tank.free * free * gap**FREE_EXPONENT
    return found


@uncounted
def settle(
    state: np.ndarray, place: int, tank: Tank, inflow: float, surroundings: float, period: float, gas: GasTables
) -> tuple[float, float]:
    """Let gas, wall and surroundings [K] exchange heat for a period; what the gas gave and what left outside [J]."""
    p, kelvin, cv = look_warmly(state, place, tank, gas)
    inner = inner_transfer(p, kelvin, state[place + SURFACE], inflow, tank, gas)
    return give_heat(state, place, tank, kelvin, cv, inner, surroundings, period)


@uncounted
def give_heat(
    state: np.ndarray, place: int, tank: Tank, kelvin: float, cv: float, inner: float, surroundings: float,
    period: float,
) -> tuple[float, float]:  # fmt: skip
    """The same where temperature [K] and cv [J/(kg K)] of the gas, and `inner_transfer`, are known."""
    mass = state[place + MASS]
    given, lost = exchange(state, place + SURFACE, tank.wall, kelvin, mass * cv / period, inner, surroundings, period)
    state[place + ENERGY] -= given
    return given, lost
