"""Parts of a block: what each valve does to its tank and to the vehicle, computed once for all states that share them.

States of a beam differ in what their commands have done, and most share a tank with others. So a state says which of
its level's tanks and vehicles are its own, and a part stands once for each tank, or each tank and vehicle.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from controllers.switched.model import Demand, Prices, Tank, Vehicle, fill, rest, serve, vehicle_tank
from controllers.switched.value import (
    FILL_WEIGHT,
    TerminalCost,
    fill_end_pressure,
    fill_end_time,
    remaining_fill_cost,
    restore,
    terminal_cost,
)
from station.compiled import inlined, kernel, uncounted
from station.geometry import Valve
from station.limits import start_limit
from station.planning import Model, gas_pressure
from station.starts import FILLED_SHARE
from station.valves import inlet_limit, outlet_limit

INLET_LOW = int(Valve.INLET_LOW)

# Entries of a state: the plan's cost so far, the command in force, the first command; tanks; the vehicle; cost with
# the worth of its end, and where it came from: 64 times the place in the beam before, and the command; which of the
# level's tanks and vehicles are its own.
COST, COMMAND, FIRST = 0, 1, 2
MASS, TEMPERATURE, MISSING = 3, 6, 9  # high, medium, low: [g], [deg C], seconds to restore
VEHICLE_MASS, VEHICLE_TEMPERATURE, CONNECTED, STARTED = 12, 13, 14, 15
SCORE, CAME = 16, 17
OWN_TANK, OWN_VEHICLE = 18, 21
SIZE = 22

# Parts of a block: three rests, three fills, and four services: none, high, medium, low.
REST, FILL, SERVE = 0, 3, 6
PARTS = 10

# Entries of a part: whether the limits admit it; what it adds to the score, its cost; tank, seconds to restore and to
# lift it; vehicle; whether it ends open; the price of a second of delay; which tank and which vehicle of the next level
# come from it, -1 before one does.
_ADMITTED, PART_SCORE, PART_COST, PART_MASS, PART_TEMPERATURE, PART_MISSING, PART_FILL_END = 0, 1, 2, 3, 4, 5, 6
PART_VEHICLE, PART_OPEN, PART_DELAY, PART_NEXT_TANK, PART_NEXT_VEHICLE = 7, 11, 12, 13, 14
_ENTRIES = 15


class Task(NamedTuple):
    """Conditions for which a plan is made."""

    model: Model
    demand: Demand
    prices: Prices
    waiting: int  # vehicles
    coming: np.ndarray  # due times of expected vehicles, from now [s]
    blocks: np.ndarray  # lengths [s]
    step: float  # [s]
    terminal: tuple[TerminalCost, TerminalCost, TerminalCost]  # by what the gas of high, medium, and low is valued
    table: np.ndarray  # cost of filling
    full: float  # mass of a full vehicle [g]
    commands: np.ndarray  # admissible by Eqs (7.17)-(7.19)


class Block(NamedTuple):
    """One block of a plan."""

    time: float  # of its begin, after the plan's [s]
    seconds: float
    waiting_first: int  # vehicles there at its begin, without the one connected when the plan began
    waiting_last: int  # at its end
    held: int  # valves that may stay open whatever a longer step of the model says


class Parts(NamedTuple):
    """The parts of a block computed so far, and where they stand: -1 where not yet."""

    row: np.ndarray  # (10 width, _ENTRIES)
    tank: np.ndarray  # (3, width) the row of a tank that rests; that of its filling follows
    served: np.ndarray  # (4, width, width) of a vehicle given nothing, or from a tank of high, medium, low
    of: np.ndarray  # (width, PARTS) the rows of each state's parts


@kernel
def new_parts(width: int) -> Parts:
    """Room for the parts of a beam's block."""
    return Parts(
        np.empty((PARTS * width, _ENTRIES)),
        np.empty((3, width), np.int16),
        np.empty((4, width, width), np.int16),
        np.empty((width, PARTS), np.int64),
    )


@inlined
def longest_step(seconds: float, step: float) -> float:
    """Longest step of the model within a block of `seconds`: five steps in a long block."""
    return max(step, seconds / 7.0)


@inlined
def vehicle_of(state: np.ndarray) -> Vehicle:
    """The dispenser's side of a state."""
    return Vehicle(
        state[VEHICLE_MASS], state[VEHICLE_TEMPERATURE], state[CONNECTED] != 0.0, int(state[STARTED])
    )  # fmt: skip


@inlined
def fills_to_do(vehicle: Vehicle, arrived: int, task: Task) -> float:
    """Estimated cost of the rest of this fill and of those that wait for it."""
    demand = task.demand
    behind = arrived - vehicle.started
    total = 0.0
    if vehicle.connected:
        volume, finish = vehicle_tank(vehicle, demand)
        pressure = gas_pressure(vehicle.mass, vehicle.temperature, volume, task.model)
        total = remaining_fill_cost(pressure, volume, finish, behind, task.prices, task.model, task.table)
    while behind > 0:
        behind -= 1
        total += remaining_fill_cost(
            demand.next_pressure, demand.next_volume, demand.next_finish, behind, task.prices, task.model, task.table
        )
    return FILL_WEIGHT * total


@inlined
def price_of_delay(vehicle: Vehicle, arrived: int, task: Task) -> float:
    """Price of a second for which no buffer can end a fill [s of compressor]."""
    behind = arrived - vehicle.started
    if not vehicle.connected and behind == 0:
        return 0.0
    return task.prices.occupancy + (task.prices.waiting if behind > 0 else 0.0)


@inlined
def _worth(row: np.ndarray, buffer: int, task: Task) -> float:
    """What the buffer of a part is worth; the part keeps what that takes."""
    target = fill_end_pressure(task.demand, task.model)
    row[PART_FILL_END] = fill_end_time(row[PART_MASS], row[PART_TEMPERATURE], target, buffer, task.model)
    return terminal_cost(
        row[PART_MASS], row[PART_MISSING], task.terminal[buffer], target, task.waiting, task.prices.gas, buffer,
        task.model,
    )  # fmt: skip


@inlined
def _rest(state: np.ndarray, buffer: int, block: Block, task: Task, row: np.ndarray) -> None:
    """The part of a closed buffer."""
    step = longest_step(block.seconds, task.step)
    row[PART_COST] = 0.0
    row[PART_MASS], row[PART_MISSING] = state[MASS + buffer], state[MISSING + buffer]
    row[PART_TEMPERATURE] = rest(buffer, state[TEMPERATURE + buffer], block.seconds, step, task.model)
    row[PART_SCORE] = _worth(row, buffer, task)
    row[PART_OPEN], row[PART_NEXT_TANK] = 0.0, -1.0


@inlined
def _fill(state: np.ndarray, buffer: int, block: Block, task: Task, row: np.ndarray) -> None:
    """The part of a buffer with its inlet commanded open."""
    model = task.model
    tank = Tank(state[MASS + buffer], state[TEMPERATURE + buffer])
    was_open = int(state[COMMAND]) >> buffer & 1 != 0
    pressure = gas_pressure(tank.mass, tank.temperature, model.buffer_volume[buffer], model)
    free = inlet_limit(buffer, pressure, tank.temperature, was_open, True, model, task.step) == 0
    row[_ADMITTED] = 1.0 if free or block.held & (1 << buffer) else 0.0
    if row[_ADMITTED] == 0.0:
        return
    step = longest_step(block.seconds, task.step)
    filled, spent, still = fill(buffer, tank, was_open, block.seconds, step, model)
    row[PART_COST] = spent + (0.0 if was_open else task.prices.start)
    row[PART_MASS], row[PART_TEMPERATURE] = filled
    row[PART_MISSING] = restore(filled.mass, task.terminal[buffer], buffer, model)
    row[PART_SCORE] = row[PART_COST] + _worth(row, buffer, task)
    row[PART_OPEN], row[PART_NEXT_TANK] = (1.0 if still else 0.0), -1.0


@inlined
def _serve(state: np.ndarray, outlet: int, block: Block, task: Task, row: np.ndarray) -> None:
    """The part of the vehicle and the buffer it is given from, -1 for none."""
    model, demand = task.model, task.demand
    vehicle = vehicle_of(state)
    tank = Tank(0.0, 0.0)
    row[_ADMITTED] = 1.0
    if outlet >= 0:
        tank = Tank(state[MASS + outlet], state[TEMPERATURE + outlet])
        heat, pressure = demand.next_temperature, demand.next_pressure
        if vehicle.connected:
            heat = vehicle.temperature
            pressure = gas_pressure(vehicle.mass, heat, vehicle_tank(vehicle, demand)[0], model)
        stored = gas_pressure(tank.mass, tank.temperature, model.buffer_volume[outlet], model)
        there = vehicle.connected or block.waiting_first > vehicle.started
        free = outlet_limit(outlet, stored, tank.temperature, there, pressure, heat, model, task.step) == 0
        row[_ADMITTED] = 1.0 if free or block.held & (8 << outlet) else 0.0
        if row[_ADMITTED] == 0.0:
            return
    step = longest_step(block.seconds, task.step)
    tank, after, cost = serve(
        outlet, tank, vehicle, block.time, block.seconds, step, task.waiting, task.coming, demand, task.prices, model
    )
    row[PART_COST] = cost
    row[PART_SCORE] = cost + fills_to_do(after, block.waiting_last, task)
    if outlet >= 0:
        if int(state[COMMAND]) & (8 << outlet) == 0:
            row[PART_COST] += task.prices.start
            row[PART_SCORE] += task.prices.start
        row[PART_MASS], row[PART_TEMPERATURE] = tank
        row[PART_MISSING] = restore(tank.mass, task.terminal[outlet], outlet, model)
        row[PART_SCORE] += _worth(row, outlet, task)
    row[PART_DELAY] = price_of_delay(after, block.waiting_last, task)
    row[PART_VEHICLE], row[PART_VEHICLE + 1] = after.mass, after.temperature
    row[PART_VEHICLE + 2], row[PART_VEHICLE + 3] = (1.0 if after.connected else 0.0), after.started
    row[PART_NEXT_TANK] = row[PART_NEXT_VEHICLE] = -1.0


@inlined
def _distinct(kept: np.ndarray, entry: int) -> int:
    """Number of tanks, or vehicles, in the states `kept`, by this entry."""
    last = 0.0
    for place in range(kept.shape[0]):
        last = max(last, kept[place, entry])
    return int(last) + 1


@inlined
def _forget(kept: np.ndarray, parts: Parts) -> None:
    """No part of the states `kept` is computed yet."""
    vehicles = _distinct(kept, OWN_VEHICLE)
    parts.served[0, 0, :vehicles] = -1
    for buffer in range(3):
        tanks = _distinct(kept, OWN_TANK + buffer)
        parts.tank[buffer, :tanks] = -1
        parts.served[1 + buffer, :tanks, :vehicles] = -1


@uncounted
def compute_parts(kept: np.ndarray, block: Block, task: Task, parts: Parts) -> None:
    """Compute the parts of one block from the states `kept`."""
    _forget(kept, parts)
    rows = 0
    for place in range(kept.shape[0]):
        state, of = kept[place], parts.of[place]
        vehicle = int(state[OWN_VEHICLE])
        for buffer in range(3):
            tank = int(state[OWN_TANK + buffer])
            if parts.tank[buffer, tank] < 0:
                _rest(state, buffer, block, task, parts.row[rows])
                _fill(state, buffer, block, task, parts.row[rows + 1])
                parts.tank[buffer, tank] = rows
                rows += 2
            of[REST + buffer] = parts.tank[buffer, tank]
            of[FILL + buffer] = parts.tank[buffer, tank] + 1
        for outlet in range(-1, 3):
            tank = int(state[OWN_TANK + outlet]) if outlet >= 0 else 0
            if parts.served[1 + outlet, tank, vehicle] < 0:
                _serve(state, outlet, block, task, parts.row[rows])
                parts.served[1 + outlet, tank, vehicle] = rows
                rows += 1
            of[SERVE + 1 + outlet] = parts.served[1 + outlet, tank, vehicle]


@inlined
def admitted(of: np.ndarray, row: np.ndarray) -> int:
    """The valves that may open in a block, as bits, by the rows `of` the parts of a state."""
    found = 0
    for buffer in range(3):
        found |= (1 << buffer) if row[of[FILL + buffer], _ADMITTED] != 0.0 else 0
        found |= (8 << buffer) if row[of[SERVE + 1 + buffer], _ADMITTED] != 0.0 else 0
    return found


@inlined
def _rested(mass: float, temperature: float, buffer: int, model: Model) -> float:
    """The highest pressure of a closed buffer from now on [bar]: what is cold warms."""
    return gas_pressure(mass, max(temperature, model.ambient_temperature), model.buffer_volume[buffer], model)


@inlined
def may_start(state: np.ndarray, of: np.ndarray, row: np.ndarray, model: Model) -> tuple[int, int]:
    """Which buffers an empty vehicle can be given gas from, as bits; and which of them no more once filled.

    Several compressors, which fill several buffers at once, fill no closer than FILLED_SHARE, for a plan's steps are
    longer than the plant's.
    """
    limit = start_limit(model)
    filled = FILLED_SHARE * limit if model.compressor_count > 1 else limit
    now, lost = 0, 0
    for buffer in range(3):
        if _rested(state[MASS + buffer], state[TEMPERATURE + buffer], buffer, model) <= limit:
            now |= 1 << buffer
        part = row[of[FILL + buffer]]
        if _rested(part[PART_MASS], part[PART_TEMPERATURE], buffer, model) > filled:
            lost |= 1 << buffer
    return now, lost


@inlined
def keeps_start(command: int, now: int, lost: int) -> bool:
    """Whether a fill can begin after a command, whatever the vehicle holds, by what `may_start` says.

    Low is not filled beyond that; where it begins beyond, one of the others is not. Where all buffers are so full,
    Eq. (7.11) keeps an empty vehicle from gas for good.
    """
    return command & lost & INLET_LOW == 0 and (now == 0 or now & ~(command & lost) != 0)
