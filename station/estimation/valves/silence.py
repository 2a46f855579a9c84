"""Flow meters and the valve that alone is told to be open. Kernels.

Where a side gives through one valve, and nothing when another is told to be open, that one is closed.
"""

from __future__ import annotations

import numpy as np

from station.compiled import inlined
from station.estimation.valves.hearing import patience
from station.estimation.valves.memory import (
    AVERAGED,
    BANKS,
    CLEAR,
    PROVED,
    ROOM,
    SWITCHES,
    ValveMemory,
    alone,
    find_stuck,
    may_rest,
    works_again,
)  # fmt: skip
from station.geometry import VEHICLE

BLOCKED = 60.0
"""And for so long where nothing else says it: an outlet that lets nothing through, or a dispenser [s]."""

_NOTHING, _GIVES = 0.02, 0.2  # parts of what a side usually gives: what is no flow, and what is one [1]


@inlined
def _may_flow(m: ValveMemory, valve: int) -> bool:
    """Whether gas flows through a valve that is open, as far as pressures say."""
    if valve < BANKS:
        return m.filled[valve] == 0.0 or m.pressure[valve] <= m.filled[valve]
    return m.vehicle[0] >= 0.0 and m.pressure[valve - BANKS] - m.pressure[VEHICLE] >= ROOM


@inlined
def _note_gives(m: ValveMemory, side: int, valve: int, read: float, judged: np.ndarray) -> None:
    """Gas flows through the valve that alone is told to be open."""
    m.usual[side, 1] = min(m.usual[side, 1] + 1.0, AVERAGED)
    m.usual[side, 0] += (read - m.usual[side, 0]) / m.usual[side, 1]
    m.giving[valve] += 1.0
    m.silent[valve], m.beside[valve], m.gave[side, 0], m.gave[side, 1] = 0.0, 0.0, 0.0, valve
    m.works[valve, 0] = 0.0
    if side == 0:
        m.filled[valve] = max(m.filled[valve], m.pressure[valve])
    if m.position[valve] < 0.0:
        m.moved[valve] += 1.0
        if m.moved[valve] >= PROVED:
            works_again(m, valve)
    if m.giving[valve] < PROVED:
        return
    silent = int(m.after[valve]) - 1
    m.after[valve] = 0.0
    if silent >= 0 and m.position[silent] == 0.0 and m.giving[silent] == 0.0:
        find_stuck(m, silent, -1.0, m.closed[side, 1] + m.silent[silent], judged)


@inlined
def _note_silence(m: ValveMemory, side: int, valve: int, bars: float, grams: float, judged: np.ndarray) -> None:
    """Nothing flows through the valve that alone is told to be open, though it could, as the meter has it."""
    bank = valve % BANKS
    if m.silent[valve] == 0.0:
        m.start[valve] = m.smooth[bank]
    m.silent[valve] += 1.0
    expected = m.usual[side, 0] * m.silent[valve] / grams
    still = expected > bars and abs(m.smooth[bank] - m.start[valve]) < 0.5 * expected and may_rest(m, bank)
    m.still[valve] = 1.0 if still else 0.0
    m.after[valve] = 0.0
    m.beside[valve] += 1.0 if m.gave[side, 0] <= SWITCHES and m.gave[side, 1] != valve else 0.0
    if m.position[valve] != 0.0:
        m.moved[valve] = 0.0
        return
    enough = patience(m, side)
    for v in range(BANKS * side, BANKS * (side + 1)):  # another gives nothing as well: a machine does not work
        if v != valve and m.position[v] < 0.0 and m.silent[valve] >= enough and m.beside[valve] == 0.0:
            works_again(m, v)
            m.silent[valve] = -np.inf
            return
    blocked = side == 1 and m.silent[valve] >= max(BLOCKED, enough)
    if still and (m.beside[valve] >= enough or blocked):
        find_stuck(m, valve, -1.0, m.silent[valve], judged)


@inlined
def note_flow(
    m: ValveMemory, side: int, read: float, noise: float, bars: float, grams: tuple[float, float, float],
    judged: np.ndarray,
) -> None:  # fmt: skip
    """Take a reading of a flow meter for the valve that alone is told to be open."""
    usual, valve, again = m.usual[side, 0], alone(m, side), m.again[side]
    if np.isnan(read):
        return
    again[1] = again[1] + 1.0 if read == again[0] else 1.0
    again[0] = read
    if read != 0.0:
        again[2] = max(again[2], again[1])
    nothing = max(_NOTHING * usual, CLEAR * noise)
    if valve < 0:
        return
    if read > max(nothing, _GIVES * usual):
        _note_gives(m, side, valve, read, judged)
    elif read > nothing:  # little, and yet through this one: a compressor against nearly its own pressure
        m.silent[valve] = m.beside[valve] = 0.0
    elif usual > 0.0 and m.giving[valve] == 0.0 and _may_flow(m, valve):
        b = valve % BANKS
        weight = grams[0] if b == 0 else (grams[1] if b == 1 else grams[2])
        _note_silence(m, side, valve, bars, weight, judged)
