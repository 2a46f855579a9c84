"""Gains and losses of buffers under a command, against what flow meters count. Kernels.

Where a buffer loses, or gets, what a meter counts while its valve is told to be closed, it is open.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from station.compiled import inlined
from station.estimation.valves.memory import (
    BANKS,
    CLEAR,
    METERS,
    READINGS,
    ROOM,
    SWITCHES,
    USUAL,
    ValveMemory,
    alone,
    find_stuck,
    works_again,
)  # fmt: skip
from station.geometry import VEHICLE

SETTLES = 7.0
"""Seconds of a command that are not judged by pressures: a clock may be off, and lines fill [s]."""

SHARE = 0.3
"""A valve that is told to be closed moves at least this part of what the meter counts, if it is open [1]."""

BALANCE = 0.6
"""Gains and losses of all buffers differ by less than this part of the flow from what the meter counts [1]."""

LEAST, STEEP = 8.0, 0.1
"""It moves at least so much gas, as a change of pressure as well [g/s], [bar/s]: leaks and buffers that cool do not."""

_FALLS = 0.1  # part of the flow that a buffer which is filled must lose all in all, to be seen to give [1]
_GAVE = 0.8  # part of SHARE that an open valve moves beside what gas that cools or warms seems to lose or gain [1]
_MOST = 0.6  # part of what is compressed that surely is no leak [1]
_MOVED = 0.2  # part of what it would move that a valve moves at most which is closed [1]
_ALIKE = 10.0  # seconds in which one that was open must not have moved gas to be closed again [s]
_SOME = 4.0  # flow readings that a stretch needs [1]


class Stretch(NamedTuple):
    """Gas that flowed in the seconds of a command."""

    compressed: float  # by the meter of the compressors [g]
    dispensed: float  # and of the dispenser [g]
    lost: tuple[float, float, float]  # what each buffer gave, once it got what it was told to be given [g]
    moved: tuple[float, float, float]  # the same by what pressures would be at USUAL [g]
    clear: tuple[float, float, float]  # what is beyond the noise of its pressures [g]
    least: tuple[float, float, float]  # and beyond what leaks and heat make of it [g]
    steep: tuple[float, float, float]  # and heat alone [g]
    bars: float  # and of a pressure [bar]


@inlined
def _note_stretch(m: ValveMemory, values: np.ndarray) -> None:
    """Flows and pressures of a command that has lasted for a while."""
    for side in range(2):
        read = values[METERS + side]
        if not np.isnan(read):
            m.flow[side, 0] += read
            m.flow[side, 1] += 1.0
    for b in range(BANKS):
        if m.fresh[b] == 0.0:
            continue
        warmth = 1.0 if np.isnan(m.kelvin[b]) else USUAL / m.kelvin[b]  # a closed buffer that warms gains nothing
        if m.first[b, 1] < READINGS:
            m.first[b, 0] += values[b]
            m.first[b, 1] += 1.0
            m.first[b, 2] += values[b] * warmth
            continue
        place = int(m.last[b, READINGS]) % READINGS
        m.last[b, place], m.last[b, READINGS + 1 + place] = values[b], values[b] * warmth
        m.last[b, READINGS] += 1.0


@inlined
def _gained(m: ValveMemory, bank: int, grams: float, usual: bool) -> float:
    """Gas that a buffer has gained over the stretch by its pressures [g]; NaN where too few were read.

    `usual`: by what they would be at USUAL, of which a thermometer that errs may be wrong.
    """
    if m.first[bank, 1] < READINGS or m.last[bank, READINGS] < READINGS:
        return np.nan
    last = 0.0
    for k in range(READINGS):
        last += m.last[bank, (READINGS + 1 if usual else 0) + k]
    return (last - m.first[bank, 2 if usual else 0]) / READINGS * grams


@inlined
def _share(m: ValveMemory, bank: int) -> float:
    """The part that a buffer would give, were its outlet open beside those told to be [1]."""
    own, others = m.pressure[bank] - m.pressure[VEHICLE], 0.0
    for b in range(BANKS):
        if b != bank and m.told[BANKS + b] > 0.0:
            others += max(m.pressure[b] - m.pressure[VEHICLE], 0.0)
    return float(own / (own + others)) if own >= ROOM else 0.0


@inlined
def _note_working(m: ValveMemory, valve: int, works: bool) -> None:
    """A valve that was stuck open is right again once it has moved nothing for a while."""
    m.moved[valve] = m.moved[valve] + 1.0 if works else 0.0
    if m.moved[valve] >= _ALIKE:
        works_again(m, valve)


@inlined
def _judge_outlets(m: ValveMemory, s: Stretch, fed: int, judged: np.ndarray) -> None:
    """Whether a buffer gives whose outlet is told to be closed."""
    giving, total = alone(m, 1) - BANKS, 0.0
    if s.dispensed <= 0.0:
        return
    for b in range(BANKS):
        if b == giving or m.told[BANKS + b] == 0.0:
            total += max(s.lost[b], 0.0)
    for b in range(BANKS):
        valve = BANKS + b
        if m.told[valve] > 0.0 or m.heard[valve] > SWITCHES or np.isnan(s.lost[b]):
            continue
        balanced = abs(total - s.dispensed) < BALANCE * s.dispensed
        shows = _share(m, b) * s.dispensed > 2.0 * s.clear[b]
        little = max(_MOVED * _share(m, b) * s.dispensed, 0.5 * s.clear[b])
        is_closed = shows and abs(s.lost[b]) < little and not abs(s.moved[b]) > 1.5 * little
        if is_closed:
            m.works[valve, 1] = m.since[0]
        if m.position[valve] == 0.0:
            falls = fed != b or s.lost[b] - s.compressed > max(_FALLS * s.dispensed, s.clear[b])
            falls = falls and s.moved[b] > _GAVE * SHARE * s.dispensed
            if balanced and falls and s.lost[b] > max(SHARE * s.dispensed, s.clear[b], s.least[b]):
                find_stuck(m, valve, 1.0, m.since[0], judged)
        elif m.position[valve] > 0.0 and shows:
            _note_working(m, valve, is_closed)


@inlined
def _judge_inlets(m: ValveMemory, s: Stretch, judged: np.ndarray) -> None:
    """Whether a buffer is filled instead of the one that is told to be."""
    filled, emptied = int(m.inlet[0]), alone(m, 1) - BANKS
    if filled < 0 or s.compressed <= 0.0:
        return
    given = s.compressed + (s.dispensed if emptied == filled else 0.0)
    meant, warm = given - s.lost[filled], given - s.moved[filled]  # gas that is compressed warms what it fills
    for b in range(BANKS):
        if b in (filled, emptied) or m.heard[b] > SWITCHES or np.isnan(s.lost[b]) or np.isnan(meant):
            continue
        gained = -s.lost[b]
        shows = SHARE * s.compressed > s.clear[b] and _is_lower(m, b, filled, s.bars)
        is_closed = shows and meant > (1.0 - SHARE) * s.compressed and gained < _MOVED * s.compressed
        if is_closed:
            m.works[b, 1] = m.since[0]
        if m.position[b] == 0.0:
            error = min(abs(gained + meant - s.compressed), abs(warm - s.moved[b] - s.compressed))
            balanced = error < BALANCE * s.compressed
            missing = s.compressed - min(meant, warm) > max(SHARE * s.compressed, 0.5 * s.clear[filled])
            instead = missing and -s.moved[b] > _GAVE * SHARE * s.compressed
            instead = instead and m.pressure[b] - m.pressure[filled] < s.bars  # gas goes where less stands against it
            least = min(s.least[b], max(_MOST * s.compressed, s.steep[b]))
            if balanced and instead and gained > max(SHARE * s.compressed, s.clear[b], least):
                find_stuck(m, b, 1.0, m.since[0], judged)
        elif m.position[b] > 0.0 and shows:
            _note_working(m, b, is_closed)


@inlined
def _is_lower(m: ValveMemory, bank: int, filled: int, bars: float) -> bool:
    """Whether a buffer would be filled instead of the one that is told to be, were its inlet open."""
    return bool(m.pressure[filled] - m.pressure[bank] >= bars and m.pressure[bank] <= m.filled[bank] - bars)


@inlined
def _fed(m: ValveMemory, meant: int, bars: float) -> int:
    """The buffer that gets what is compressed: of those whose inlets are open the lowest; -1 where nobody knows."""
    fed = meant
    for b in range(BANKS):
        if meant < 0 or b == meant or m.position[b] <= 0.0:
            continue
        if fed < 0 or abs(m.pressure[b] - m.pressure[fed]) < bars:
            return -1
        fed = b if m.pressure[b] < m.pressure[fed] else fed
    return fed


@inlined
def _lost(
    m: ValveMemory, fed: int, compressed: float, grams: tuple[float, float, float], usual: bool
) -> tuple[float, float, float]:
    """Gas that each buffer gave, once it got what it was told to be given [g]; see `_gained`."""
    return (
        (compressed if fed == 0 else 0.0) - _gained(m, 0, grams[0], usual),
        (compressed if fed == 1 else 0.0) - _gained(m, 1, grams[1], usual),
        (compressed if fed == 2 else 0.0) - _gained(m, 2, grams[2], usual),
    )


@inlined
def judge_stretch(
    m: ValveMemory, values: np.ndarray, noise: tuple[float, float, float], grams: tuple[float, float, float],
    judged: np.ndarray,
) -> None:  # fmt: skip
    """Judge the seconds of a command that has lasted for a while by what buffers gained and lost in them."""
    if m.since[0] <= SETTLES:
        return
    _note_stretch(m, values)
    seconds = m.since[0] - SETTLES - READINGS
    if seconds < READINGS:
        return
    compressed = m.flow[0, 0] / m.flow[0, 1] * seconds if m.flow[0, 1] >= _SOME else 0.0
    dispensed = m.flow[1, 0] / m.flow[1, 1] * seconds if m.flow[1, 1] >= _SOME and m.vehicle[0] >= 0.0 else 0.0
    meant, width = int(m.inlet[0]), CLEAR * np.sqrt(2.0 / READINGS)
    lost, moved = _lost(m, meant, compressed, grams, False), _lost(m, meant, compressed, grams, True)
    clear = (width * noise[0] * grams[0], width * noise[1] * grams[1], width * noise[2] * grams[2])
    steep = (STEEP * grams[0] * seconds, STEEP * grams[1] * seconds, STEEP * grams[2] * seconds)
    least = (max(LEAST * seconds, steep[0]), max(LEAST * seconds, steep[1]), max(LEAST * seconds, steep[2]))
    bars = CLEAR * max(noise[0], noise[1], noise[2])
    before = m.untold[0]
    _judge_inlets(m, Stretch(compressed, dispensed, lost, moved, clear, least, steep, bars), judged)
    fed = _fed(m, meant, bars)
    if m.untold[0] != before or (fed < 0 <= meant):
        return  # gas that went elsewhere is missed where it was meant to go
    lost, moved = _lost(m, fed, compressed, grams, False), _lost(m, fed, compressed, grams, True)
    _judge_outlets(m, Stretch(compressed, dispensed, lost, moved, clear, least, steep, bars), fed, judged)
