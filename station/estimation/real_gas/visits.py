"""A vehicle comes, and goes, in the filter of the faithful plant."""

from __future__ import annotations

import numpy as np

from station.compiled import uncounted
from station.estimation.real_gas.slopes import P_ENERGY, P_MASS, T_ENERGY, T_MASS, look_at
from station.estimation.real_gas.states import (
    AIR,
    BIASED,
    LINER,
    PACK,
    PACK_ENERGY,
    RAMP_AIM,
    SHELL,
    VEHICLE_ENERGY,
    VEHICLE_MASS,
    Scratch,
)
from station.geometry import KELVIN, VEHICLE
from station.plants.real_gas import station as machines
from station.plants.real_gas.entries import INSIDE, RealGasConstants, connected_tank, connected_visit, make_vehicle
from station.plants.real_gas.hydrogen import BAR
from station.plants.real_gas.layout import LINE_ENERGY, LINE_MASS

_SOAKED = (1.0, 2.0)
"""By how much liner and shell of a vehicle that comes may differ from its gas, standard deviations [K]."""

_VENTED = 0.02
"""Standard deviation of what is left in a vented line, as a part of it [1]."""


@uncounted
def begin_tank(
    s: Scratch, mass: int, energy: int, tank: int, pressure: float, kelvin: float
) -> tuple[float, float, float, float]:
    """The covariance of mass and energy from readings with errors [Pa], [K]; slopes of both by both readings."""
    determinant = s.gas[tank, P_MASS] * s.gas[tank, T_ENERGY] - s.gas[tank, P_ENERGY] * s.gas[tank, T_MASS]
    m_p, m_t = s.gas[tank, T_ENERGY] / determinant, -s.gas[tank, P_ENERGY] / determinant
    e_p, e_t = -s.gas[tank, T_MASS] / determinant, s.gas[tank, P_MASS] / determinant
    sp, st = pressure * pressure, kelvin * kelvin
    s.cov[mass, mass] = m_p * m_p * sp + m_t * m_t * st
    s.cov[energy, energy] = e_p * e_p * sp + e_t * e_t * st
    s.cov[mass, energy] = m_p * e_p * sp + m_t * e_t * st
    s.cov[energy, mass] = s.cov[mass, energy]
    return m_p, e_p, m_t, e_t


@uncounted
def tie(s: Scratch, one: int, other: int, value: float) -> None:
    """Let two coordinates vary together."""
    s.cov[one, other], s.cov[other, one] = value, value


@uncounted
def _forget(s: Scratch) -> None:
    """No vehicle's coordinate varies."""
    for place in range(VEHICLE_MASS, AIR):
        for other in range(BIASED):
            tie(s, place, other, 0.0)


@uncounted
def connect(
    s: Scratch, pressure: float, temperature: float, sp: float, st: float, usual: tuple[float, float, float, float],
    plant: RealGasConstants,
) -> None:  # fmt: skip
    """Begin a vehicle with its first readings [bar], [deg C] and their noise; where there are none, with the usual."""
    s.behind[VEHICLE], s.given[0] = 0.0, -1.0
    if np.isnan(pressure):
        pressure, sp = usual[0], 100.0
    if np.isnan(temperature):
        temperature, st = usual[1], 10.0
    pressure = max(pressure, 1.0)
    make_vehicle(s.state, pressure * BAR, temperature + KELVIN, s.volume[0], usual[3] * BAR, plant)
    machines.connect(s.state[INSIDE:], connected_tank(s.state), connected_visit(s.state), plant.station, plant.gas)
    look_at(s, VEHICLE, s.volume[0], plant.station, plant.gas)
    _forget(s)
    m_p, e_p, m_t, e_t = begin_tank(s, VEHICLE_MASS, VEHICLE_ENERGY, VEHICLE, sp * BAR, st)
    variance = (sp * BAR) ** 2
    s.cov[RAMP_AIM, RAMP_AIM] = variance
    tie(s, RAMP_AIM, VEHICLE_MASS, m_p * variance)
    tie(s, RAMP_AIM, VEHICLE_ENERGY, e_p * variance)
    variance = st * st
    for place in range(LINER, SHELL + 1):
        tie(s, place, VEHICLE_MASS, m_t * variance)
        tie(s, place, VEHICLE_ENERGY, e_t * variance)
        s.cov[place, place] = variance + _SOAKED[place - LINER] ** 2
    tie(s, LINER, SHELL, variance)
    tail = INSIDE + plant.station.rest_at
    mass, energy = _VENTED * s.state[tail + LINE_MASS], _VENTED * s.state[tail + LINE_ENERGY]
    s.cov[PACK, PACK], s.cov[PACK_ENERGY, PACK_ENERGY] = mass * mass, energy * energy
    tie(s, PACK, PACK_ENERGY, mass * energy)


@uncounted
def disconnect(s: Scratch, plant: RealGasConstants) -> None:
    """Let the vehicle go; the line is vented."""
    machines.disconnect(s.state[INSIDE:], connected_tank(s.state), plant.station, plant.gas)
    _forget(s)
