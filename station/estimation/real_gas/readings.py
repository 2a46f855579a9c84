"""Readings of a second, one after another, in the filter of the faithful plant (Bierman 1977)."""

from __future__ import annotations

import numpy as np

from station.compiled import uncounted
from station.estimation.interface import AMBIENT, KC, KD, LEAK, MV, SHARED_STATES, TV
from station.estimation.real_gas.slopes import P_ENERGY, P_MASS, T_ENERGY, T_MASS, P, T, look_at
from station.estimation.real_gas.states import (
    AIR,
    BANK_ENERGY,
    BANK_WALL,
    COMPRESSOR,
    DISPENSER,
    LEAKS,
    LINER,
    VEHICLE_ENERGY,
    VEHICLE_MASS,
    WARMER,
    N,
    Scratch,
    coordinate_of,
    move,
    tank_place,
)
from station.estimation.scalar_update import take_reading
from station.geometry import KELVIN, VALVES, VEHICLE
from station.plants.real_gas.entries import INSIDE, KILO, RealGasConstants, connected_tank
from station.plants.real_gas.hydrogen import BAR
from station.plants.real_gas.layout import BANKS, bank_at
from station.plants.real_gas.tank import ENERGY, MASS
from station.sensor_names import ANALOG

_VALVES = len(ANALOG)
_SHARED = len(SHARED_STATES)
_FLOWS = 6.0  # a meter that reads more than so many standard deviations of its absolute noise says that gas flows
_THIN, _DENSE = 0.02, 0.98  # densities that a reading may lead to [kg/m3], part of the tables' largest


@uncounted
def _read_gas(
    s: Scratch, size: int, tank: int, y: float, noise: float, thermal: bool, gate: float
) -> tuple[float, float]:
    """A pressure [bar] or temperature [deg C] of a tank: its innovation and error."""
    mass, energy = (VEHICLE_MASS, VEHICLE_ENERGY) if tank == VEHICLE else (tank, BANK_ENERGY + tank)
    scale = 1.0 if thermal else 1.0 / BAR
    by_mass = scale * s.gas[tank, T_MASS if thermal else P_MASS]
    by_energy = scale * s.gas[tank, T_ENERGY if thermal else P_ENERGY]
    expected = s.gas[tank, T] - KELVIN if thermal else s.gas[tank, P] / BAR
    error = y - expected - by_mass * s.delta[mass] - by_energy * s.delta[energy]
    for i in range(size):
        s.column[i] = by_mass * s.cov[i, mass] + by_energy * s.cov[i, energy]
    spread = noise * noise + by_mass * s.column[mass] + by_energy * s.column[energy]
    return take_reading(s.delta, s.cov, s.column, size, error, spread, gate, False), error


@uncounted
def read_tanks(
    s: Scratch, size: int, values: np.ndarray, noise: np.ndarray, connected: bool, fresh: bool, gate: float,
    innovations: np.ndarray, errors: np.ndarray, plant: RealGasConstants,
) -> None:  # fmt: skip
    """Look at the tanks, and read their pressures and temperatures; what has just begun was read."""
    s.delta[:] = 0.0
    tanks = VEHICLE + 1 if connected else VEHICLE
    for tank in range(tanks):
        volume = s.volume[0] if tank == VEHICLE else bank_at(tank, plant.station).volume
        look_at(s, tank, volume, plant.station, plant.gas)
        if (tank == VEHICLE and fresh) or (tank < BANKS and s.anew[tank] != 0.0):
            continue
        for channel in range(tank, 8, 4):
            if not np.isnan(values[channel]):
                innovations[channel], errors[channel] = _read_gas(
                    s, size, tank, values[channel], noise[channel], channel >= 4, gate
                )  # fmt: skip
    apply(s, size, plant)
    for tank in range(tanks):
        volume = s.volume[0] if tank == VEHICLE else bank_at(tank, plant.station).volume
        look_at(s, tank, volume, plant.station, plant.gas)


@uncounted
def _bound(s: Scratch, tank: int, volume: float, plant: RealGasConstants) -> None:
    """Keep a tank where the tables hold, whatever was read."""
    at, gas = INSIDE + tank_place(tank, plant.station), plant.gas
    u = s.state[at + ENERGY] / s.state[at + MASS]
    mass = min(max(s.state[at + MASS], _THIN * volume), _DENSE * gas.density_max * volume)
    last = gas.energy_first + (gas.by_energy.shape[1] - 3) / gas.energy_scale
    if mass != s.state[at + MASS] or not (gas.energy_first < u < last):
        s.state[at + MASS], s.state[at + ENERGY] = mass, mass * min(max(u, gas.energy_first), last)


@uncounted
def apply(s: Scratch, size: int, plant: RealGasConstants) -> None:
    """Move the mean by what readings have changed; it stays where the tables hold."""
    inside, vehicle = s.state[INSIDE:], connected_tank(s.state)
    connected = s.vehicle[0] >= 0.0
    for coordinate in range(size):
        if s.delta[coordinate] == 0.0:
            continue
        if coordinate >= AIR:
            s.health[coordinate] += s.delta[coordinate]
        elif coordinate < VEHICLE_MASS or connected:
            move(inside, coordinate, s.delta[coordinate], vehicle, plant.station)
    for bank in range(BANKS):
        _bound(s, bank, bank_at(bank, plant.station).volume, plant)
    if connected:
        _bound(s, VEHICLE, s.volume[0], plant)


@uncounted
def _meter_says(s: Scratch, values: np.ndarray, first: int, meter: float, noise: float, count: int) -> None:
    """Where nobody told some of three valves, what the others and the flow meter say of them, if they say so clearly.

    No more than `count` are open at once. A flow that no other valve lets through goes through the one that nobody
    told, whatever it was before: a valve may be open for a single second. Where the meter of outlets is silent too, what
    they gave is not seen.
    """
    told_open, supposed, untold, unseen, which, silent = 0, 0, 0, 0, 0, np.isnan(meter) and first > 0
    for v in range(first, first + 3):
        if not np.isnan(values[_VALVES + v]):
            told_open += 1 if s.valve[v] != 0.0 else 0
            continue
        untold += 1
        if s.unseen[v] != 0.0:
            unseen, which = unseen + 1, v
        elif s.valve[v] != 0.0:
            supposed += 1
        elif unseen == 0:
            which = v
    if untold == 0:
        return
    if told_open >= count > 0 or meter == 0.0:
        for v in range(first, first + 3):
            if np.isnan(values[_VALVES + v]):
                s.valve[v], s.unseen[v] = 0.0, 0.0
    elif told_open + supposed > 0 or (np.isnan(meter) and not silent):
        return
    elif not silent and (unseen == 1 or (untold == 1 and meter > _FLOWS * noise)):
        s.valve[which], s.unseen[which] = 1.0, 0.0
    elif silent or (unseen == 0 and meter > _FLOWS * noise):
        for v in range(first, first + 3):
            s.unseen[v] = 1.0 if np.isnan(values[_VALVES + v]) else s.unseen[v]


@uncounted
def read_valves(
    s: Scratch, values: np.ndarray, noise: np.ndarray, coming: np.ndarray, connected: bool, compressors: int
) -> int:
    """The command of a second: as told, as the meters say, or as before where the next second says the same."""
    for v in range(len(VALVES)):
        told = values[_VALVES + v]
        then = coming[_VALVES + v]
        if not np.isnan(told):
            s.valve[v], s.unseen[v] = (1.0 if told >= 0.5 else 0.0), 0.0
        else:
            same = not np.isnan(then) and (then >= 0.5) == (s.valve[v] != 0.0)
            s.unseen[v] = 0.0 if same else 1.0
    compressed, dispensed = _VALVES - 2, _VALVES - 1
    _meter_says(s, values, 0, values[compressed], noise[compressed], compressors)
    _meter_says(s, values, 3, values[dispensed] if connected else 0.0, noise[dispensed], 1)
    command = 0
    for v in range(len(VALVES)):
        command |= (1 if s.valve[v] != 0.0 else 0) << v
    return command


@uncounted
def read_flow(
    s: Scratch, size: int, meter: int, y: float, noise: float, relative: float, gate: float
) -> tuple[float, float]:
    """A flow meter [g/s], of the compressors (0) or the vehicle (1): innovation and error; NaN where nothing flows."""
    first = 3 * meter
    unknown = s.unseen[first] + s.unseen[first + 1] + s.unseen[first + 2]
    expected = s.flow[meter]
    if np.isnan(y) or unknown > 0.0 or expected <= 0.0:
        return np.nan, np.nan
    error = y - expected
    for j in range(size):
        error -= s.flow_slopes[meter, j] * s.delta[j]
    spread = noise * noise + (relative * expected) ** 2
    for i in range(size):
        total = 0.0
        for j in range(size):
            if s.flow_slopes[meter, j] != 0.0:
                total += s.cov[i, j] * s.flow_slopes[meter, j]
        s.column[i] = total
    for i in range(size):
        spread += s.flow_slopes[meter, i] * s.column[i]
    return take_reading(s.delta, s.cov, s.column, size, error, spread, gate, size == N), error


@uncounted
def _keep_tank(
    s: Scratch, tank: int, there: bool, mass_place: int, kelvin_place: int, wall_place: int, states: np.ndarray,
    deviations: np.ndarray, plant: RealGasConstants,
) -> None:  # fmt: skip
    """Mass [g] and temperatures [deg C] of a tank, NaN of a vehicle that is not there."""
    for place in (mass_place, kelvin_place, wall_place):
        states[place], deviations[place] = np.nan, np.nan
    if not there:
        return
    m, e, w = (VEHICLE_MASS, VEHICLE_ENERGY, LINER) if tank == VEHICLE else (tank, BANK_ENERGY + tank, BANK_WALL + tank)
    volume = s.volume[0] if tank == VEHICLE else bank_at(tank, plant.station).volume
    look_at(s, tank, volume, plant.station, plant.gas)
    a, b = s.gas[tank, T_MASS], s.gas[tank, T_ENERGY]
    warm = a * a * s.cov[m, m] + 2.0 * a * b * s.cov[m, e] + b * b * s.cov[e, e]
    inside = s.state[INSIDE:]
    states[mass_place] = KILO * inside[tank_place(tank, plant.station) + MASS]
    states[kelvin_place] = s.gas[tank, T] - KELVIN
    states[wall_place] = coordinate_of(inside, w, connected_tank(s.state), plant.station) - KELVIN
    deviations[mass_place] = KILO * np.sqrt(max(s.cov[m, m], 0.0))
    deviations[kelvin_place] = np.sqrt(max(warm, 0.0))
    deviations[wall_place] = np.sqrt(max(s.cov[w, w], 0.0))


@uncounted
def keep(s: Scratch, connected: bool, states: np.ndarray, deviations: np.ndarray, plant: RealGasConstants) -> None:
    """Write the estimates of a second, in the order of STATES."""
    for bank in range(BANKS):
        _keep_tank(s, bank, True, bank, BANKS + bank, _SHARED + 1 + bank, states, deviations, plant)
        states[LEAK + bank] = s.health[LEAKS + bank]
        deviations[LEAK + bank] = np.sqrt(max(s.cov[LEAKS + bank, LEAKS + bank], 0.0))
    _keep_tank(s, VEHICLE, connected, MV, TV, _SHARED + 1 + VEHICLE, states, deviations, plant)
    for place, coordinate in ((KC, COMPRESSOR), (KD, DISPENSER), (AMBIENT, AIR), (_SHARED, WARMER)):
        states[place] = s.health[coordinate]
        deviations[place] = np.sqrt(max(s.cov[coordinate, coordinate], 0.0))
