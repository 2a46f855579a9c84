"""Outlets that are not tight: a closed buffer loses gas while a vehicle is connected, and none while none is. Kernels.

A rate of loss is the slope of the buffer's mass by its readings, by least squares over stretches with a level each. No
model of flows is needed. What else loses gas does so at other times too, and so does a sensor that drifts.
"""

from __future__ import annotations

import math

import numpy as np

from station.compiled import inlined
from station.estimation.valves.memory import (
    AGREED,
    BANKS,
    LETS_OTHER,
    ROOM,
    SEAT,
    SWITCHES,
    USUAL,
    ValveMemory,
)  # fmt: skip
from station.geometry import KELVIN, TANKS, VEHICLE

SETTLED = 60.0
"""Seconds for which both valves of a buffer must have been closed: thermometers follow, and clocks may be off [s]."""

LEAST_LOSS = 0.1
"""An outlet that lets less through counts as tight [g/s]."""

CHANGED, CHANGED_LOSS = 0.3, 0.15
"""One lets more or less through than before if that differs by more than this part of it, and so much [1], [g/s]."""

REMEMBERED = 14_400.0
"""Time over which stretches without a vehicle are remembered [s]."""

SURELY = 5.0
"""Standard deviations by which a buffer must lose more while a vehicle is connected [1]."""

CALM = 600.0
"""A valve that was open within so long may have been in a second in which nobody told: a stretch begins anew [s]."""

LONGEST = 1200.0
"""A stretch that lasts longer begins anew [s]."""

_TIGHT = 1 / 3  # part of the rate with vehicles that a buffer must lose at most without one [1]
_KNOWN = 6.0  # the rate without a vehicle is known to this part of the rate with one [1]
_SPREADS = 60.0  # readings by which it is known how they spread, whatever tags say [1]
_FEWEST = 10.0  # readings of a stretch [1]
_JUMPS = 5.0  # deviations by which a mass moves from one reading to the next if a sensor jumps: a stretch ends there
_NOBODY, _VISIT = 0, 1  # kinds of stretches: nobody who could be given gas is connected, or somebody is
_LASTS, _SINCE, _JUDGED, _VISITED, _RATE, _SPREAD, _AGREED = range(7)  # of `ValveMemory.seat`


@inlined
def _kind(m: ValveMemory, bank: int) -> int:
    """Of the second: `_VISIT`, `_NOBODY`, or -1 where it says nothing."""
    if m.heard[bank] > SWITCHES or m.heard[BANKS + bank] > SWITCHES or np.isnan(m.kelvin[bank]):
        return -1
    stuck = m.position[bank] != 0.0 or m.position[BANKS + bank] != 0.0 or m.untold[0] + m.untold[1] > 0.0
    if stuck or m.told[bank] > 0.0 or m.told[BANKS + bank] > 0.0:
        m.shut[bank] = 0.0
        return -1
    m.shut[bank] += 1.0
    if m.shut[bank] <= SETTLED:
        return -1
    above = m.pressure[bank] - m.pressure[VEHICLE]
    if m.vehicle[0] < 0.0 or above <= -ROOM:
        return _NOBODY
    return _VISIT if above >= ROOM else -1


@inlined
def _open_stretch(m: ValveMemory, bank: int) -> tuple[float, float]:
    """Squares of the times of a stretch about their mean [s2], and their products with the masses [g s]."""
    count, times = m.stretch[bank, 2], m.stretch[bank, 3]
    if count < _FEWEST:
        return 0.0, 0.0
    return m.stretch[bank, 5] - times * times / count, m.stretch[bank, 6] - times * m.stretch[bank, 4] / count


@inlined
def _take(m: ValveMemory, bank: int, mass: float) -> None:
    """Take a buffer's mass by a pressure and a temperature that are both new [g], and how it spreads."""
    time = m.stretch[bank, 1]
    m.stretch[bank, 2] += 1.0
    m.stretch[bank, 3] += time
    m.stretch[bank, 4] += mass
    m.stretch[bank, 5] += time * time
    m.stretch[bank, 6] += time * mass
    change = (mass - 2.0 * m.heavy[bank, 1] + m.heavy[bank, 0]) ** 2 / 6.0
    if not np.isnan(change):
        m.heavy[bank, 2] += (change - m.heavy[bank, 2]) / _SPREADS
    m.heavy[bank, 0], m.heavy[bank, 1] = m.heavy[bank, 1], mass


@inlined
def _rate(kept: np.ndarray, open_stretch: tuple[float, float], spread: float) -> tuple[float, float]:
    """A rate of loss and its standard deviation [g/s]; infinite where nothing is known."""
    square = kept[0] + open_stretch[0]
    if square <= 0.0:
        return 0.0, np.inf
    return -(kept[1] + open_stretch[1]) / square, spread / math.sqrt(square)


@inlined
def _end_stretch(m: ValveMemory, bank: int, kind: int, spread: float) -> None:
    """Keep a stretch, and begin one of a kind; a visit is another one where nobody was there in between.

    Visits are pooled as a cumulative sum is: from the first one behind which they lose as much as counts.
    """
    before = int(m.stretch[bank, 0])
    if before >= 0:
        square, product = _open_stretch(m, bank)
        for kept in (m.pooled, m.newest):
            kept[bank, before, 0] += square
            kept[bank, before, 1] += product
    if kind == _VISIT and m.newest[bank, _NOBODY, 0] > 0.0:
        if _rate(m.pooled[bank, _VISIT], (0.0, 0.0), spread)[0] < LEAST_LOSS:
            m.pooled[bank, _VISIT] = 0.0
            m.seat[bank, _SINCE] = 0.0
        m.earlier[bank, 0], m.earlier[bank, 1] = m.newest[bank, _NOBODY, 0], m.newest[bank, _NOBODY, 1]
        m.newest[bank] = 0.0
        m.seat[bank, _JUDGED] = m.seat[bank, _VISITED] = 0.0
    m.stretch[bank] = 0.0
    m.stretch[bank, 0] = kind
    m.heavy[bank, 0] = m.heavy[bank, 1] = np.nan


@inlined
def _forget_earlier(m: ValveMemory, bank: int, spread: float) -> None:
    """Pool visits from the newest on, if it loses clearly and those before it do not."""
    rate, error = _rate(m.newest[bank, _VISIT], (0.0, 0.0), spread)
    newest = (-m.newest[bank, _VISIT, 0], -m.newest[bank, _VISIT, 1])
    if rate > SURELY * error and _rate(m.pooled[bank, _VISIT], newest, spread)[0] < _TIGHT * rate:
        m.pooled[bank, _VISIT, 0], m.pooled[bank, _VISIT, 1] = -newest[0], -newest[1]
        m.seat[bank, _SINCE] = m.seat[bank, _VISITED]


@inlined
def _judge_size(m: ValveMemory, bank: int, rate: float, error: float, judged: np.ndarray) -> None:
    """Whether an outlet that is known not to be tight lets more or less through in a visit than in those before.

    The visit in which it was found does not count: it may have begun within it.
    """
    seat, square = m.seat[bank], error * error
    change = abs(rate - seat[_RATE])
    other = change > max(CHANGED * seat[_RATE], CHANGED_LOSS, SURELY * math.sqrt(square + seat[_SPREAD]))
    if other:
        judged[SEAT + bank], judged[SEAT + BANKS + bank] = seat[_VISITED], LETS_OTHER
        judged[AGREED + bank] = seat[_AGREED]
        m.pooled[bank, _VISIT, 0], m.pooled[bank, _VISIT, 1] = m.newest[bank, _VISIT, 0], m.newest[bank, _VISIT, 1]
    if other or np.isnan(seat[_RATE]):
        seat[_RATE], seat[_SPREAD] = rate, square
    else:
        part = seat[_SPREAD] / (seat[_SPREAD] + square)
        seat[_RATE], seat[_SPREAD] = seat[_RATE] + part * (rate - seat[_RATE]), (1.0 - part) * seat[_SPREAD]
    seat[_AGREED] = seat[_VISITED]


@inlined
def _judge_seat(m: ValveMemory, bank: int, spread: float, judged: np.ndarray) -> None:
    """Whether the outlet lets gas through, once it is known what the buffer loses behind the newest visit.

    It loses less before it, too: a leak of the buffer may just have ended.
    """
    none, still, seat = (0.0, 0.0), _open_stretch(m, bank), m.seat[bank]
    _forget_earlier(m, bank, spread)
    visits, visits_error = _rate(m.pooled[bank, _VISIT], none, spread)
    nobody, nobody_error = _rate(m.pooled[bank, _NOBODY], still, spread)
    newest, newest_error = _rate(m.newest[bank, _VISIT], none, spread)
    behind, behind_error = _rate(m.newest[bank, _NOBODY], still, spread)
    before, before_error = _rate(m.earlier[bank], none, spread)
    least = max(visits, LEAST_LOSS)
    if behind_error > least / _KNOWN:
        return
    seat[_JUDGED] = 1.0
    if seat[_LASTS] > 0.0 and newest < _TIGHT * least and newest_error < least / _KNOWN:
        m.pooled[bank, _VISIT] = 0.0
        seat[_LASTS] = seat[_SINCE] = seat[_SPREAD] = 0.0
        seat[_RATE] = np.nan
        return
    if seat[_LASTS] > 0.0 and newest_error < least / _KNOWN:
        _judge_size(m, bank, newest, newest_error, judged)
    clear = visits > max(LEAST_LOSS, SURELY * visits_error)
    more = visits - nobody > SURELY * math.hypot(visits_error, nobody_error)
    only = before_error < least / _KNOWN and max(before, behind) < _TIGHT * visits < newest
    if seat[_LASTS] == 0.0 and clear and more and only:
        seat[_LASTS], judged[SEAT + bank] = 1.0, seat[_SINCE]


@inlined
def _seems(m: ValveMemory, bank: int, spread: float) -> tuple[float, float]:
    """What the outlet seems to let through and its standard deviation [g/s]: in this visit, if that shows it clearly.

    The first visits that are pooled may have been before it did.
    """
    still = _open_stretch(m, bank) if m.stretch[bank, 0] == _VISIT else (0.0, 0.0)
    rate, error = _rate(m.newest[bank, _VISIT], still, spread)
    if rate > SURELY * error:
        return rate, error
    return _rate(m.pooled[bank, _VISIT], still, spread)


@inlined
def judge_seats(
    m: ValveMemory, values: np.ndarray, spread: tuple[float, float, float], noise: np.ndarray,
    grams: tuple[float, float, float], judged: np.ndarray,
) -> None:  # fmt: skip
    """Take a second; `spread` is of the buffers' pressures [bar], `noise` (BANKS,) of their thermometers [K]."""
    for b in range(BANKS):
        kind, warm = _kind(m, b), m.pressure[b] / m.kelvin[b] * noise[b]
        width = max(grams[b] * math.hypot(spread[b], warm), math.sqrt(m.heavy[b, 2]))
        untold = m.heard[b] + m.heard[BANKS + b] > 0.0 and m.shut[b] < CALM
        if kind != int(m.stretch[b, 0]) or m.stretch[b, 1] >= LONGEST or untold:
            _end_stretch(m, b, kind, width)
        m.pooled[b, _NOBODY, 0] *= 1.0 - 1.0 / REMEMBERED
        m.pooled[b, _NOBODY, 1] *= 1.0 - 1.0 / REMEMBERED
        m.stretch[b, 1] += 1.0
        m.seat[b, _AGREED] += 1.0
        for age in (_SINCE, _VISITED):
            if m.seat[b, age] > 0.0 or kind == _VISIT:
                m.seat[b, age] += 1.0
        read = values[len(TANKS) + b] + KELVIN
        another = not np.isnan(read) and read != m.heavy[b, 3]
        m.heavy[b, 3] = read if another else m.heavy[b, 3]
        if kind >= 0 and another and m.fresh[b] > 0.0:
            mass = values[b] * USUAL / read * grams[b]
            if abs(mass - m.heavy[b, 1]) > _JUMPS * width:
                m.stretch[b] = 0.0
                m.stretch[b, 0] = kind
            _take(m, b, mass)
        if kind == _NOBODY and m.seat[b, _JUDGED] == 0.0 and m.newest[b, _VISIT, 0] > 0.0:
            _judge_seat(m, b, width, judged)
        if m.seat[b, _LASTS] > 0.0 and np.isnan(judged[SEAT + BANKS + b]):
            judged[SEAT + BANKS + b] = 1.0
        judged[SEAT + 2 * BANKS + b], judged[SEAT + 3 * BANKS + b] = _seems(m, b, width)
