"""A good sequence in bounded time: the best states of each stage, by cost so far and bound on the rest."""

from __future__ import annotations

import numpy as np

from controllers.minlp.bound import cost_to_go
from controllers.minlp.pair import COMMANDS, HORIZON, Search, admitted, best_pair, later
from controllers.minlp.stages import STATE, stage, tanks
from station.compiled import kernel

WIDTH = 64
"""States kept of each stage: at t = 10 one beam takes some 10 ms."""


@kernel
def _spread(
    kept: np.ndarray, about: np.ndarray, alive: int, stages: int, settings: np.ndarray, search: Search,
    found: np.ndarray, notes: np.ndarray, work: np.ndarray,
) -> int:  # fmt: skip
    """All successors of the kept states into `found` (n, 12) and `notes` (n, 4); gives their number.

    `about` and `notes` hold cost so far, rank of the first command, command before, and cost so far plus bound.
    """
    count = 0
    for place in range(alive):
        state = kept[place]
        allowed = admitted(tanks(state, 8), tanks(state, 4), int(about[place, 2]), search)
        for entry in range(settings.size - COMMANDS):
            command = int(settings[COMMANDS + entry])
            if command & ~allowed:
                continue
            cost = about[place, 0] + stage(state, command, search, found[count])
            notes[count, 0] = cost
            notes[count, 1] = about[place, 1] if about[place, 1] >= 0 else entry
            notes[count, 2] = command
            notes[count, 3] = cost + cost_to_go(found[count], stages, search, work)
            count += 1
    return count


@kernel
def best_by_beam(
    start: np.ndarray, previous: int, settings: np.ndarray, search: Search, memory: np.ndarray, work: np.ndarray
) -> tuple[float, int, int]:
    """Cost and first command's rank of the best sequence found from a state (12,), and the states looked at."""
    horizon = int(settings[HORIZON])
    kept, about = np.empty((WIDTH, STATE)), np.empty((WIDTH, 4))
    found, notes = np.empty((WIDTH * 20, STATE)), np.empty((WIDTH * 20, 4))
    kept[0] = start
    about[0, 0], about[0, 1], about[0, 2], about[0, 3] = 0.0, -1.0, previous, 0.0
    alive, looked_at = 1, 0
    for level in range(horizon - 1):
        now = search if level == 0 else later(search)
        count = _spread(kept, about, alive, horizon - level, settings, now, found, notes, work)
        looked_at += count
        alive = min(WIDTH, count)
        order = np.argsort(notes[:count, 3])
        for place in range(alive):
            kept[place], about[place] = found[order[place]], notes[order[place]]
    best, rank = np.inf, 20
    for place in range(alive):
        state = kept[place]
        cost, _ = best_pair(
            tanks(state, 0), tanks(state, 4), tanks(state, 8), int(about[place, 2]), settings, later(search), memory
        )
        if about[place, 0] + cost < best:
            best, rank = about[place, 0] + cost, int(about[place, 1])
    return best, rank, looked_at
