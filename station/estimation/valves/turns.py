"""Outlets that take turns: one that is stuck open gives beside each of the others, and alone in its own turn. Kernels.

Where outlets are told open second by second no buffer's pressure falls for long enough to say which of them gives. The
flow meter says it: what it reads goes up where the turn of an outlet that is stuck open ends.
"""

from __future__ import annotations

import numpy as np

from station.compiled import inlined
from station.estimation.valves.balance import LEAST
from station.estimation.valves.memory import BANKS, METERS, ROOM, ValveMemory, alone, find_stuck, works_again
from station.geometry import VEHICLE

BESIDE, ALONE = 1.5, 1.2
"""By how much a flow is larger than pressures make it: at least where another outlet gives as well, at most where none
does [1]."""

TURNS = 3.0
"""Turns that tell that an outlet is stuck open, or works again."""

TOGETHER = 900.0
"""Those that tell it follow one another within so long [s]."""

_LATELY = 3.0  # seconds between the readings that are compared at most [s]


@inlined
def _note_turn(m: ValveMemory, outlet: int, began: float, ended: float, judged: np.ndarray) -> None:
    """Count the turn of an outlet by how much more flowed before it and behind it.

    Where one of them alone is more, it is the flow that changes: a fill begins, or a ramp takes hold.
    """
    turn = m.turns[outlet]
    is_open = min(began, ended) > BESIDE
    if not is_open and not min(began, ended) < ALONE:
        return
    if turn[1] > TOGETHER:
        turn[0] = 0.0
    if is_open:
        turn[1] = turn[1] if turn[0] > 0.0 else 0.0
        turn[0], turn[2] = turn[0] + 1.0, 0.0
    else:
        turn[0], turn[2] = max(turn[0] - 2.0, 0.0), turn[2] + 1.0
    valve = BANKS + outlet
    if turn[0] >= TURNS and m.position[valve] == 0.0:
        find_stuck(m, valve, 1.0, turn[1], judged)
        turn[0] = 0.0
    elif turn[2] >= TURNS and m.position[valve] > 0.0:
        works_again(m, valve)
    if not is_open and turn[2] >= TURNS:
        m.works[valve, 1] = 0.0


@inlined
def _compared(m: ValveMemory, before: int, now: int) -> bool:
    """Whether what flows in two turns can be compared by pressures."""
    return min(m.smooth[now], m.smooth[before]) - m.pressure[VEHICLE] >= ROOM


@inlined
def judge_turns(m: ValveMemory, values: np.ndarray, judged: np.ndarray) -> None:
    """Take a reading of the dispenser's meter for the outlet that alone is told to be open."""
    m.turn[2] += 1.0
    for outlet in range(BANKS):
        m.turns[outlet, 1] += 1.0
    read, now = values[METERS + 1], alone(m, 1) - BANKS
    told = m.heard[BANKS] + m.heard[BANKS + 1] + m.heard[BANKS + 2] == 0.0
    if np.isnan(read) or now < 0 or not told or m.vehicle[0] < 0.0:
        return
    before, last, lately, began = int(m.turn[0]), m.turn[1], m.turn[2] <= _LATELY, m.turn[3]
    m.turn[0], m.turn[1], m.turn[2] = now, read, 0.0
    if before == now and lately:
        return
    m.turn[3] = np.nan
    if before < 0 or not lately or min(read, last) < LEAST or not _compared(m, before, now):
        return  # of less what leaks would be as much
    ratio = (m.smooth[now] - m.pressure[VEHICLE]) / (m.smooth[before] - m.pressure[VEHICLE])
    pressures = m.smooth[now] / m.smooth[before]
    m.turn[3] = last / read * min(ratio, pressures, 1.0)
    if not np.isnan(began):
        _note_turn(m, before, began, read / last / max(ratio, pressures, 1.0), judged)
