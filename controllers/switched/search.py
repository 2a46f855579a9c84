"""The beam: sequences of commands, a block each, kept by what they have cost and what their ends are worth."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from controllers.switched.model import Demand, Prices, Tank, Vehicle, fill, rest, serve, vehicle_tank
from controllers.switched.value import FILL_WEIGHT, lift_target, lift_time, rest_of_fill, restore, stock_worth
from station.compiled import inlined, kernel
from station.limits import admitted_valves
from station.plant import PlantConstants, gas_pressure

# Entries of a state: the plan's cost so far, the command in force, the first command; tanks; the vehicle; cost with
# the worth of its end, and where it came from: 64 times the place in the beam before, and the command.
COST, COMMAND, FIRST = 0, 1, 2
MASS, TEMPERATURE, MISSING = 3, 6, 9  # high, medium, low: [g], [deg C], seconds to restore
VEHICLE_MASS, VEHICLE_TEMPERATURE, CONNECTED, STARTED = 12, 13, 14, 15
SCORE, CAME = 16, 17
SIZE = 18

# Parts of a block: three rests, three fills, and four services: none, high, medium, low.
_REST, _FILL, _SERVE = 0, 3, 6
_PARTS = 10
# Entries of a part: what it adds to the score, its cost, tank, seconds to restore and to lift it, vehicle, whether it
# ends open, the price of a second of delay.
_SCORE, _COST, _MASS, _TEMPERATURE, _MISSING, _LIFT, _VEHICLE, _OPEN, _DELAY = 0, 1, 2, 3, 4, 5, 6, 10, 11
_ENTRIES = 12

CELL = 0.02
"""Two states whose masses lie within this share are taken for the same: it widens the beam fourfold."""

CELL_KELVIN = 12.0
"""And whose temperatures lie within this [K]."""

POOL = 4
"""Candidates looked at for each state kept."""

_TABLE_SIZE = 8192  # of the open addresses: four times WIDTH_MAX, a power of two


class Task(NamedTuple):
    """What a plan is made for."""

    model: PlantConstants
    demand: Demand
    prices: Prices
    waiting: int  # vehicles
    coming: np.ndarray  # due times of expected vehicles, from now [s]
    blocks: np.ndarray  # lengths [s]
    step: float  # [s]
    reference: np.ndarray  # masses to which the buffers are restored [g]
    start: float  # pressure from which `table` goes [bar]
    table: np.ndarray  # cost of the rest of a fill
    full: float  # mass of a full vehicle [g]
    commands: np.ndarray  # admissible by Eqs (7.17)-(7.19)


@inlined
def longest_step(seconds: float, step: float) -> float:
    """Longest step of the model within a block of `seconds`: five steps in a long block."""
    return max(step, seconds / 7.0)


@inlined
def fills_to_do(vehicle: Vehicle, arrived: int, task: Task) -> float:
    """Estimated cost of the rest of this fill and of those that wait for it."""
    demand = task.demand
    behind = arrived - vehicle.started
    total = 0.0
    if vehicle.connected:
        volume, finish = vehicle_tank(vehicle, demand)
        pressure = gas_pressure(vehicle.mass, vehicle.temperature, volume)
        total = rest_of_fill(pressure, behind, task.start, finish, task.table) * volume / demand.next_volume
    while behind > 0:
        behind -= 1
        total += rest_of_fill(task.start, behind, task.start, demand.next_finish, task.table)
    return FILL_WEIGHT * total


@inlined
def price_of_delay(vehicle: Vehicle, arrived: int, task: Task) -> float:
    """Price of a second for which no buffer can end a fill [s of compressor]."""
    behind = arrived - vehicle.started
    if not vehicle.connected and behind == 0:
        return 0.0
    return task.prices.occupancy + (task.prices.waiting if behind > 0 else 0.0)


@inlined
def _possible(state: np.ndarray, arrived: int, task: Task) -> int:
    """Valves that may open at the beginning of a block, as bits."""
    model, demand = task.model, task.demand
    vehicle = Vehicle(
        state[VEHICLE_MASS], state[VEHICLE_TEMPERATURE], state[CONNECTED] != 0.0, int(state[STARTED])
    )  # fmt: skip
    there = vehicle.connected or arrived > vehicle.started
    if vehicle.connected:
        heat = vehicle.temperature
        vehicle_pressure = gas_pressure(vehicle.mass, heat, vehicle_tank(vehicle, demand)[0])
    else:
        heat, vehicle_pressure = demand.next_temperature, demand.next_pressure
    volume = model.buffer_volume
    t = (state[TEMPERATURE], state[TEMPERATURE + 1], state[TEMPERATURE + 2], heat)
    p = (
        gas_pressure(state[MASS], t[0], volume[0]),
        gas_pressure(state[MASS + 1], t[1], volume[1]),
        gas_pressure(state[MASS + 2], t[2], volume[2]),
        vehicle_pressure,
    )
    return admitted_valves(p, t, there, int(state[COMMAND]), model, task.step)


@inlined
def _stock(row: np.ndarray, buffer: int, target: float, task: Task) -> float:
    """What the buffer of a part is worth."""
    return stock_worth(
        row[_MASS], row[_MISSING], task.reference[buffer], target, task.waiting, task.prices.gas, buffer, task.model
    )  # fmt: skip


@kernel
def _parts(
    state: np.ndarray, allowed: int, time: float, seconds: float, arrived: int, task: Task, part: np.ndarray
) -> None:
    """Compute the parts of one block from `state` into `part` (_PARTS, _ENTRIES)."""
    model = task.model
    was = int(state[COMMAND])
    vehicle = Vehicle(
        state[VEHICLE_MASS], state[VEHICLE_TEMPERATURE], state[CONNECTED] != 0.0, int(state[STARTED])
    )  # fmt: skip
    target = lift_target(task.demand, model)
    for buffer in range(3):
        tank = Tank(state[MASS + buffer], state[TEMPERATURE + buffer])
        row = part[_REST + buffer]
        row[_COST] = 0.0
        row[_MASS], row[_MISSING] = tank.mass, state[MISSING + buffer]
        row[_TEMPERATURE] = rest(buffer, tank.temperature, seconds, longest_step(seconds, task.step), model)
        row[_LIFT] = lift_time(tank.mass, row[_TEMPERATURE], target, buffer, model)
        row[_SCORE] = _stock(row, buffer, target, task)
        row[_OPEN] = 0.0
        if allowed >> buffer & 1:
            row = part[_FILL + buffer]
            held = was >> buffer & 1 != 0
            filled, spent, still = fill(buffer, tank, held, seconds, longest_step(seconds, task.step), model)
            row[_COST] = spent + (0.0 if held else task.prices.start)
            row[_MASS], row[_TEMPERATURE] = filled
            row[_MISSING] = restore(filled.mass, task.reference[buffer], buffer, model)
            row[_LIFT] = lift_time(filled.mass, filled.temperature, target, buffer, model)
            row[_SCORE] = row[_COST] + _stock(row, buffer, target, task)
            row[_OPEN] = 1.0 if still else 0.0
    for outlet in range(-1, 3):
        if outlet >= 0 and allowed & (8 << outlet) == 0:
            continue
        row = part[_SERVE + 1 + outlet]
        tank = Tank(0.0, 0.0)
        if outlet >= 0:
            tank = Tank(state[MASS + outlet], state[TEMPERATURE + outlet])
        tank, after, cost = serve(
            outlet,
            tank,
            vehicle,
            time,
            seconds,
            longest_step(seconds, task.step),
            task.waiting,
            task.coming,
            task.demand,
            task.prices,
            model,
        )
        row[_COST] = cost
        row[_SCORE] = cost + fills_to_do(after, arrived, task)
        if outlet >= 0:
            if was & (8 << outlet) == 0:
                row[_COST] += task.prices.start
                row[_SCORE] += task.prices.start
            row[_MASS], row[_TEMPERATURE] = tank
            row[_MISSING] = restore(tank.mass, task.reference[outlet], outlet, model)
            row[_LIFT] = lift_time(tank.mass, tank.temperature, target, outlet, model)
            row[_SCORE] += _stock(row, outlet, target, task)
        row[_DELAY] = price_of_delay(after, arrived, task)
        row[_VEHICLE], row[_VEHICLE + 1] = after.mass, after.temperature
        row[_VEHICLE + 2], row[_VEHICLE + 3] = (1.0 if after.connected else 0.0), after.started


@inlined
def _score(command: int, part: np.ndarray) -> float:
    """What a command adds: cost of the block and worth of its end."""
    outlets = command >> 3
    total = part[_SERVE, _SCORE] if outlets == 0 else 0.0
    delay = part[_SERVE, _DELAY]
    lift = np.inf
    for buffer in range(3):
        place = _REST + buffer
        if outlets >> buffer & 1:
            place = _SERVE + 1 + buffer
            delay = part[place, _DELAY]
        elif command >> buffer & 1:
            place = _FILL + buffer
        total += part[place, _SCORE]
        lift = min(lift, part[place, _LIFT])
    return total + delay * lift


@inlined
def _put_together(before: np.ndarray, command: int, part: np.ndarray, state: np.ndarray) -> None:
    """Write the state after a block into `state` (SIZE,)."""
    outlets = command >> 3
    cost = before[COST]
    service = part[_SERVE]
    still = 0
    for buffer in range(3):
        row = part[_REST + buffer]
        if outlets >> buffer & 1:
            row = part[_SERVE + 1 + buffer]
            service = row
            still |= 8 << buffer
        elif command >> buffer & 1:
            row = part[_FILL + buffer]
            cost += row[_COST]
            still |= (1 << buffer) if row[_OPEN] != 0.0 else 0
        state[MASS + buffer], state[TEMPERATURE + buffer] = row[_MASS], row[_TEMPERATURE]
        state[MISSING + buffer] = row[_MISSING]
    for entry in range(4):
        state[VEHICLE_MASS + entry] = service[_VEHICLE + entry]
    state[COST] = cost + service[_COST]
    state[COMMAND] = still
    state[FIRST] = before[FIRST]


@inlined
def arrived_by(time: float, waiting: int, coming: np.ndarray) -> int:
    """Vehicles there `time` seconds after the plan began, without the one connected then."""
    count = waiting
    for due in coming:
        if due <= time:
            count += 1
    return count


@inlined
def _cell(state: np.ndarray, task: Task) -> int:
    """The cell of the state space a state lies in; two states of one cell are taken for the same."""
    key = int(state[COMMAND]) * 4 + int(state[CONNECTED]) * 2 + 1 + int(state[STARTED]) * 256
    for buffer in range(3):
        key = key * 1000003 + int(state[MASS + buffer] / (CELL * task.reference[buffer]))
        key = key * 1000003 + int(state[TEMPERATURE + buffer] / CELL_KELVIN)
    if state[CONNECTED] != 0.0:
        key = key * 1000003 + int(state[VEHICLE_MASS] / (CELL * task.full))
    return key


@inlined
def _is_new(key: int, seen: np.ndarray) -> bool:
    """Whether a key is not among those `seen`, a table of open addresses; it is then."""
    place = (key ^ (key >> 29)) & (seen.size - 1)
    while seen[place] != 0:
        if seen[place] == key:
            return False
        place = (place + 1) & (seen.size - 1)
    seen[place] = key
    return True


@kernel
def _expand(
    kept: np.ndarray, alive: int, span: tuple[float, float], mask: int, held: int, task: Task, parts: np.ndarray,
    score: np.ndarray, origin: np.ndarray,
) -> int:  # fmt: skip
    """List what may follow the kept states in a block from span[0] to span[1] [s]; gives the number of candidates.

    The valves of `mask` stay as they are; those of `held` may stay open whatever a longer step of the model says.
    """
    count = 0
    now, then = arrived_by(span[0], task.waiting, task.coming), arrived_by(span[1], task.waiting, task.coming)
    for place in range(alive):
        allowed = _possible(kept[place], now, task) | held
        _parts(kept[place], allowed, span[0], span[1] - span[0], then, task, parts[place])
        frozen = mask & allowed
        was = int(kept[place, COMMAND])
        for command in task.commands:
            if command & ~allowed == 0 and (command ^ was) & frozen == 0:
                score[count] = kept[place, COST] + _score(command, parts[place])
                origin[count] = place * 64 + command
                count += 1
    return count


@kernel
def _ranked(score: np.ndarray, most: int) -> np.ndarray:
    """Places of the best `most` candidates, best first."""
    bar = np.inf
    if score.size > most:
        bar = np.partition(score, most - 1)[most - 1]
    chosen = np.nonzero(score <= bar)[0]
    return chosen[np.argsort(score[chosen])]


@kernel
def _best_of_each(score: np.ndarray, origin: np.ndarray, kept: np.ndarray, first: bool, most: int) -> np.ndarray:
    """Places of the best candidate of each first command, the best `most` of these, best first."""
    best, place = np.full(64, np.inf), np.zeros(64, np.int64)
    for entry in range(score.size):
        command = origin[entry] % 64 if first else int(kept[origin[entry] // 64, FIRST])
        if score[entry] < best[command]:
            best[command], place[command] = score[entry], entry
    order = np.argsort(best)
    number = 0
    while number < most and best[order[number]] < np.inf:
        number += 1
    return place[order[:number]]


@kernel
def _keep(
    order: np.ndarray, reserved: int, score: np.ndarray, origin: np.ndarray, kept: np.ndarray, parts: np.ndarray,
    first: bool, task: Task, after: np.ndarray,
) -> int:  # fmt: skip
    """Write the best candidates into `after`, one a cell, until it is full; gives their number.

    The first `reserved` of `order` need no cell of their own.
    """
    seen = np.zeros(_TABLE_SIZE, np.int64)
    alive = 0
    for number, entry in enumerate(order):
        if alive == after.shape[0]:
            break
        place, command = origin[entry] // 64, origin[entry] % 64
        _put_together(kept[place], command, parts[place], after[alive])
        if first:
            after[alive, FIRST] = command
        after[alive, SCORE], after[alive, CAME] = score[entry], origin[entry]
        if _is_new(_cell(after[alive], task), seen) or number < reserved:
            alive += 1
    return alive


@kernel
def search(
    start: np.ndarray, begun: int, mask: int, allowed_now: int, task: Task, width: int, firsts: tuple[int, int],
    trail: np.ndarray,
) -> tuple[np.ndarray, int]:  # fmt: skip
    """The states a beam is left with, best first, and the states looked at; the search begins with block `begun`.

    In the first block the valves of `mask` stay as they are in `start`, the open ones if `allowed_now` has them. One
    state of each first command is kept during the first firsts[0] blocks, and then of the best firsts[1] of them.
    `trail` (blocks, width) is told where each state came from; an empty one is not.
    """
    most = width * task.commands.size
    kept, after = np.empty((width, SIZE)), np.empty((width, SIZE))
    parts = np.empty((width, _PARTS, _ENTRIES))
    score, origin = np.empty(most), np.empty(most, np.int64)
    kept[0] = start
    for buffer in range(3):
        kept[0, MISSING + buffer] = restore(start[MASS + buffer], task.reference[buffer], buffer, task.model)
    held = mask & int(start[COMMAND]) & allowed_now
    alive, looked_at = 1, 0
    time = np.sum(task.blocks[:begun])
    for level in range(begun, task.blocks.size):
        span = (time, time + task.blocks[level])
        if level > begun:
            mask, held = 0, 0
        count = _expand(kept, alive, span, mask, held, task, parts, score, origin)
        order = _ranked(score[:count], min(count, POOL * width))
        reserved = 0
        if firsts[1] > 0:
            each = width if level - begun < firsts[0] else firsts[1]
            chosen = _best_of_each(score[:count], origin, kept, level == begun, each)
            reserved = chosen.size
            order = np.concatenate((chosen, order))
        alive = _keep(order, reserved, score, origin, kept, parts, level == begun, task, after)
        kept, after = after, kept
        if trail.size > 0:
            trail[level, :alive] = kept[:alive, CAME]
        looked_at += count
        time = span[1]
    return kept[:alive], looked_at


@kernel
def path_to(place: int, begun: int, trail: np.ndarray, commands: np.ndarray) -> None:
    """Write into `commands` (blocks,) those that lead from block `begun` to a state of the last block."""
    for level in range(commands.size - 1, begun - 1, -1):
        came = int(trail[level, place])
        commands[level] = came % 64
        place = came // 64


@kernel
def plan(start: np.ndarray, mask: int, allowed_now: int, task: Task, width: int) -> tuple[int, float, int]:
    """First command of the best sequence found, its cost with the worth of its end, and the states looked at.

    In the first block the valves of `mask` stay as they are in `start`, the open ones if `allowed_now` has them.
    """
    kept, looked_at = search(start, 0, mask, allowed_now, task, width, (0, 0), np.empty((0, 0)))
    return int(kept[0, FIRST]), kept[0, SCORE], looked_at
