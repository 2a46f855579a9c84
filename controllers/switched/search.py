"""The beam: sequences of commands, a block each, kept by what they have cost and what their ends are worth."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from controllers.switched.parts import (
    CAME,
    COMMAND,
    CONNECTED,
    COST,
    FILL,
    FIRST,
    MASS,
    MISSING,
    OWN_TANK,
    OWN_VEHICLE,
    PART_COST,
    PART_DELAY,
    PART_FILL_END,
    PART_MASS,
    PART_MISSING,
    PART_NEXT_TANK,
    PART_NEXT_VEHICLE,
    PART_OPEN,
    PART_SCORE,
    PART_TEMPERATURE,
    PART_VEHICLE,
    REST,
    SCORE,
    SERVE,
    SIZE,
    STARTED,
    TEMPERATURE,
    VEHICLE_MASS,
    Block,
    Parts,
    Task,
    admitted,
    compute_parts,
    keeps_start,
    may_start,
    new_parts,
)
from controllers.switched.ranking import best_places, sort_on
from controllers.switched.value import restore
from station.compiled import inlined, kernel, uncounted
from station.geometry import OUTLETS

CELL = 0.02
"""Two states whose masses lie within this share are taken for the same: it widens the beam fourfold."""

CELL_KELVIN = 12.0
"""And whose temperatures lie within this [K]."""

POOL = 4
"""Candidates looked at for each state kept."""


@inlined
def _rows_of(command: int, of: np.ndarray) -> tuple[int, int, int, int]:
    """The rows a command is put together from: those of high, medium, low, and of the vehicle."""
    outlets = command >> 3
    high, medium, low = of[REST], of[REST + 1], of[REST + 2]
    vehicle = of[SERVE]
    if command & 1:
        high = of[FILL]
    if command & 2:
        medium = of[FILL + 1]
    if command & 4:
        low = of[FILL + 2]
    if outlets & 1:
        high = vehicle = of[SERVE + 1]
    elif outlets & 2:
        medium = vehicle = of[SERVE + 2]
    elif outlets & 4:
        low = vehicle = of[SERVE + 3]
    return high, medium, low, vehicle


@inlined
def _score(command: int, of: np.ndarray, row: np.ndarray) -> float:
    """What a command adds: cost of the block and worth of its end."""
    high, medium, low, vehicle = _rows_of(command, of)
    total = row[vehicle, PART_SCORE] if command >> 3 == 0 else 0.0
    total = total + row[high, PART_SCORE] + row[medium, PART_SCORE] + row[low, PART_SCORE]
    lift = min(row[high, PART_FILL_END], row[medium, PART_FILL_END], row[low, PART_FILL_END])
    delay = row[vehicle, PART_DELAY]
    return total + delay * lift if delay > 0.0 else total


@inlined
def _put_together(before: np.ndarray, command: int, of: np.ndarray, row: np.ndarray, state: np.ndarray) -> None:
    """Write the state after a block into `state` (SIZE,), but for whose its tanks and its vehicle are."""
    rows = _rows_of(command, of)
    cost = before[COST]
    still = command & OUTLETS
    for buffer in range(3):
        part = row[rows[buffer]]
        if command >> buffer & 1:
            cost += part[PART_COST]
            still |= (1 << buffer) if part[PART_OPEN] != 0.0 else 0
        state[MASS + buffer], state[TEMPERATURE + buffer] = part[PART_MASS], part[PART_TEMPERATURE]
        state[MISSING + buffer] = part[PART_MISSING]
    service = row[rows[3]]
    for entry in range(4):
        state[VEHICLE_MASS + entry] = service[PART_VEHICLE + entry]
    state[COST] = cost + service[PART_COST]
    state[COMMAND] = still
    state[FIRST] = before[FIRST]


@inlined
def _own(state: np.ndarray, command: int, of: np.ndarray, row: np.ndarray, count: np.ndarray) -> None:
    """Say whose the tanks and the vehicle of a kept state are; `count` (4,) are the distinct ones so far."""
    rows = _rows_of(command, of)
    for buffer in range(3):
        part = row[rows[buffer]]
        if part[PART_NEXT_TANK] < 0.0:
            part[PART_NEXT_TANK] = count[buffer]
            count[buffer] += 1
        state[OWN_TANK + buffer] = part[PART_NEXT_TANK]
    service = row[rows[3]]
    if service[PART_NEXT_VEHICLE] < 0.0:
        service[PART_NEXT_VEHICLE] = count[3]
        count[3] += 1
    state[OWN_VEHICLE] = service[PART_NEXT_VEHICLE]


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
        key = key * 1000003 + int(state[MASS + buffer] / (CELL * task.terminal[buffer].reference))
        key = key * 1000003 + int(state[TEMPERATURE + buffer] / CELL_KELVIN)
    if state[CONNECTED] != 0.0:
        key = key * 1000003 + int(state[VEHICLE_MASS] / (CELL * task.full))
    return key


@inlined
def _table_size(width: int) -> int:
    """Of the open addresses: a power of two, at least four times the states kept."""
    size = 4
    while size < 4 * width:
        size *= 2
    return size


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


class Room(NamedTuple):
    """Room for choosing among the candidates of a block."""

    score: np.ndarray  # (candidates,)
    pool: np.ndarray  # (candidates,) places of the best
    pivots: np.ndarray  # (candidates + 1,) of their order
    seen: np.ndarray  # cells of the states kept, a table of open addresses
    own: np.ndarray  # (4,) tanks of high, medium, low, and vehicles that these tell apart


@kernel
def _new_room(width: int, most: int) -> Room:
    """Room for `most` candidates, of which `width` are kept."""
    return Room(
        np.empty(most), np.empty(most, np.int64), np.empty(most + 1, np.int64), np.empty(_table_size(width), np.int64),
        np.empty(4, np.int64),
    )  # fmt: skip


@uncounted
def _expand(
    kept: np.ndarray, block: Block, mask: int, task: Task, parts: Parts, score: np.ndarray, origin: np.ndarray
) -> int:  # fmt: skip
    """List what may follow the kept states in a block; gives the number of candidates, one a state at least.

    The valves of `mask` stay as they are, but after a state in which that would keep every fill from beginning.
    """
    compute_parts(kept, block, task, parts)
    count = 0
    for place in range(kept.shape[0]):
        of = parts.of[place]
        allowed = admitted(of, parts.row)
        now, lost = may_start(kept[place], of, parts.row, task.model)
        was, before = int(kept[place, COMMAND]), count
        for frozen in (mask & allowed, 0):
            if count > before:
                break
            for command in task.commands:
                if command & ~allowed == 0 and (command ^ was) & frozen == 0 and keeps_start(command, now, lost):
                    score[count] = kept[place, COST] + _score(command, of, parts.row)
                    origin[count] = place * 64 + command
                    count += 1
    return count


@kernel
def _best_of_each(score: np.ndarray, origin: np.ndarray, kept: np.ndarray, first: bool, most: int) -> np.ndarray:
    """Places of the best candidate of each first command, the best `most` of these, best first."""
    best, place = np.full(64, np.inf), np.zeros(64, np.int64)
    for entry in range(score.size):
        command = origin[entry] & 63 if first else int(kept[origin[entry] >> 6, FIRST])
        if score[entry] < best[command]:
            best[command], place[command] = score[entry], entry
    order = np.argsort(best)
    number = 0
    while number < most and best[order[number]] < np.inf:
        number += 1
    return place[order[:number]]


@uncounted
def _keep(
    reserved: np.ndarray, pool: np.ndarray, score: np.ndarray, origin: np.ndarray, kept: np.ndarray, parts: Parts,
    first: bool, task: Task, room: Room, after: np.ndarray,
) -> int:  # fmt: skip
    """Write candidates into `after`, one a cell, until it is full; gives their number.

    First those of `reserved`, which need no cell of their own, then the best of `pool`, which is sorted as far as that.
    """
    room.seen[:], room.own[:] = 0, 0
    room.pivots[0], pivots, ranked = pool.size, 1, 0
    alive = 0
    for number in range(reserved.size + pool.size):
        if alive == after.shape[0]:
            break
        rank = number - reserved.size
        if rank >= ranked:
            ranked, pivots = sort_on(pool, score, ranked, room.pivots, pivots)
        entry = reserved[number] if rank < 0 else pool[rank]
        place, command = origin[entry] >> 6, origin[entry] & 63
        _put_together(kept[place], command, parts.of[place], parts.row, after[alive])
        if first:
            after[alive, FIRST] = command
        after[alive, SCORE], after[alive, CAME] = score[entry], origin[entry]
        if _is_new(_cell(after[alive], task), room.seen) or rank < 0:
            _own(after[alive], command, parts.of[place], parts.row, room.own)
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
    `trail` (blocks, width) receives where each state came from, unless it is empty.
    """
    most = width * task.commands.size
    kept, after = np.empty((width, SIZE)), np.empty((width, SIZE))
    parts = new_parts(width)
    score, origin, room = np.empty(most), np.empty(most, np.int64), _new_room(width, most)
    reserved = np.empty(0, np.int64)
    kept[0] = start
    kept[0, OWN_TANK : OWN_VEHICLE + 1] = 0.0
    for buffer in range(3):
        kept[0, MISSING + buffer] = restore(start[MASS + buffer], task.terminal[buffer], buffer, task.model)
    held = mask & int(start[COMMAND]) & allowed_now
    alive, looked_at = 1, 0
    time = np.sum(task.blocks[:begun])
    for level in range(begun, task.blocks.size):
        then = time + task.blocks[level]
        if level > begun:
            mask, held = 0, 0
        block = Block(
            time, task.blocks[level], arrived_by(time, task.waiting, task.coming),
            arrived_by(then, task.waiting, task.coming), held,
        )  # fmt: skip
        count = _expand(kept[:alive], block, mask, task, parts, score, origin)
        if firsts[1] > 0:
            each = width if level - begun < firsts[0] else firsts[1]
            reserved = _best_of_each(score[:count], origin, kept, level == begun, each)
        pool = room.pool[: best_places(score[:count], POOL * width, room.score, room.pool)]
        alive = _keep(reserved, pool, score, origin, kept, parts, level == begun, task, room, after)
        kept, after = after, kept
        if trail.size > 0:
            trail[level, :alive] = kept[:alive, CAME]
        looked_at += count
        time = then
    return kept[:alive], looked_at


@uncounted
def path_to(place: int, begun: int, trail: np.ndarray, commands: np.ndarray) -> None:
    """Write into `commands` (blocks,) those that lead from block `begun` to a state of the last block."""
    for level in range(commands.size - 1, begun - 1, -1):
        came = int(trail[level, place])
        commands[level] = came % 64
        place = came // 64


@kernel
def plan(
    start: np.ndarray, mask: int, allowed_now: int, task: Task, width: int, commands: np.ndarray
) -> tuple[float, int]:
    """Write the best sequence found into `commands` (blocks,); gives its cost with the worth of its end.

    In the first block the valves of `mask` stay as they are in `start`, the open ones if `allowed_now` has them. Also
    gives how many states were looked at.
    """
    trail = np.empty((task.blocks.size, width))
    kept, looked_at = search(start, 0, mask, allowed_now, task, width, (0, 0), trail)
    path_to(0, 0, trail, commands)
    return kept[0, SCORE], looked_at
