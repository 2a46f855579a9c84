"""Valves that stick, a line that leaks, sensors that drift: what comes of them is not told as something else."""

from __future__ import annotations

import numpy as np

from station.compiled import inlined
from station.estimation.detection_memory import (
    ABSENCES,
    AFTER_VALVES,
    DRIFTS,
    FIRST_METER,
    FREEZES,
    GAVE,
    HOLD,
    LEAK_NOTHING,
    LINE,
    LINE_HOLD,
    METER_DRIFTS,
    OFFSETS,
    OUTLETS,
    SEATS,
    SETTLING,
    SHARP_LEAK,
    SHOWN,
    SMOOTHED,
    STAYS,
    STICKS,
    TOGETHER,
    DriftArrays,
    Memory,
    spell,
)
from station.estimation.interface import LEAK, MV
from station.estimation.valves.memory import AGREED, FINE, LETS_OTHER, METER, ROOM, SEAT, WORKS
from station.estimation.valves.meters import DRIFTS_NOW, IS_OFF, READS_NOTHING
from station.geometry import BUFFERS, VALVES, VEHICLE


@inlined
def net_loss(states: np.ndarray, k: int, scale: float) -> float:
    """The loss of a buffer less what others seem to gain [g/s]: gas that goes to another one is not lost.

    Two buffers that give at nearly the same pressure share a flow by differences that no sensor tells.
    """
    loss = states[LEAK + k]
    for j in range(len(BUFFERS)):
        if j != k:
            loss += min(0.0, states[LEAK + j] + scale * LEAK_NOTHING)
    return loss


@inlined
def note_drifts(
    m: Memory, row: int, states: np.ndarray, drifts: DriftArrays, small_leak: np.ndarray, scale: float,
    begins: np.ndarray, firsts: np.ndarray, sizes: np.ndarray,
) -> None:  # fmt: skip
    """Take what sensors are off [bar], [K], as `station.estimation.drifting` has judged it, and buffers that lose gas.

    The size of a drift is of an hour. Where a buffer is seen to leak its pressure sensor is not said to drift; nor is
    any just after a valve was found to stick, and while one is stuck open.
    """
    biases, ago, lasts, falls = drifts
    if row >= len(biases):  # none are looked for
        return
    for k in range(falls.shape[1]):
        if (
            falls[row, k] > 0.0
            and net_loss(states, k, scale) > max(scale * SHARP_LEAK, small_leak[k])
            and m.second[0] >= SETTLING
        ):
            spell(m, k, m.quiet[k], states[LEAK + k], begins, firsts)
    for k in range(biases.shape[1]):
        signal = DRIFTS + k
        leaks = k < len(BUFFERS) and (m.second[0] - m.seen[k] <= HOLD or m.told[SEATS + k] > 0.0)
        held = leaks or m.second[0] - m.moved[0] <= AFTER_VALVES
        found = not np.isnan(ago[row, k]) and not held
        if found:
            m.quiet[signal] = m.second[0] - ago[row, k]
        m.told[signal] = lasts[row, k] if found or m.told[signal] > 0.0 else 0.0
        if lasts[row, k] > 0.0:
            sizes[signal] = 3600.0 * biases[row, k] / max(m.second[0] - m.quiet[signal], 1.0)
        if found:
            begins[signal], firsts[signal] = m.quiet[signal], sizes[signal]


@inlined
def _note_visit(m: Memory, values: np.ndarray, states: np.ndarray, scale: float) -> None:
    """How long the vehicle is connected and each outlet open in its visit; buffers that lose nothing behind it."""
    connected = not np.isnan(states[MV])
    blind = m.told[ABSENCES] > 0.0 and m.told[ABSENCES + 1] > 0.0 and m.told[ABSENCES + 2] > 0.0
    m.visit[1] = 0.0 if connected else m.visit[1] + (0.0 if blind else 1.0)  # what was lost meanwhile nobody saw
    if connected and m.visit[2] == 0.0:
        m.visit[0] = m.opened[0] = m.opened[1] = m.opened[2] = 0.0
    m.visit[0] += 1.0 if connected else 0.0
    m.visit[2] = 1.0 if connected else 0.0
    for k in range(len(BUFFERS)):
        if connected and values[OUTLETS + k] >= 0.5:
            m.opened[k] += 1.0
        if not connected and states[LEAK + k] <= scale * LEAK_NOTHING:
            m.spelled[k, 3] = 1.0


@inlined
def _note_tight(m: Memory, values: np.ndarray, states: np.ndarray, scale: float) -> None:
    """Note outlets that have been closed for SHOWN of a visit with nothing lost: they were tight when that began."""
    for k in range(len(BUFFERS)):
        through = m.visit[2] > 0.0 and values[k] - values[VEHICLE] >= ROOM
        if through and min(m.visit[0], m.shut[k]) >= SHOWN and states[LEAK + k] <= scale * LEAK_NOTHING:
            m.right[SEATS + k] = m.second[0] - SHOWN


@inlined
def _leaks_again(m: Memory, k: int, begins: np.ndarray, firsts: np.ndarray) -> bool:
    """Whether a leak that is found was there in a visit before and not behind it, with the outlet closed mostly."""
    with_closed = m.visit[1] <= GAVE and 2.0 * m.opened[k] < m.visit[0] and m.told[LINE] == 0.0
    again = with_closed and m.second[0] - m.spelled[k, 0] <= LINE_HOLD and m.spelled[k, 3] > 0.0
    begin, first = m.spelled[k, 1], m.spelled[k, 2]
    if with_closed:
        m.spelled[k, 0], m.spelled[k, 1], m.spelled[k, 2], m.spelled[k, 3] = m.second[0], begins[k], firsts[k], 0.0
    if again:
        begins[k], firsts[k] = begin, max(first, firsts[k])
    return again


@inlined
def judge_outlets(
    m: Memory, row: int, values: np.ndarray, states: np.ndarray, scale: float, stuck: np.ndarray, begins: np.ndarray,
    firsts: np.ndarray, sizes: np.ndarray,
) -> None:  # fmt: skip
    """Outlets that are not tight: as `station.estimation.valves` has judged it, or by leaks that visits alone have.

    What such an outlet lets through is no leak of its buffer; nor is what the line loses. What is lost STAYS behind a
    visit is.
    """
    if row >= len(stuck):  # none are looked for
        return
    _note_visit(m, values, states, scale)
    _note_tight(m, values, states, scale)
    for k in range(len(BUFFERS)):
        signal, ago = SEATS + k, stuck[row, SEAT + k]
        rate, deviation = stuck[row, SEAT + 2 * len(BUFFERS) + k], stuck[row, SEAT + 3 * len(BUFFERS) + k]
        known = rate > 2.0 * deviation
        sizes[signal] = rate if known else np.nan
        judged = stuck[row, SEAT + len(BUFFERS) + k] > 0.0
        again = not np.isnan(begins[k]) and _leaks_again(m, k, begins, firsts)
        other = stuck[row, SEAT + len(BUFFERS) + k] == LETS_OTHER
        if other:
            m.right[signal] = m.second[0] - stuck[row, AGREED + k]
        if other or (m.told[signal] == 0.0 and (again or not np.isnan(ago))):
            begins[signal] = begins[k] if again and not other else m.second[0] - ago
            firsts[signal] = rate if known else firsts[k]
            m.leaked[k, 3] = 1.0
        if again or judged:
            m.seen[signal] = m.second[0]
        m.told[signal] = 1.0 if m.second[0] - m.seen[signal] <= LINE_HOLD else 0.0
        if m.told[signal] > 0.0 and m.visit[1] <= STAYS and not np.isnan(begins[k]):
            begins[k], m.leaked[k, 3] = np.nan, 1.0
        if m.leaked[k, 3] > 0.0 and m.visit[1] > STAYS and m.seen[k] == m.second[0]:  # a leak of its own after all
            begins[k], firsts[k], m.leaked[k, 3] = m.quiet[k], states[LEAK + k], 0.0


@inlined
def note_meters(
    m: Memory, row: int, stuck: np.ndarray, begins: np.ndarray, firsts: np.ndarray, sizes: np.ndarray
) -> None:
    """Flow meters that drift, have an offset, or read no flow, as `station.estimation.valves.meters` has judged it."""
    if row >= len(stuck):  # none are looked for
        return
    for side in range(2):
        known, size, ago = stuck[row, METER + side], stuck[row, METER + 2 + side], stuck[row, METER + 4 + side]
        drift, offset, frozen = METER_DRIFTS + side, OFFSETS + FIRST_METER + side, FREEZES + FIRST_METER + side
        m.told[drift] = 1.0 if known == DRIFTS_NOW else 0.0
        if known == READS_NOTHING and m.told[frozen] == 0.0:
            begins[frozen], firsts[frozen], m.told[frozen] = m.second[0] - ago, 0.0, 1.0
            m.moved[0] = m.second[0]  # gas that was not counted is missed in every tank
        if known == DRIFTS_NOW:
            sizes[drift] = size
        if known == IS_OFF:
            sizes[offset] = size
            if np.isnan(ago):
                m.seen[offset] = m.second[0]
            else:
                spell(m, offset, m.second[0] - ago, size, begins, firsts)
        if known == DRIFTS_NOW and not np.isnan(ago):
            begins[drift], firsts[drift] = m.second[0] - ago, size
            m.right[drift] = m.second[0] - stuck[row, FINE + side]


@inlined
def note_stuck(m: Memory, row: int, stuck: np.ndarray, begins: np.ndarray, firsts: np.ndarray) -> None:
    """Valves that stick, as `station.estimation.valves` has judged it; the size is 1 of one that is open."""
    if row >= len(stuck):  # none are looked for
        return
    for k in range(len(VALVES)):
        position, ago = stuck[row, k], stuck[row, len(VALVES) + k]
        if not np.isnan(ago):
            begins[STICKS + k], firsts[STICKS + k] = m.second[0] - ago, 1.0 if position > 0.0 else 0.0
            m.right[STICKS + k] = m.second[0] - stuck[row, WORKS + k]
        if abs(position) != m.told[STICKS + k] or not np.isnan(ago):
            m.moved[0] = m.second[0]
        m.told[STICKS + k] = abs(position)
        if position > 0.0:
            m.moved[0] = m.second[0]


@inlined
def _blame_line(m: Memory, k: int, begins: np.ndarray, firsts: np.ndarray) -> None:
    """A leak of a buffer was found just after it gave: it is the line's where that of another was as well."""
    second, other = m.second[0], -1
    for b in range(len(BUFFERS)):
        if b != k and second - m.leaked[b, 0] <= TOGETHER:
            other = b
    m.leaked[k, 0], m.leaked[k, 1], m.leaked[k, 2] = second, begins[k], firsts[k]
    lasts = second - m.seen[LINE] <= LINE_HOLD
    if other < 0 and not lasts:
        return
    if not lasts:
        begins[LINE] = min(m.leaked[k, 1], m.leaked[other, 1])
        firsts[LINE] = max(m.leaked[k, 2], m.leaked[other, 2])
        m.leaked[other, 3] = 1.0
    begins[k], m.seen[LINE], m.leaked[k, 3] = np.nan, second, 1.0


@inlined
def judge_line(
    m: Memory, values: np.ndarray, states: np.ndarray, scale: float, begins: np.ndarray, firsts: np.ndarray
) -> None:
    """Gas that the line loses is missed by the buffers that give, while they do."""
    for k in range(len(BUFFERS)):
        m.shut[k] = 0.0 if values[OUTLETS + k] >= 0.5 else m.shut[k] + 1.0
        if states[LEAK + k] <= scale * LEAK_NOTHING:
            if m.leaked[k, 3] > 0.0:
                m.seen[k] = -np.inf  # what is seen next is judged as found: it is not known as the buffer's
                m.smoothed[k] = 0.0
            m.leaked[k, 3] = 0.0
        if m.leaked[k, 3] > 0.0 and GAVE < m.shut[k] <= GAVE + SMOOTHED:
            m.smoothed[k] = 0.0  # what lags behind is what the line lost
        if not np.isnan(begins[k]) and m.shut[k] <= GAVE:
            _blame_line(m, k, begins, firsts)
        lays = m.leaked[k, 3] > 0.0 and m.told[LINE] > 0.0 and m.told[SEATS + k] == 0.0
        if lays and m.seen[k] == m.second[0] and m.shut[k] <= GAVE:  # what is laid to the line is still seen
            m.seen[LINE] = m.second[0]
    m.told[LINE] = 1.0 if m.second[0] - m.seen[LINE] <= LINE_HOLD else 0.0


@inlined
def hold_back(m: Memory, begins: np.ndarray) -> None:
    """Tell nothing that a valve which sticks, or works again, may have caused; what lasts is told afterwards."""
    if m.second[0] - m.moved[0] > AFTER_VALVES:
        return
    for k in range(m.seen.shape[0]):
        caused = k < FREEZES or k >= LINE
        if caused and not np.isnan(begins[k]):
            begins[k], m.seen[k], m.told[k] = np.nan, -np.inf, 0.0


@inlined
def mute_hidden(m: Memory, mute: np.ndarray, begins: np.ndarray) -> None:
    """Tell nothing that may come from a bank of which nobody knows its pressure, or its volume.

    `mute` (1 + banks, signals) is 1 of what is never told, and then of what is not while a bank's pressure is not told.
    """
    for k in range(len(BUFFERS) + 1):
        if k > 0 and m.told[FREEZES + k - 1] + m.told[ABSENCES + k - 1] == 0.0:
            continue
        for signal in range(m.seen.shape[0]):
            if mute[k, signal] != 0.0 and not np.isnan(begins[signal]):
                begins[signal], m.seen[signal], m.told[signal] = np.nan, -np.inf, 0.0
