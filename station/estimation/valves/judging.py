"""Valves that stick and report what they are told: what flow meters and pressures say against them.

The station's balance needs no model of its flows.
"""

from __future__ import annotations

import numpy as np

from station.compiled import inlined, kernel
from station.estimation.valves.balance import judge_stretch
from station.estimation.valves.hearing import hear
from station.estimation.valves.memory import (
    BANKS,
    CLEAR,
    FIRST_VALVE,
    METERS,
    SWITCHES,
    WITHIN,
    ValveMemory,
)  # fmt: skip
from station.estimation.valves.meters import doubt_nothing, is_filled, is_right, judge_meters
from station.estimation.valves.seats import judge_seats
from station.estimation.valves.silence import note_flow
from station.estimation.valves.turns import judge_turns
from station.geometry import TANKS, VALVES, VEHICLE

_SURE = 0.5  # part of CLEAR by which means of readings differ surely, and a buffer lies below full [1]
_FULL = 1.0  # a buffer that is nearer to it is full: it cools, and gets little [bar]
_OVER = 10.0  # a reading of one that is full lies less above the pressure at which it is [bar]
_IN_VAIN = 2.0  # seconds in which nothing flows through an outlet told open before it counts as closed for now [s]


@inlined
def _fill_instead(
    m: ValveMemory, bank: int, values: np.ndarray, bars: float, full: tuple[float, float, float]
) -> None:  # fmt: skip
    """Let a buffer whose inlet is stuck open be filled instead of the fullest one above it that is told to be.

    Where their pressures can hardly be told from each other, or it is nearly full, nobody knows which of the two is.
    """
    fullest, most = -1, full[bank] if m.filled[bank] - full[bank] < _OVER else m.filled[bank]
    for b in range(BANKS):
        if b != bank and values[FIRST_VALVE + b] >= 0.5 and (fullest < 0 or m.smooth[b] > m.smooth[fullest]):
            fullest = b
    if fullest < 0 or m.smooth[bank] >= most - _FULL:
        return
    above = m.smooth[fullest] - m.smooth[bank]
    if above >= _SURE * bars and m.smooth[bank] < most - _SURE * bars:
        values[FIRST_VALVE + fullest], values[FIRST_VALVE + bank] = 0.0, 1.0
    elif above > -_SURE * bars:
        values[FIRST_VALVE + fullest] = values[FIRST_VALVE + bank] = np.nan


@inlined
def _close(m: ValveMemory, side: int, values: np.ndarray) -> None:
    """Let valves that let nothing through be told closed."""
    right = is_right(m, side) and (side == 0 or not is_filled(m))  # of another meter little is taken for nothing
    for v in range(BANKS * side, BANKS * (side + 1)):
        vain = (m.beside[v] >= 1.0 and m.gave[side, 0] <= SWITCHES) or (side == 1 and m.silent[v] >= _IN_VAIN)
        vain = vain and right and m.told[v] > 0.0 and m.again[side, 2] <= 1.0  # not of a source that holds its readings
        if vain and m.doubt[1] == 0.0 and not np.isnan(values[FIRST_VALVE + v]):
            values[FIRST_VALVE + v] = 0.0


@inlined
def _let_stuck(
    m: ValveMemory, side: int, values: np.ndarray, bars: float, full: tuple[float, float, float]
) -> None:  # fmt: skip
    """Let the valves of a side that are stuck be told as they are."""
    for b in range(BANKS):
        valve = BANKS * side + b
        if m.position[valve] < 0.0 and not np.isnan(values[FIRST_VALVE + valve]):
            values[FIRST_VALVE + valve] = 0.0
        elif m.position[valve] > 0.0 and side == 0:
            _fill_instead(m, b, values, bars, full)
        elif m.position[valve] > 0.0 and m.vehicle[0] >= 0.0 and not m.pressure[b] <= m.pressure[VEHICLE]:
            values[FIRST_VALVE + valve] = 1.0


@inlined
def _correct(m: ValveMemory, values: np.ndarray, bars: float, full: tuple[float, float, float]) -> None:
    """Let the valves be told as they are; of a side of which one was just found nothing is."""
    for side in range(2):
        if m.untold[side] > 0.0:
            m.untold[side] -= 1.0
            values[METERS + side] = np.nan
            values[FIRST_VALVE + BANKS * side : FIRST_VALVE + BANKS * (side + 1)] = np.nan
            continue
        _close(m, side, values)
        _let_stuck(m, side, values, bars, full)


@inlined
def _suppose_second(
    values: np.ndarray, noise: np.ndarray, full: tuple[float, float, float], pressures: np.ndarray, unknown: bool,
    m: ValveMemory,
) -> None:  # fmt: skip
    """A second of `suppose`; `unknown`: not all pressures are better known than by readings."""
    hear(m, values)
    for b in range(BANKS):
        m.smooth[b] = m.smooth[b] if np.isnan(pressures[b]) else pressures[b]
    bars = CLEAR * max(noise[0], noise[1], noise[2]) if unknown else 0.0
    _let_stuck(m, 0, values, bars, full)
    _let_stuck(m, 1, values, 0.0, full)


@kernel
def suppose(
    values: np.ndarray, noise: np.ndarray, full: tuple[float, float, float], pressures: np.ndarray, m: ValveMemory
) -> None:
    """Let `values`, as in `judge_valves`, tell valves as they were if they had been at `m.position` all the time.

    `pressures`: (seconds, 3) of the buffers as they are better known than by readings [bar]; NaN: they are not.
    """
    for row in range(len(values)):
        unknown = False
        for b in range(BANKS):
            unknown = unknown or np.isnan(pressures[row, b])
        _suppose_second(values[row], noise[row], full, pressures[row], unknown, m)


@kernel
def would_matter(
    values: np.ndarray, noise: np.ndarray, full: tuple[float, float, float], first: int, seconds: int, m: ValveMemory
) -> bool:
    """Whether valves at `m.position` all the time are not as `values` tell them in so many seconds from `first` on."""
    supposed, nothing, count = np.empty(values.shape[1]), np.full(BANKS, np.nan), 0
    for row in range(len(values)):
        supposed[:] = values[row]
        _suppose_second(supposed, noise[row], full, nothing, True, m)
        other = False
        for v in range(FIRST_VALVE, FIRST_VALVE + len(VALVES)):
            told = values[row, v]
            other = other or (supposed[v] != told and not (np.isnan(supposed[v]) and np.isnan(told)))
        count += 1 if other and row >= first else 0
        if count >= seconds:
            return True
    return False


@kernel
def judge_valves(
    values: np.ndarray, noise: np.ndarray, grams: tuple[float, float, float], full: tuple[float, float, float],
    m: ValveMemory, judged: np.ndarray,
) -> None:  # fmt: skip
    """Judge the valves of seconds one after the other, and let `values` tell them as they are.

    Parameters
    ----------
    values
        (seconds, len(SENSORS)) the readings; those of valves are changed.
    noise
        (seconds, len(ANALOG)) their standard deviations.
    grams
        Of a bar in each buffer [g/bar].
    full
        The pressures below which buffers lie that are filled [bar].
    m
        What is remembered.
    judged
        (seconds, STUCK) is filled.
    """
    for row in range(len(values)):
        judged[row, len(VALVES) :] = np.nan
        m.doubt[0], m.doubt[1] = m.doubt[0] * (1.0 - 1.0 / WITHIN), max(m.doubt[1] - 1.0, 0.0)
        hear(m, values[row])
        spread = (
            max(noise[row, 0], np.sqrt(m.rough[0, 2])), max(noise[row, 1], np.sqrt(m.rough[1, 2])),
            max(noise[row, 2], np.sqrt(m.rough[2, 2])),
        )  # fmt: skip
        bars = CLEAR * max(spread)
        judge_meters(m, values[row], noise[row, METERS : METERS + 2], judged[row])
        for side in range(2):
            read = values[row, METERS + side]
            note_flow(m, side, read, noise[row, METERS + side], bars, grams, judged[row])
        judge_turns(m, values[row], judged[row])
        judge_stretch(m, values[row], spread, grams, judged[row])
        judge_seats(m, values[row], spread, noise[row, len(TANKS) : len(TANKS) + BANKS], grams, judged[row])
        for valve in range(len(VALVES)):
            judged[row, valve] = m.position[valve]
        doubt_nothing(m, values[row])
        _correct(m, values[row], bars, full)
