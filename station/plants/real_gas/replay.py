"""A measured case run with the model: the tank under the boundary that was measured."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from station.compiled import kernel
from station.errors import InputError
from station.plants.real_gas.cases import Case, Series
from station.plants.real_gas.flow import orifice_flow
from station.plants.real_gas.gas import enthalpy
from station.plants.real_gas.leachman import Array
from station.plants.real_gas.tables import PRESSURE_MAX, TEMPERATURE_MAX, TEMPERATURE_MIN, GasTables, gas_tables
from station.plants.real_gas.tank import (
    ENERGY,
    MASS,
    SURFACE,
    Shape,
    Tank,
    add,
    draw,
    fill_state,
    look,
    look_closely,
    settle,
    state_length,
    stiffness,
    tank_of,
)
from station.plants.real_gas.wall import Layer

FLOW, ORIFICE_OUT, ORIFICE_IN, PRESSURE = range(4)
"""What drives the tank of a replay."""

_STEPS = 5000
_PERIOD_MIN = 0.005
_CORRECTIONS = 4
_EMPTY = 0.98
"""No more of a tank's mass leaves in a step of a replay."""

_MPA = 1e6


class Replay(NamedTuple):
    """A case as the model runs it, one entry a step, the first at time 0."""

    time: Array  # [s]
    pressure: Array  # [Pa]
    temperature: Array  # of the gas [K]
    surface: Array  # inner surface of the wall [K]
    outer: Array  # outermost cell of the wall [K]
    mass: Array  # [kg]


@kernel
def _move(
    state: np.ndarray, tank: Tank, mass: float, inlet_p: float, inlet_kelvin: float, ambient: float, period: float,
    gas: GasTables,
) -> None:  # fmt: skip
    """One period in which a mass [kg] enters (positive) or leaves, and heat is exchanged."""
    if mass > 0.0:
        p, _, by_rho, by_u, _ = look_closely(state, 0, tank, gas)
        if not inlet_p > 0.0:  # the gas' enthalpy is taken at the tank's own pressure, in the middle of the step
            h = enthalpy(p, inlet_kelvin, gas)
            rise = stiffness(state[MASS] / tank.volume, state[ENERGY] / state[MASS], by_rho, by_u, h, tank.volume)
            inlet_p = p + 0.5 * mass * rise
        add(state, 0, mass, mass * enthalpy(inlet_p, inlet_kelvin, gas))
    elif mass < 0.0:
        draw(state, 0, tank, min(-mass, _EMPTY * state[MASS]), gas)
    settle(state, 0, tank, max(mass, 0.0) / period, ambient, period, gas)


@kernel
def _mass_to(
    state: np.ndarray, trial: np.ndarray, tank: Tank, target: float, inlet_p: float, inlet_kelvin: float,
    ambient: float, period: float, last: float, signs: tuple[bool, bool], gas: GasTables,
) -> float:  # fmt: skip
    """The mass [kg] whose entry or exit leads to a pressure [Pa] at the end of a period, as far as it may."""
    p, kelvin, by_rho, by_u, _ = look_closely(state, 0, tank, gas)
    h = enthalpy(p, inlet_kelvin if target > p and inlet_kelvin > 0.0 else kelvin, gas)
    rise = stiffness(state[MASS] / tank.volume, state[ENERGY] / state[MASS], by_rho, by_u, h, tank.volume)
    mass = last
    for _ in range(_CORRECTIONS):
        trial[:] = state
        _move(trial, tank, mass, inlet_p, inlet_kelvin, ambient, period, gas)
        mass += (target - look(trial, 0, tank, gas)[0]) / rise
        if (mass > 0.0 and not signs[0]) or (mass < 0.0 and not signs[1]):
            mass = 0.0
    return mass


@kernel
def _run(
    state: np.ndarray, tank: Tank, driver: int, drive: np.ndarray, inlet_p: np.ndarray, inlet_kelvin: np.ndarray,
    area: float, ambient: float, period: float, signs: tuple[bool, bool], out: np.ndarray, gas: GasTables,
) -> None:  # fmt: skip
    """Run a case; `out` gets pressure, temperature, surface, outermost cell and mass after each step.

    `drive` has for each step the flow [kg/s], the pressure at the end of the step [Pa] or the back pressure [Pa];
    `signs` says whether gas may enter and leave. A pressure of nan moves nothing.
    """
    trial = state.copy()
    last = 0.0
    for step in range(drive.shape[0]):
        p, kelvin = look(state, 0, tank, gas)
        if driver == FLOW:
            mass = drive[step] * period
        elif driver == ORIFICE_OUT:
            mass = -orifice_flow(area, p, kelvin, drive[step], gas) * period
        elif driver == ORIFICE_IN:
            mass = orifice_flow(area, inlet_p[step], inlet_kelvin[step], p, gas) * period
        elif np.isnan(drive[step]):
            mass = 0.0
        else:
            mass = _mass_to(
                state, trial, tank, drive[step], inlet_p[step], inlet_kelvin[step], ambient, period, last, signs, gas
            )
        last = mass
        _move(state, tank, mass, inlet_p[step], inlet_kelvin[step], ambient, period, gas)
        out[0, step], out[1, step] = look(state, 0, tank, gas)
        out[2, step], out[3, step], out[4, step] = state[SURFACE], state[-1], state[MASS]


def _values(given: Series | None, time: Array) -> Array:
    """A series at times; nan where nothing is given."""
    return np.full(time.shape, np.nan) if given is None else given.at(time)


def _drive(case: Case, time: Array, period: float) -> tuple[int, Array]:
    """What drives the tank, and its value for each step that begins at `time`."""
    boundary = case.boundary
    if boundary.mass_flow_kg_s is not None:
        return FLOW, boundary.mass_flow_factor * boundary.mass_flow_kg_s.at(time + period / 2)
    if boundary.orifice is not None:
        back = boundary.orifice.back_pressure_MPa
        return ORIFICE_IN if back is None else ORIFICE_OUT, _values(back, time + period / 2) * _MPA
    if boundary.pressure_MPa is not None:
        return PRESSURE, _followed(boundary.pressure_MPa, case.initial.pressure_MPa, time + period)
    return PRESSURE, _ramp(case, time + period)


def _followed(series: Series, start: float, time: Array) -> Array:
    """Pressures [Pa] of a series [MPa], from the pressure at the start to its first point, and nan after its last."""
    known, values = np.array(series.time_s), np.array(series.value)
    if known[0] > 0:
        known, values = np.insert(known, 0, 0.0), np.insert(values, 0, start)
    target = np.interp(time, known, values) * _MPA
    target[time > known[-1] + (time[1] - time[0] if len(time) > 1 else 0.0) / 2] = np.nan
    return target


def _ramp(case: Case, time: Array) -> Array:
    """Pressures [Pa] of a ramp up or down to its end, and nan once it is there."""
    ramp, end = case.boundary.pressure_ramp_MPa_per_min or 0.0, (case.boundary.end_pressure_MPa or 0.0) * _MPA
    target = (case.initial.pressure_MPa + ramp / 60 * time) * _MPA
    beyond = (target - end) * np.sign(ramp) >= 0
    target[beyond] = np.nan
    if beyond.any():
        target[np.argmax(beyond)] = end
    return target


def _tank(case: Case, period: float) -> Tank:
    """The tank of a case."""
    fields = case.tank
    length = fields.inner_length_m or fields.volume_m3 / (math.pi / 4 * fields.inner_diameter_m**2)
    layers = [
        Layer(layer.name, layer.thickness_m, layer.density_kg_m3, layer.heat_capacity_J_kgK, layer.conductivity_W_mK)
        for layer in fields.layers
    ]
    shape = Shape(fields.volume_m3, fields.inner_diameter_m, length)
    outer = case.ambient.outer_coefficient_W_m2K
    return tank_of(shape, layers, outer, period, fields.inlet_diameter_m)


def period_of(case: Case) -> float:
    """Length of the steps a case is run in [s]."""
    return max(_PERIOD_MIN, case.end / _STEPS)


def replay(case: Case, source: str, area: float | None = None, period: float | None = None) -> Replay:
    """Run a case with the model.

    Parameters
    ----------
    case
        What was measured, and what drove it.
    source
        What errors call it.
    area
        Effective area of its orifice [m2] instead of the one it names.
    period
        Of the steps [s]; by default a five-thousandth of its time.

    Raises
    ------
    InputError
        if the gas leaves the pressures and temperatures that the model holds for.
    """
    period = period or period_of(case)
    steps = max(1, round(case.end / period))
    time = np.arange(steps) * period
    gas = gas_tables()
    tank = _tank(case, period)
    start = case.initial
    state = np.zeros(state_length(tank))
    wall = start.wall_temperature_K or start.temperature_K
    fill_state(state, 0, tank, start.pressure_MPa * _MPA, start.temperature_K, wall, gas)
    driver, drive = _drive(case, time, period)
    boundary = case.boundary
    pressure = boundary.supply_pressure_MPa if driver == ORIFICE_IN else boundary.inlet_pressure
    middle = time + period / 2
    out = np.empty((5, steps + 1))
    out[:, 0] = start.pressure_MPa * _MPA, start.temperature_K, wall, wall, state[MASS]
    signs = (case.fills, case.kind != "fill")
    _run(
        state, tank, driver, drive, _values(pressure, middle) * _MPA, _values(boundary.inlet_kelvin, middle),
        area or named_area(case), case.ambient.temperature_K, period, signs, out[:, 1:], gas,
    )  # fmt: skip
    found = Replay(np.append(time, time[-1] + period), *out)
    _check(found, source)
    return found


def named_area(case: Case) -> float:
    """Effective area of the orifice as the case names it [m2]; one square millimetre where it names none."""
    orifice = case.boundary.orifice
    if orifice is None:
        return 0.0
    return orifice.discharge_coefficient * math.pi / 4 * (orifice.diameter_m or 1.128e-3) ** 2


def _check(found: Replay, source: str) -> None:
    """Raise InputError where the gas has left what the tables hold for."""
    fine = (found.temperature >= TEMPERATURE_MIN) & (found.temperature <= TEMPERATURE_MAX)
    fine &= (found.pressure > 0) & (found.pressure <= PRESSURE_MAX)
    if not fine.all():
        first = int(np.argmin(fine))
        raise InputError(source, [("boundary", (
            f"leads at {found.time[first]:.4g} s to {found.pressure[first] / _MPA:.4g} MPa and "
            f"{found.temperature[first]:.4g} K; the model holds up to {PRESSURE_MAX / _MPA:g} MPa, from "
            f"{TEMPERATURE_MIN:g} to {TEMPERATURE_MAX:g} K"
        ))])  # fmt: skip
