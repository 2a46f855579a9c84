"""Readings of a second, one after another, in the filter of the faithful plant (Bierman 1977)."""

from __future__ import annotations

import numpy as np

from station.compiled import inlined, uncounted
from station.estimation.drifting import is_drifting, judge_drifts
from station.estimation.interface import AMBIENT, KC, KD, LEAK, MV, SHARED_STATES, TV
from station.estimation.jumps import TAKEN, nearer_gate, note_jump, unless_jump
from station.estimation.put_right import is_as_read, judged_reading
from station.estimation.real_gas.slopes import ENTHALPY, P_ENERGY, P_MASS, T_ENERGY, T_MASS, P, T, look_at
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
from station.estimation.sudden import NOTHING, STANDS, is_doubted
from station.estimation.thermometers import note_warming
from station.geometry import KELVIN, VEHICLE
from station.plants.real_gas.entries import INSIDE, KILO, RealGasConstants, connected_tank
from station.plants.real_gas.hydrogen import BAR
from station.plants.real_gas.layout import BANKS, bank_at
from station.plants.real_gas.tank import ENERGY, MASS
from station.sensor_names import ANALOG

_SHARED = len(SHARED_STATES)
_FLOW_C = ANALOG.index("flow_compressor")
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
    expected = s.gas[tank, T] - KELVIN - s.behind[tank] if thermal else s.gas[tank, P] / BAR
    channel = tank + 4 if thermal else tank
    known = size > PLANT_STATES and tank < BANKS and not is_drifting(s.drifts, tank, thermal)
    taken = s.jumps[channel, TAKEN] if known else 0.0
    error = y - taken - expected - by_mass * s.delta[mass] - by_energy * s.delta[energy]
    for i in range(size):
        s.column[i] = by_mass * s.cov[i, mass] + by_energy * s.cov[i, energy]
    spread = noise * noise + by_mass * s.column[mass] + by_energy * s.column[energy]
    if size == BIASED and tank < BANKS:
        bias = (N if thermal else LEAKS) + tank
        error -= s.health[bias] + s.delta[bias]
        spread += 2.0 * s.column[bias] + s.cov[bias, bias]
        for i in range(size):
            s.column[i] += s.cov[i, bias]
    nearer = nearer_gate(s.jumps, channel, noise, gate) if known else gate
    normal = take_reading(s.delta, s.cov, s.column, size, error, spread, nearer, False)
    if known:
        as_read = note_jump(s.jumps, channel, normal, error, noise, nearer, gate)
        normal = unless_jump(s.jumps, channel, normal) if size == BIASED else as_read
    return normal, error + taken


@uncounted
def read_tanks(
    s: Scratch, size: int, values: np.ndarray, noise: np.ndarray, connected: bool, fresh: bool, gate: float,
    memory: np.ndarray, innovations: np.ndarray, errors: np.ndarray, plant: RealGasConstants,
) -> None:  # fmt: skip
    """Look at the tanks, and read their pressures and temperatures; what has just begun was read."""
    s.delta[:] = 0.0
    tanks = VEHICLE + 1 if connected else VEHICLE
    for tank in range(tanks):
        volume = s.volume[0] if tank == VEHICLE else bank_at(tank, plant.station).volume
        look_at(s, tank, volume, plant.station, plant.gas)
        if (tank == VEHICLE and fresh) or (tank < BANKS and s.anew[tank] != 0.0):
            continue
        if s.before[tank] > 0.0:  # else it is the first second
            note_warming(s.behind, tank, s.gas[tank, T] - s.before[tank], memory)
        for channel in range(tank, 8, 4):
            if not np.isnan(values[channel]):
                innovations[channel], errors[channel] = _read_gas(
                    s, size, tank, values[channel], noise[channel], channel >= 4, gate
                )  # fmt: skip
    apply(s, size, plant)
    for tank in range(tanks):
        volume = s.volume[0] if tank == VEHICLE else bank_at(tank, plant.station).volume
        look_at(s, tank, volume, plant.station, plant.gas)
        s.before[tank] = s.gas[tank, T]


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
            if coordinate == COMPRESSOR:
                s.health[coordinate] = max(s.health[coordinate], NOTHING)
        elif coordinate < VEHICLE_MASS or connected:
            move(inside, coordinate, s.delta[coordinate], vehicle, plant.station)
    for bank in range(BANKS):
        _bound(s, bank, bank_at(bank, plant.station).volume, plant)
    if connected:
        _bound(s, VEHICLE, s.volume[0], plant)


@inlined
def _is_unseen(s: Scratch, first: int) -> bool:
    """Whether it is not known which of three valves are open."""
    return s.unseen[first] + s.unseen[first + 1] + s.unseen[first + 2] > 0.0


@inlined
def _off(s: Scratch, size: int, meter: int, y: float) -> float:
    """A reading of a flow meter less its prediction [g/s]."""
    error = y - s.flow[meter]
    for j in range(size):
        error -= s.flow_slopes[meter, j] * s.delta[j]
    return error


@uncounted
def judged_meter(s: Scratch, size: int, meter: int, row: int, raw: np.ndarray, read: float) -> float:
    """The reading of a flow meter [g/s], unless it may just have been put right."""
    if is_as_read(row, meter, raw, read) or _is_unseen(s, 3 * meter) or s.flow[meter] <= 0.0:
        return read
    channel, expected = _FLOW_C + meter, read - _off(s, size, meter, read)
    variance = s.noise[channel] ** 2 + (s.relative[channel] * expected) ** 2
    for i in range(size):
        for j in range(size):
            variance += s.flow_slopes[meter, i] * s.cov[i, j] * s.flow_slopes[meter, j]
    return judged_reading(s.put, meter, raw[row, meter], read, expected, np.sqrt(variance))


@uncounted
def read_flow(
    s: Scratch, size: int, meter: int, y: float, noise: float, relative: float, gate: float
) -> tuple[float, float]:
    """A flow meter [g/s], of the compressors (0) or the vehicle (1): innovation and error; NaN where nothing flows."""
    expected = s.flow[meter]
    if np.isnan(y) or _is_unseen(s, 3 * meter) or expected <= 0.0:
        return np.nan, np.nan
    error = _off(s, size, meter, y)
    spread = noise * noise + (relative * expected) ** 2
    for i in range(size):
        total = 0.0
        for j in range(size):
            if s.flow_slopes[meter, j] != 0.0:
                total += s.cov[i, j] * s.flow_slopes[meter, j]
        s.column[i] = total
    for i in range(size):
        spread += s.flow_slopes[meter, i] * s.column[i]
    return take_reading(s.delta, s.cov, s.column, size, error, spread, gate, size > PLANT_STATES), error


@uncounted
def read_compressor(
    s: Scratch, size: int, y: float, noise: float, relative: float, gate: float, told: bool
) -> tuple[float, float]:  # fmt: skip
    """The compressors' meter [g/s], which is used unless it reads all at once something else than the pressures say.

    `told`: whether all inlets were told; else it may be the meter that said which are open.
    """
    healthy = s.flow_slopes[0, COMPRESSOR] if size > PLANT_STATES else 0.0
    if not told and s.doubt[0] > 0.0:
        return np.nan, np.nan
    if np.isnan(y) or not told or healthy <= 0.0:
        return read_flow(s, size, 0, y, noise, relative, gate)
    spread, k = np.sqrt(noise**2 + (relative * s.flow[0]) ** 2), COMPRESSOR
    doubted, factor = is_doubted(s.doubt, s.health[k] + s.delta[k], s.cov, k, size, y, healthy, gate * spread)
    s.delta[k] = factor - s.health[k]
    if doubted:
        off = _off(s, size, 0, y)
        return off / np.sqrt(spread**2 + healthy**2 * s.cov[k, k]), off
    used = read_flow(s, size, 0, y, noise, relative, gate)
    return (np.nan, np.nan) if y == 0.0 and s.health[k] + s.delta[k] < STANDS else used


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


@uncounted
def keep_biases(s: Scratch, innovations: np.ndarray, gate: float, states: np.ndarray, deviations: np.ndarray) -> None:
    """Write what the sensors of the banks are off, in the order of BANK_SENSORS."""
    for k in range(2 * BANKS):
        place = LEAKS + k if k < BANKS else N + k - BANKS
        states[k], deviations[k] = s.health[place], np.sqrt(max(s.cov[place, place], 0.0))
    machines = (s.health[COMPRESSOR], s.health[DISPENSER])
    judge_drifts(s.drifts, states, innovations, gate, machines, (_grams(s, 0), _grams(s, 1), _grams(s, 2)))


@uncounted
def _grams(s: Scratch, bank: int) -> float:
    """Of the gas that leaves a bank while its pressure falls by a bar [g/bar]."""
    return KILO * BAR / (s.gas[bank, P_MASS] + s.gas[bank, ENTHALPY] * s.gas[bank, P_ENERGY])
