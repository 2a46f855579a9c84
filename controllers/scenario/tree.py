"""A tree of commands for each of the best first ones, and how it is followed when arrivals differ from its branches.

The trunk expects the next arrival not announced at its typical time. Where it comes early, or has not come by then, the
tree branches: commands from there on are planned for what has been seen until there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from controllers.scenario.play import plan_terminal_cost, play_block
from controllers.switched.parts import COST, FIRST, SCORE, Task
from controllers.switched.search import path_to, search
from station.compiled import inlined, kernel, uncounted

TYPICAL, EARLY, LATE = 0, 1, 2


class Tree(NamedTuple):
    """Candidates: a first command each, and what follows."""

    commands: np.ndarray  # (J, 3, blocks): typical, early, late
    seen: np.ndarray  # (3,) the block at whose beginning the arrival of each branch has been seen
    cost: np.ndarray  # (J,) mean over the branches, with the worth of their ends [s of compressor]


@kernel
def _with(task: Task, coming: np.ndarray) -> Task:
    """The task with other arrivals."""
    return Task(
        task.model, task.demand, task.prices, task.waiting, coming, task.blocks, task.step, task.terminal,
        task.table, task.full, task.commands,
    )  # fmt: skip


@kernel
def _block_after(time: float, blocks: np.ndarray) -> int:
    """The first block that does not begin before `time` [s]; their number if none does."""
    begin = 0.0
    for block in range(blocks.size):
        if begin >= time:
            return block
        begin += blocks[block]
    return int(blocks.size)


@kernel
def trunks(
    start: np.ndarray, mask: int, allowed_now: int, task: Task, width: int, firsts: tuple[int, int],
    commands: np.ndarray, cost: np.ndarray,
) -> int:  # fmt: skip
    """Write the best sequence of each of the best first commands and its cost; gives their number.

    `commands` (J, blocks) and `cost` (J,) take as many as there are, best first; `firsts` are the search's.
    """
    trail = np.empty((task.blocks.size, width))
    kept, _ = search(start, 0, mask, allowed_now, task, width, firsts, trail)
    met, number = 0, 0
    for place in np.argsort(kept[:, SCORE]):
        first = 1 << int(kept[place, FIRST])
        if met & first or number == cost.size:
            continue
        met |= first
        path_to(place, 0, trail, commands[number])
        cost[number] = kept[place, SCORE]
        number += 1
    return number


@kernel
def _branch(start: np.ndarray, task: Task, commands: np.ndarray, begun: int, width: int, usual: np.ndarray) -> float:
    """Plan anew from block `begun` on, in place of the trunk's `commands`; gives the cost of the whole."""
    state, time = start.copy(), 0.0
    for block in range(begun):
        play_block(state, commands[block], time, task.blocks[block], task, task.coming, usual)
        time += task.blocks[block]
    if begun == task.blocks.size:
        return state[COST] + plan_terminal_cost(state, task.coming, task)
    trail = np.empty((task.blocks.size, width))
    kept, _ = search(state, begun, 0, 0, task, width, (0, 0), trail)
    path_to(0, begun, trail, commands)
    return kept[0, SCORE]


@kernel
def grow(
    start: np.ndarray, mask: int, allowed_now: int, task: Task, branches: np.ndarray, first_unknown: int,
    widths: tuple[int, int], most: int,
) -> Tree:  # fmt: skip
    """The trees of at most `most` first commands.

    `branches` (3, n) are the arrivals of each branch [s], `first_unknown` the place of the first not announced in
    them, `widths` the states kept of trunks and of branches.
    """
    blocks = task.blocks.size
    commands, cost = np.zeros((most, 3, blocks), np.int64), np.zeros((most, 3))
    seen = np.empty(3, np.int64)
    for branch in range(3):
        seen[branch] = _block_after(branches[branch, first_unknown], task.blocks)
    paths = np.zeros((most, blocks), np.int64)
    number = trunks(
        start, mask, allowed_now, _with(task, branches[TYPICAL]), widths[0], (3, most), paths, cost[:, TYPICAL]
    )
    usual = np.full(1, task.demand.next_pressure)
    early, late = _with(task, branches[EARLY]), _with(task, branches[LATE])
    for place in range(number):
        for branch in range(3):
            commands[place, branch] = paths[place]
        cost[place, EARLY] = _branch(start, early, commands[place, EARLY], seen[EARLY], widths[1], usual)
        cost[place, LATE] = _branch(start, late, commands[place, LATE], seen[TYPICAL], widths[1], usual)
    mean = (cost[:number, TYPICAL] + cost[:number, EARLY] + cost[:number, LATE]) / 3.0
    return Tree(commands[:number], seen, mean)


@inlined
def _nearest(block: int, seen: np.ndarray, blocks: int) -> int:
    """The branch whose arrival is seen nearest to a block; the typical one if no branch sees any."""
    best, least = TYPICAL, blocks + 1
    for branch in range(3):
        distance = abs(block - seen[branch])
        if seen[branch] < blocks and distance < least:
            best, least = branch, distance
    return best


@inlined
def _command(tree: Tree, candidate: int, block: int, branch: int, shift: int) -> int:
    """What is done in a block: before the arrival (`branch` -1) by trunk and late branch, then `shift` blocks on."""
    last = tree.commands.shape[2] - 1
    if branch < 0:
        return tree.commands[candidate, TYPICAL if block < tree.seen[TYPICAL] else LATE, block]
    return tree.commands[candidate, branch, min(block + shift, last)]


@uncounted
def follow(
    tree: Tree, candidate: int, state: np.ndarray, task: Task, coming: np.ndarray, first_unknown: int,
    pressure: np.ndarray, window: int,
) -> bool:  # fmt: skip
    """Carry `state` along a candidate in one future; True, and no further, where there is a shortage in the window.

    Until the first arrival not announced the typical branch is followed, and from when that expects it the late one.
    When it has come, what the nearest branch does from its arrival on. No command depends on what comes later.
    """
    blocks = task.blocks.size
    time, branch, shift = 0.0, -1, 0
    for block in range(min(blocks, window)):
        if branch < 0 and coming[first_unknown] <= time:
            branch = _nearest(block, tree.seen, blocks)
            shift = tree.seen[branch] - block if tree.seen[branch] < blocks else 0
        command = _command(tree, candidate, block, branch, shift)
        if play_block(state, command, time, task.blocks[block], task, coming, pressure):
            return True
        time += task.blocks[block]
    return False


@kernel
def falls_short(
    tree: Tree, candidate: int, start: np.ndarray, task: Task, coming: np.ndarray, first_unknown: int,
    pressure: np.ndarray, window: int,
) -> bool:  # fmt: skip
    """Whether a candidate has a shortage in one future, in the first `window` blocks."""
    return follow(tree, candidate, start.copy(), task, coming, first_unknown, pressure, window)
