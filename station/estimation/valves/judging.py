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

_IN_VAIN = 2.0  # seconds in which nothing flows through an outlet told open before it counts as closed for now [s]


@inlined
def _fill_instead(m: ValveMemory, bank: int, values: np.ndarray, bars: float) -> None:
    """Let a buffer whose inlet is stuck open be filled instead of the fullest one above it that is told to be.

    Where their pressures can hardly be told from each other, nor can which of the two is filled.
    """
    fullest = -1
    for b in range(BANKS):
        if b != bank and values[FIRST_VALVE + b] >= 0.5 and (fullest < 0 or m.pressure[b] > m.pressure[fullest]):
            fullest = b
    if fullest < 0:
        return
    above = m.pressure[fullest] - m.pressure[bank]
    if above >= bars:
        values[FIRST_VALVE + fullest], values[FIRST_VALVE + bank] = 0.0, 1.0
    elif above > -bars:
        values[FIRST_VALVE + fullest] = values[FIRST_VALVE + bank] = np.nan


@inlined
def _close(m: ValveMemory, side: int, values: np.ndarray) -> None:
    """Let valves that let nothing through be told closed."""
    right = is_right(m, side) and (side == 0 or not is_filled(m))  # of another meter little is taken for nothing
    for v in range(BANKS * side, BANKS * (side + 1)):
        vain = (m.beside[v] >= 1.0 and m.gave[side, 0] <= SWITCHES) or (side == 1 and m.silent[v] >= _IN_VAIN)
        vain = vain and right and m.told[v] > 0.0 and m.again[side, 2] <= 1.0  # not of a source that holds its readings
        if (m.position[v] < 0.0 or (vain and m.doubt[1] == 0.0)) and not np.isnan(values[FIRST_VALVE + v]):
            values[FIRST_VALVE + v] = 0.0


@inlined
def _correct(m: ValveMemory, values: np.ndarray, bars: float) -> None:
    """Let the valves be told as they are; of a side of which one was just found nothing is."""
    for side in range(2):
        if m.untold[side] > 0.0:
            m.untold[side] -= 1.0
            values[METERS + side] = np.nan
            values[FIRST_VALVE + BANKS * side : FIRST_VALVE + BANKS * (side + 1)] = np.nan
            continue
        _close(m, side, values)
        for b in range(BANKS):
            if side == 0 and m.position[b] > 0.0:
                _fill_instead(m, b, values, bars)
            connected = side == 1 and m.vehicle[0] >= 0.0 and not m.pressure[b] <= m.pressure[VEHICLE]
            if connected and m.position[BANKS + b] > 0.0:
                values[FIRST_VALVE + BANKS + b] = 1.0


@kernel
def judge_valves(
    values: np.ndarray, noise: np.ndarray, grams: tuple[float, float, float], m: ValveMemory, judged: np.ndarray
) -> None:
    """Judge the valves of seconds one after the other, and let `values` tell them as they are.

    Parameters
    ----------
    values
        (seconds, len(SENSORS)) the readings; those of valves are changed.
    noise
        (seconds, len(ANALOG)) their standard deviations.
    grams
        Of a bar in each buffer [g/bar].
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
        _correct(m, values[row], bars)
