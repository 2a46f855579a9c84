"""From one second to the next in the filter of the faithful plant: the mean, its covariance, and what is not known."""

from __future__ import annotations

import numpy as np

from station.compiled import uncounted
from station.estimation.covariance import times, turn
from station.estimation.drifting import forget, lost_mass, warmed
from station.estimation.interface import Tuning
from station.estimation.real_gas.slopes import ENTHALPY, P_ENERGY, P_MASS, T_ENERGY
from station.estimation.real_gas.states import (
    AIR,
    BANK_ENERGY,
    BANK_WALL,
    BIASED,
    COMPRESSOR,
    DISPENSER,
    LEAKS,
    LINER,
    PLANT_STATES,
    RAMP_AIM,
    SHELL,
    VEHICLE_ENERGY,
    VEHICLE_MASS,
    WARMER,
    N,
    Scratch,
    move,
)
from station.geometry import VEHICLE
from station.plants.real_gas.entries import INSIDE, KILO, RealGasConstants, connected_tank
from station.plants.real_gas.layout import ALL_BANKS, BANKS
from station.plants.real_gas.tank import ENERGY, MASS

_AIR = 1e-3  # what a second adds to the deviation of the surroundings [K]: they are read by nobody
_EXACT = (0.5, 0.2)  # parts of the stiff tuning's masses and temperatures: this plant has walls and real gas
_AIM = 2e3  # of the ramp's aim, for each gram of a tank's [Pa/g]
_WARMER = 8.0  # of a precooler's fault while gas flows, for each kelvin of a tank's [1]


@uncounted
def propagate(s: Scratch, size: int, plant: RealGasConstants) -> None:
    """Take the second that was looked at, from where the flow meters have moved its beginning to."""
    inside, vehicle = s.state[INSIDE:], connected_tank(s.state)
    for entry in range(inside.shape[0]):
        inside[entry] = s.following[entry]
    for row in range(AIR):
        moved = 0.0
        for column in range(size):
            moved += s.transition[row, column] * s.delta[column]
        if moved != 0.0:
            move(inside, row, moved, vehicle, plant.station)
    times(s.transition, s.cov, s.half, size)
    turn(s.half, size)
    times(s.transition, s.half, s.cov, size)


@uncounted
def blur(s: Scratch, mass: int, energy: int, tank: int, grams: float, kelvin: float) -> None:
    """A mass [g] with its enthalpy, and a temperature [K], that are not known of a tank."""
    m, h = (grams / KILO) ** 2, s.gas[tank, ENTHALPY]
    s.cov[mass, mass] += m
    s.cov[mass, energy] += m * h
    s.cov[energy, mass] += m * h
    s.cov[energy, energy] += m * h * h + (kelvin / s.gas[tank, T_ENERGY]) ** 2


_UNSEEN_GAS = 30.0
"""What an outlet may give in a second in which nobody told it, or which vehicle is connected [g]."""

_UNSEEN_WARMTH = 0.5
"""By how much a vehicle's gas may then be off beside [K]: what comes is colder than its own."""


@uncounted
def _pass_unseen(s: Scratch, bank: int, grams: float) -> None:
    """Add to the covariance what a bank may have given to the vehicle [g]: the one lost what the other got.

    The vehicle's next pressures so tell what the bank has given. The ramp goes on from the vehicle's pressure.
    """
    variance = (grams / KILO) ** 2
    bank_h, h = s.gas[bank, ENTHALPY], s.gas[VEHICLE, ENTHALPY]
    rise = s.gas[VEHICLE, P_MASS] + h * s.gas[VEHICLE, P_ENERGY]
    places = (bank, BANK_ENERGY + bank, VEHICLE_MASS, VEHICLE_ENERGY, RAMP_AIM)
    moved = (-1.0, -bank_h, 1.0, h, rise)
    for i in range(len(places)):
        for j in range(len(places)):
            s.cov[places[i], places[j]] += variance * moved[i] * moved[j]
    s.cov[VEHICLE_ENERGY, VEHICLE_ENERGY] += (_UNSEEN_WARMTH / s.gas[VEHICLE, T_ENERGY]) ** 2


@uncounted
def _forget_biases(s: Scratch, bank: int, tuning: Tuning) -> None:
    """What the sensors of a bank are off a second on."""
    forget(s.health, s.cov, LEAKS + bank, tuning.pressure_bias, s.drifts, bank)
    forget(s.health, s.cov, N + bank, tuning.temperature_bias, s.drifts, BANKS + bank)


@uncounted
def widen(s: Scratch, size: int, connected: bool, tuning: Tuning) -> None:
    """Add to the covariance, for a second, what the model does not say and what nobody told of valves."""
    lost, grams, kelvin = 0.0, tuning.mass, tuning.temperature
    if size == PLANT_STATES:
        grams, kelvin = _EXACT[0] * grams, _EXACT[1] * kelvin
    for bank in range(BANKS):
        into, out = s.unseen[bank] * max(s.flow[0], s.share[0]), s.unseen[3 + bank] * s.flow[1]
        if connected and s.unseen[3 + bank] > 0.0 and s.blind[bank] <= 1.0:
            _pass_unseen(s, bank, out if s.valve[3 + bank] != 0.0 else max(_UNSEEN_GAS, out))
            out = 0.0
        lost += out * out
        if s.blind[bank] > 1.0:  # the same flow second after second, perhaps, and to whom nobody knows
            out = max(out, _UNSEEN_GAS)
        spread = np.sqrt(grams**2 + (into * into + out * out) * max(2.0 * s.blind[bank] - 1.0, 1.0))
        blur(s, bank, BANK_ENERGY + bank, bank, spread, kelvin)
        blur(s, bank, BANK_ENERGY + bank, bank, lost_mass(s.drifts, bank), warmed(s.drifts, bank))
        s.cov[BANK_WALL + bank, BANK_WALL + bank] += kelvin**2
    s.cov[AIR, AIR] += max(tuning.ambient, _AIR) ** 2
    if connected:
        spread = np.sqrt(grams**2 + lost)
        blur(s, VEHICLE_MASS, VEHICLE_ENERGY, VEHICLE, spread, kelvin)
        s.cov[LINER, LINER] += kelvin**2
        s.cov[SHELL, SHELL] += kelvin**2
        s.cov[RAMP_AIM, RAMP_AIM] += (_AIM * grams) ** 2
    if size == PLANT_STATES:
        return
    for bank in range(BANKS):
        if size == BIASED:
            _forget_biases(s, bank, tuning)
        else:
            s.cov[LEAKS + bank, LEAKS + bank] += tuning.leak**2
    s.cov[COMPRESSOR, COMPRESSOR] += tuning.factor**2 if s.flow[0] > 0.0 else 0.0
    if s.flow[1] > 0.0:
        s.cov[DISPENSER, DISPENSER] += tuning.factor**2
        s.cov[WARMER, WARMER] += (_WARMER * tuning.temperature) ** 2


@uncounted
def take_back(s: Scratch, command: int, left: float, spread: float, plant: RealGasConstants) -> float:
    """Let the banks that gave in a second have given so much less [g], give or take `spread`.

    Returns the enthalpy of it [J/kg], 0 where no outlet is open.
    """
    outlets = command >> BANKS & ALL_BANKS
    count = (outlets & 1) + (outlets >> 1 & 1) + (outlets >> 2 & 1)
    enthalpy = 0.0
    for bank in range(BANKS):
        if outlets >> bank & 1:
            at = INSIDE + bank * plant.station.stride
            s.state[at + MASS] += left / count / KILO
            s.state[at + ENERGY] += left / count / KILO * s.gas[bank, ENTHALPY]
            blur(s, bank, BANK_ENERGY + bank, bank, spread, 0.0)
            enthalpy += s.gas[bank, ENTHALPY] / count
    return enthalpy


@uncounted
def leave_behind(
    s: Scratch, command: int, meter: float, noise: float, relative: float, plant: RealGasConstants
) -> None:
    """Of a fill's last second, which ends before the second does, the banks gave what the meter read.

    Where it read nothing they gave half of what they could, give or take as much.
    """
    given = s.flow[1]
    if command >> BANKS & ALL_BANKS == 0 or given <= 0.0:
        return
    left, spread = 0.5 * given, 0.5 * given
    if not np.isnan(meter):
        left, spread = given - min(max(meter, 0.0), 1.1 * given), relative * meter + noise
    take_back(s, command, left, spread, plant)
    blur(s, VEHICLE_MASS, VEHICLE_ENERGY, VEHICLE, given, 0.0)
