"""A buffer after its stage until the next vehicle connects, s after the last or at any later time."""

from __future__ import annotations

import numpy as np

from controllers.reserve.enclosures import COLDEST, FULL, PROVED, EnclosureTables, ProofProblem
from controllers.reserve.tank import MAYBE, OUTWARD, YES, Law, Tank, law_of, settled_of, start_tank, step_tank
from station.compiled import kernel
from station.geometry import HIGH, KELVIN, LOW, MEDIUM
from station.plants.thesis import SPECIFIC_GAS, PlantConstants, inlet_flow

SETTLE = 300
"""Seconds after s that are followed one by one before a bound for all that come takes over."""

KELVINS = 160
"""Floors of pressure: one a kelvin, from COLDEST on."""


@kernel
def _asked(buffer: int, second: int, opened: float, left_from: int, tables: EnclosureTables, slot: int) -> int:
    """YES in seconds in which it is the buffer's turn whatever the fill was, MAYBE in others.

    `opened`: the second from which high has been opened for certain, so that medium has its turns; `left_from`: the
    first in which nobody may be connected.
    """
    turn = second // slot
    if buffer == LOW:
        waits = min(tables.waits[0, 0], tables.waits[1, 0]) <= second < max(tables.waits[0, 1], tables.waits[1, 1])
        own = (turn % 6 == 1 or turn % 6 == 5) or (turn % 2 == 1 and second < left_from)
        return YES if own and not waits else MAYBE
    if buffer == HIGH:
        return YES if turn % 3 == 0 else MAYBE
    own = turn % 6 == 2 or turn % 6 == 4 or (turn % 2 == 0 and second < left_from)
    return YES if own and second >= opened else MAYBE


@kernel
def _turns(buffer: int, tables: EnclosureTables, slot: int) -> tuple[float, float]:
    """How long a buffer's turn lasts, and how long it may then go without one [s]."""
    away = 3.0 * slot
    for row in range(2 if buffer == LOW else 0):
        away += max(tables.waits[row, 1] - tables.waits[row, 0], 0.0)
    return float(slot), away


@kernel
def kelvin_of(temperature: float) -> int:
    """The place of a temperature [deg C] among the floors."""
    return min(max(int(np.floor(temperature - COLDEST)), 0), KELVINS - 1)


@kernel
def _note(tank: Tank, warm: float, floors: np.ndarray, law: Law) -> None:
    """Lower `floors` (KELVINS,) to the least pressure the buffer can have at each temperature between its bounds.

    One that has never been full holds phi grams more for each kelvin it is warmer.
    """
    full = law.stop - law.slack
    for place in range(kelvin_of(tank.cold), kelvin_of(warm) + 1):
        least = COLDEST + place
        low = full
        if least + 1.0 >= tank.lean:
            at = max(least, tank.lean)
            low = min(full, (tank.heat + tank.phi * at) * law.density * (at + KELVIN) * (1.0 - OUTWARD))
        floors[place] = min(floors[place], max(tank.low, low))


@kernel
def _for_ever(tank: Tank, law: Law, falls_to: float, plant: PlantConstants) -> Tank:
    """Bounds that hold from now on while the turns go on: m - phi T does not fall any more, whatever is filled."""
    heating = plant.inlet_heating[law.buffer]
    phi = tank.phi
    if heating > 0.0:
        phi = min(phi, max(inlet_flow(law.stop, plant), 0.0) / heating * (1.0 - 1e-9))
    heat = (tank.heat + (tank.phi - phi) * tank.lean) * (1.0 - 1e-9)
    lean = min(tank.lean, falls_to)
    if lean < plant.ambient_temperature:
        heat, lean = -np.inf, min(tank.cold, plant.ambient_temperature)
    cold = min(tank.cold, plant.ambient_temperature)
    return Tank(0.0, tank.high, cold, tank.warm, lean, cold, phi, heat, tank.psi, tank.load)


@kernel
def highest_of(buffer: int, warm: float, stop: float, plant: PlantConstants) -> float:
    """The highest pressure that filling takes a buffer to [bar]: it is filled below `stop`, then a second more."""
    hottest = max(warm, settled_of(buffer, plant)) + KELVIN
    grams = plant.inlet_coefficient * max(plant.compressor_pressure - stop, 0.0)
    rise = grams * SPECIFIC_GAS / plant.buffer_volume[buffer] * hottest
    return stop + rise + stop * plant.inlet_heating[buffer] / (plant.ambient_temperature + KELVIN - 50.0)


@kernel
def recover(
    buffer: int,
    row: np.ndarray,
    since: int,
    opened: float,
    left_from: int,
    tables: EnclosureTables,
    task: ProofProblem,
    plant: PlantConstants,
    floors: np.ndarray,
    top: float,
) -> float:
    """Enclosure of a buffer from s on, for ever, after a stage's end: `floors` (KELVINS,) lowered; greatest pressure.

    That is the pressure once the buffer is no colder than the surroundings. It grows only by filling, which begins
    below `stop`; `top` bounds it when the vehicle connects.
    """
    law = law_of(buffer, task.stop[buffer], row[3], _turns(buffer, tables, task.slot), plant)
    turns = float(task.slot), 3.0 * task.slot
    falls_to = law_of(buffer, task.stop[buffer], row[3], turns, plant).falls_to  # while nobody waits
    tank = start_tank(row[0], row[1], row[2], row[3], law, plant)
    filled = highest_of(buffer, row[3], task.stop[buffer], plant)
    most, ambient, ever = 0.0, plant.ambient_temperature, min(plant.ambient_temperature, tank.cold)
    for second in range(since, task.spacing + SETTLE):
        ever = min(ever, tank.cold)
        if second >= task.spacing:
            _note(tank, tank.warm, floors, law)
            most = max(most, tank.high / (min(tank.cold, ambient) + KELVIN))
        tank = step_tank(tank, _asked(buffer, second, opened, left_from, tables, task.slot), law, plant)
    _note(_for_ever(tank, law, falls_to, plant), max(tank.warm, settled_of(buffer, plant)), floors, law)
    most = max(most, filled / (min(tank.cold, ambient) + KELVIN))
    return min(most * (ambient + KELVIN), max(top, filled * (ambient + KELVIN) / (ever + KELVIN)))


@kernel
def _left_from(tables: EnclosureTables) -> int:
    """The first second in which a vehicle can have left."""
    for second in range(len(tables.left)):
        if tables.left[second].max() > 0.0:
            return second
    return len(tables.left)


@kernel
def _lead_back(
    buffer: int,
    ends: np.ndarray,
    left_from: int,
    top: float,
    tables: EnclosureTables,
    task: ProofProblem,
    plant: PlantConstants,
    floors: np.ndarray,
) -> float:
    """`recover` for every end in a table; `left_from`: 0 where the vehicle had left."""
    most = 0.0
    for second in range(task.within + 1):
        for row in ends[second]:
            if row[0] <= row[1]:
                waits = buffer == MEDIUM and left_from > 0
                opened = max(tables.opened[second, 1], float(second)) if waits else 0.0
                found = recover(buffer, row, second, opened, left_from, tables, task, plant, floors, top)
                most = max(most, found)
    return most


@kernel
def fullest(ends: np.ndarray, until: float, plant: PlantConstants) -> float:
    """The highest pressure of a buffer that is closed from any of the `ends` of a table to second `until` [bar].

    It keeps its mass, so that its pressure follows its absolute temperature, which goes towards the surroundings'.
    """
    most, ambient = 0.0, plant.ambient_temperature
    for second in range(len(ends)):
        left = (1.0 - plant.heat_exchange) ** max(until - second, 0.0)
        for row in ends[second]:
            if row[0] <= row[1]:
                warmth = max(row[2], ambient + (row[2] - ambient) * left)
                most = max(most, row[1] * (warmth + KELVIN) / (row[2] + KELVIN) * (1.0 + 1e-9))
    return most


@kernel
def prove_recovery(
    states_top: np.ndarray,
    tables: EnclosureTables,
    task: ProofProblem,
    plant: PlantConstants,
    floors: np.ndarray,
    tops: np.ndarray,
) -> int:
    """Every end of every stage followed until the next vehicle connects; `states_top` (3,): of those that connect.

    `floors` (3, KELVINS) is lowered and `tops` (3,) raised to what the buffers can then be; the outcome is returned.
    """
    turns = max(tables.waits[0, 1], 0.0) + 2.0 * task.slot  # medium has had one: nobody waits for high any more
    if fullest(tables.medium_ends, turns, plant) >= task.stop[MEDIUM]:
        return FULL
    since = _left_from(tables)
    tops[LOW] = _lead_back(LOW, tables.low_ends, since, states_top[LOW], tables, task, plant, floors[LOW])
    handed = _lead_back(MEDIUM, tables.medium_ends, since, states_top[MEDIUM], tables, task, plant, floors[MEDIUM])
    idle = _lead_back(MEDIUM, tables.medium_idle, 0, states_top[MEDIUM], tables, task, plant, floors[MEDIUM])
    tops[MEDIUM] = max(handed, idle)
    tops[HIGH] = _lead_back(HIGH, tables.high_idle, 0, states_top[HIGH], tables, task, plant, floors[HIGH])
    return PROVED
