"""One fill of a vehicle's tank: a pressure ramp, the nozzle's limit of flow, and what ends it."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from station.compiled import kernel
from station.plants.real_gas.catalog import DISPENSING, TEMPERATURE_LIMIT, TankKind, vehicle_tank
from station.plants.real_gas.gas import enthalpy
from station.plants.real_gas.leachman import Array
from station.plants.real_gas.tables import GasTables, gas_tables
from station.plants.real_gas.tank import (
    ENERGY,
    MASS,
    SURFACE,
    Tank,
    add,
    fill_state,
    look,
    look_closely,
    settle,
    state_length,
    stiffness,
)

PERIOD = 1.0
"""Of the steps that tanks are made for: of a fill, and of a run [s]."""

_AIM = 1e4
"""A fill that ends by pressure aims so far below the limit, and has ended within as much of the aim [Pa]."""

_LIMITS = DISPENSING["limits"]


class End(IntEnum):
    """Reason for which a fill ended."""

    TIME = 0
    STATE_OF_CHARGE = 1
    PRESSURE = 2
    TEMPERATURE = 3
    FULL = 4  # no communication, and the pressure is where the coldest tank would be full


BY_TIME, BY_CHARGE, BY_PRESSURE, BY_TEMPERATURE, WHEN_FULL = (int(end) for end in End)
"""The ends that kernels give, as plain numbers."""

NOT_ENDED = -1
"""What kernels give while a fill goes on."""


class Dispenser(NamedTuple):
    """Figures of the dispenser, as kernels use them."""

    ramp: float  # [Pa/s]
    flow_max: float  # [kg/s]
    delivery: float  # temperature of the gas at the nozzle, at the nozzle's own pressure [K]
    cooldown: float = 0.0  # for so long at first it comes as warm as the surroundings [s]


class Ends(NamedTuple):
    """Limits that end a fill, as kernels use them."""

    mass: float  # [kg]; infinite for none
    pressure: float  # [Pa]
    temperature: float  # of the gas [K]; infinite for none
    time: float  # [s]


class FillStart(NamedTuple):
    """A vehicle's tank before a fill."""

    pressure: float  # [Pa]
    temperature: float  # of gas and wall [K]
    ambient: float  # [K]


class Fill(NamedTuple):
    """A fill, one entry a step, the first at time 0."""

    kind: TankKind
    dispenser: Dispenser
    time: Array  # [s]
    pressure: Array  # [Pa]
    temperature: Array  # of the gas [K]
    surface: Array  # inner surface of the wall [K]
    outer: Array  # outermost cell of the wall [K]
    flow: Array  # into the tank until the next entry [kg/s]
    mass: Array  # [kg]
    end: End

    @property
    def state_of_charge(self) -> Array:
        """Density as a share of that at the nominal working pressure and 15 degC, SAE J2601."""
        return self.mass / self.kind.full_mass


@kernel
def _next_mass(
    state: np.ndarray, tank: Tank, target: float, given: float, delivery: float, most: float, gas: GasTables
) -> tuple[float, float]:
    """The mass [kg], `most` of it, that leads to a pressure [Pa] a period on, and its enthalpy [J/kg].

    `given`: the heat that the wall took in the period before [J]; it takes as much again, about.
    """
    p, _, by_rho, by_u, _ = look_closely(state, 0, tank, gas)
    held = state[MASS]
    h = enthalpy(p, delivery, gas)
    rise = stiffness(held / tank.volume, state[ENERGY] / held, by_rho, by_u, h, tank.volume)
    mass = min(max((target - p + by_u * given / held) / rise, 0.0), most)
    return mass, enthalpy(p + 0.5 * mass * rise, delivery, gas)


@kernel
def run_fill(
    state: np.ndarray, tank: Tank, dispenser: Dispenser, ends: Ends, ambient: float, period: float, out: np.ndarray,
    gas: GasTables,
) -> tuple[int, int, float]:  # fmt: skip
    """Fill a tank until something ends it.

    `out` gets pressure, temperature, surface, outermost cell, flow and mass of each step while it has room; its
    last entry is the end.

    Returns
    -------
    tuple
        What ended it (`End`), how many steps it took, the highest temperature of the gas [K].
    """
    p, kelvin = look(state, 0, tank, gas)
    start, given, steps = p, 0.0, 0
    highest, room = kelvin, out.shape[1]
    end = NOT_ENDED
    while end == NOT_ENDED:
        target = min(start + dispenser.ramp * period * (steps + 1), ends.pressure - 0.5 * _AIM)
        delivery = ambient if steps * period < dispenser.cooldown else dispenser.delivery
        most = min(dispenser.flow_max * period, max(ends.mass - state[MASS], 0.0))
        mass, h = _next_mass(state, tank, target, given, delivery, most, gas)
        if steps < room:
            out[0, steps], out[1, steps], out[2, steps] = p, kelvin, state[SURFACE]
            out[3, steps], out[4, steps], out[5, steps] = state[-1], mass / period, state[MASS]
        add(state, 0, mass, mass * h)
        given, _ = settle(state, 0, tank, mass / period, ambient, period, gas)
        before = kelvin
        p, kelvin = look(state, 0, tank, gas)
        highest = max(highest, kelvin)
        steps += 1
        if state[MASS] >= ends.mass * (1.0 - 1e-12):
            end = BY_CHARGE
        elif p >= ends.pressure - _AIM:
            end = BY_PRESSURE
        elif kelvin + max(kelvin - before, 0.0) >= ends.temperature:
            end = BY_TEMPERATURE
        elif steps * period >= ends.time:
            end = BY_TIME
    if steps < room:
        out[0, steps], out[1, steps], out[2, steps] = p, kelvin, state[SURFACE]
        out[3, steps], out[4, steps], out[5, steps] = state[-1], 0.0, state[MASS]
    return end, steps, highest


def flow_limit() -> float:
    """The usual limit of the nozzle's flow [kg/s]."""
    return float(_LIMITS["flow_max_g_s"]) * 1e-3


def fill_tank(
    kind: TankKind, start: FillStart, dispenser: Dispenser, target: float, pressure_target: float | None = None,
    period: float = PERIOD,
) -> Fill:  # fmt: skip
    """Fill a tank of a class.

    Parameters
    ----------
    kind, start
        The tank and how it arrives.
    dispenser
        Ramp, limit of flow and temperature of the gas.
    target
        State of charge that ends it where the vehicle communicates.
    pressure_target
        The pressure that ends it where the vehicle does not [Pa]; then `target` is not known to the dispenser.
    period
        Of the steps [s].
    """
    gas = gas_tables()
    tank = vehicle_tank(kind, period)
    state = np.zeros(state_length(tank))
    fill_state(state, 0, tank, start.pressure, start.temperature, start.temperature, gas)
    limit = float(_LIMITS["time_max_s"])
    ends = ends_of(kind, target, pressure_target)
    out = np.full((6, round(limit / period) + 2), np.nan)
    end, steps, _ = run_fill(state, tank, dispenser, ends, start.ambient, period, out, gas)
    found = out[:, : steps + 1]
    cause = End(end)
    if cause is End.PRESSURE and pressure_target is not None and pressure_target < kind.pressure_max:
        cause = End.FULL
    time = np.arange(steps + 1) * period
    return Fill(
        kind, dispenser, time, found[0], found[1], found[2], found[3], found[4], found[5], cause
    )  # fmt: skip


def ends_of(
    kind: TankKind, target: float, pressure_target: float | None, temperature: float = TEMPERATURE_LIMIT
) -> Ends:
    """Limits that end a fill of a tank: a state of charge, or without communication a pressure, and the limits."""
    limit = float(_LIMITS["time_max_s"])
    if pressure_target is None:
        return Ends(target * kind.full_mass, kind.pressure_max, temperature, limit)
    return Ends(np.inf, min(pressure_target, kind.pressure_max), temperature, limit)
