"""The size of a leak of the line: what buffers gave, by the filter, less what the dispenser's meter counted. Kernels.

One that grows or shrinks is told again, by stretches in a row that all lose more, or less, than those before.

Gas is weighed over stretches, from an outlet that opens until all have been closed for a while. What meters and masses
seem to lose where nothing leaks is learned as a part of what was dispensed, with its spread, and taken off. A stretch
in which a meter was silent for long tells nothing.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from station.compiled import kernel
from station.estimation.detection_memory import CHANGED, SIGNIFICANT
from station.estimation.valves.memory import METERS
from station.geometry import BUFFERS, VALVES
from station.sensor_names import ANALOG

CLOSED, LONGEST = 15.0, 600.0
"""A stretch ends once all outlets have been closed for so long, or has lasted so long [s]."""

FEWEST = 30.0
"""Seconds in which an outlet was open of a stretch that tells what is lost [s]."""

UNLEARNED = 0.01
"""What meters and masses may seem to lose of what was dispensed, before that is learned; a standard deviation [1]."""

REMEMBERED = 20.0
"""Stretches over which that is learned [1]."""

AT_ONCE, ABOUT = 60.0, 30.0
"""A leak that seems to begin so shortly after an outlet opens was there before. What begins later does so at a time
that has a standard deviation [s]."""

LAGS = 20.0
"""Masses follow a leak: where a stretch begins or ends with an outlet open they are off by what so long loses [s]."""

SILENT = 10.0
"""Where a meter was not read for longer, though something may have flowed, a stretch tells nothing [s]."""

_INLETS = len(ANALOG)
_OUTLETS = len(ANALOG) + VALVES.index("outlet_high")
# Entries of `LineMemory`: of `stretch`, of `tight` ([g], [g], [1], [1], [s]), of `leak` and `other` ([s/g], [s2/g2]).
_STRETCH, _TIGHT = 10, 5
_LASTED, _SHUT, _OPEN, _BEGAN, _SQUARE, _COMPRESSED, _DISPENSED, _LEAKED, _VAGUE, _BLIND = range(_STRETCH)
_LOST, _GIVEN, _SQUARES, _COUNT, _AGO = range(_TIGHT)
_WEIGHED, _WEIGHT, _STRETCHES, _SINCE, _SAME = range(5)

_RATE, _DEVIATION, _TIGHT_AGO, _CHANGED_AGO, _SAME_AGO = range(5)
FOUND = 5
"""Columns of what is found in a second: the rate and its standard deviation where they are known [g/s]; how long ago
the last stretch began in which the line was tight; and where it is found to lose more or less than it did, how long ago
it began to, and the last stretch in which it did not yet [s]. NaN elsewhere."""

_AGAIN = 2.0  # stretches in a row that tell that a leak has another size [1]


class LineMemory(NamedTuple):
    """Memory of the balance of a line; all float64."""

    # How long the stretch has lasted, outlets have been closed, and were open [s]; the mass at its begin [g] and its
    # variance [g2], what was compressed and dispensed since [g]; 1 where the line is told to leak,
    # the standard deviation of the seconds for which it did [s], and 1 where a meter was silent.
    stretch: np.ndarray  # (10,); NaN where there is none
    opened: np.ndarray  # (LONGEST,) 1: in that second of the stretch an outlet was open
    read: np.ndarray  # (4,) last readings of both meters [g/s], what the buffers held [g] and its variance [g2]
    silent: np.ndarray  # (2,) for how long each meter was not read, while something may flow [s]
    tight: np.ndarray  # (5,) of stretches in which nothing leaked, newer ones counting more; and how long ago the last
    # one began
    leak: np.ndarray  # (2,) sum of the rates of stretches by their weights, which are inverse variances, and of these
    other: np.ndarray  # (5,) the same of the newest ones in a row, if all of them lost more than those, or less; how
    # many they are, below 0 of less; how long ago the first of them began, and how long ago the last one before


def line_of_nothing() -> LineMemory:
    """Of no second."""
    read = np.array([0.0, 0.0, np.nan, 0.0])
    tight = np.array([0.0, 0.0, 0.0, 0.0, np.nan])
    stretch = np.full(_STRETCH, np.nan)
    return LineMemory(stretch, np.zeros(int(LONGEST)), read, np.zeros(2), tight, np.zeros(2), np.zeros(5))


@kernel
def _note_tight(m: LineMemory, lost: float, dispensed: float) -> None:
    """Learn from a stretch in which nothing leaked."""
    tight, kept = m.tight, 1.0 - 1.0 / REMEMBERED
    if tight[_GIVEN] > 0.0:
        tight[_SQUARES] = kept * tight[_SQUARES] + (lost / dispensed - tight[_LOST] / tight[_GIVEN]) ** 2
    tight[_LOST] = kept * tight[_LOST] + lost
    tight[_GIVEN] = kept * tight[_GIVEN] + dispensed
    tight[_COUNT] = kept * tight[_COUNT] + 1.0


@kernel
def _side(m: LineMemory, rate: float, least: float) -> float:
    """1 of a rate that is larger than it was before, -1 of one that is smaller, else 0."""
    if m.leak[_WEIGHT] == 0.0:
        return 0.0
    usual = m.leak[_WEIGHED] / m.leak[_WEIGHT]
    off = rate - usual
    return math.copysign(1.0, off) if abs(off) > max(CHANGED * usual, least) else 0.0


@kernel
def _is_other(m: LineMemory, rate: float, weight: float, least: float) -> bool:
    """Whether the newest stretches tell surely that the line loses more, or less; and the last of them that it does."""
    before, now = m.leak[_WEIGHED] / m.leak[_WEIGHT], m.other[_WEIGHED] / m.other[_WEIGHT]
    sure = abs(now - before) > SIGNIFICANT * math.sqrt(1.0 / m.other[_WEIGHT] + 1.0 / m.leak[_WEIGHT])
    lasts = rate > max(least, SIGNIFICANT / math.sqrt(weight))
    return abs(m.other[_STRETCHES]) >= _AGAIN and sure and lasts


@kernel
def _take(m: LineMemory, rate: float, weight: float, least: float, found: np.ndarray) -> None:
    """Take a rate for the leak's, or for another size of it, which is told once stretches show it surely."""
    side, since = _side(m, rate, least), m.stretch[_LASTED]
    if side == 0.0 or side * m.other[_STRETCHES] < 0.0:  # those before were by chance
        m.leak[_WEIGHED] += m.other[_WEIGHED]
        m.leak[_WEIGHT] += m.other[_WEIGHT]
        m.other[_WEIGHED] = m.other[_WEIGHT] = m.other[_STRETCHES] = 0.0
    if side == 0.0:
        m.leak[_WEIGHED] += weight * rate
        m.leak[_WEIGHT] += weight
        m.other[_SAME] = since
        return
    m.other[_SINCE] = since if m.other[_STRETCHES] == 0.0 else m.other[_SINCE]
    m.other[_WEIGHED] += weight * rate
    m.other[_WEIGHT] += weight
    m.other[_STRETCHES] += side
    if _is_other(m, rate, weight, least):
        found[_CHANGED_AGO], found[_SAME_AGO] = m.other[_SINCE], m.other[_SAME]
        m.leak[_WEIGHED], m.leak[_WEIGHT] = weight * rate, weight  # it may have changed within those before
        m.other[_WEIGHED] = m.other[_WEIGHT] = m.other[_STRETCHES] = 0.0
        m.other[_SAME] = since


@kernel
def _note_leak(m: LineMemory, lost: float, least: float, found: np.ndarray) -> None:
    """Learn from a stretch in which the line leaked."""
    tight, stretch = m.tight, m.stretch
    usual = tight[_LOST] / tight[_GIVEN] if tight[_GIVEN] > 0.0 else 0.0
    spread = (UNLEARNED * UNLEARNED + tight[_SQUARES]) / max(tight[_COUNT], 1.0)
    rate = (lost - usual * stretch[_DISPENSED]) / stretch[_OPEN]
    square = stretch[_SQUARE] + m.read[3] + spread * stretch[_DISPENSED] ** 2 + (rate * stretch[_VAGUE]) ** 2
    _take(m, rate, stretch[_OPEN] ** 2 / square, least, found)


@kernel
def _end(m: LineMemory, besides: bool, least: float, found: np.ndarray) -> None:
    """Weigh what flowed in a stretch; `besides`: something else may have lost gas."""
    stretch = m.stretch
    lost = stretch[_BEGAN] - m.read[2] + stretch[_COMPRESSED] - stretch[_DISPENSED]
    stretch[_VAGUE] = math.hypot(stretch[_VAGUE], 0.0 if stretch[_SHUT] > 0.0 else LAGS)
    known = stretch[_BLIND] == 0.0 and not math.isnan(lost)
    if stretch[_OPEN] >= FEWEST and stretch[_DISPENSED] > 0.0 and known:
        if stretch[_LEAKED] > 0.0 and not (besides and m.leak[_WEIGHT] > 0.0):
            _note_leak(m, lost, least, found)
        elif stretch[_LEAKED] == 0.0 and not besides:
            _note_tight(m, lost, stretch[_DISPENSED])
            m.tight[_AGO] = stretch[_LASTED]
    cut = stretch[_SHUT] == 0.0
    stretch[:] = np.nan
    stretch[_SHUT] = 0.0 if cut else np.nan


@kernel
def _note_told(m: LineMemory, told: bool, ago: float) -> None:
    """The line is told to leak, and in the second in which that is found, since how many seconds."""
    stretch = m.stretch
    if not told:
        m.leak[:] = m.other[:] = 0.0
        return
    if math.isnan(ago) or math.isnan(stretch[_LASTED]):
        return
    within = stretch[_LASTED] - ago > AT_ONCE
    stretch[_LEAKED], stretch[_VAGUE] = 1.0, math.hypot(stretch[_VAGUE], ABOUT if within else AT_ONCE / math.sqrt(12.0))
    if within:
        stretch[_OPEN] = 0.0
        for second in range(int(stretch[_LASTED] - ago), int(stretch[_LASTED])):
            stretch[_OPEN] += m.opened[second]


@kernel
def _begin(m: LineMemory, told: bool) -> None:
    """Begin a stretch."""
    vague = LAGS if m.stretch[_SHUT] == 0.0 else 0.0  # the one before was cut
    m.stretch[:] = 0.0
    m.stretch[_VAGUE] = vague
    m.stretch[_BEGAN], m.stretch[_SQUARE], m.stretch[_LEAKED] = m.read[2], m.read[3], 1.0 if told else 0.0


@kernel
def _read(m: LineMemory, values: np.ndarray, states: np.ndarray, deviations: np.ndarray) -> None:
    """Take what meters read and buffers hold; a reading that is missing is as the one before."""
    for side in range(2):
        read = values[METERS + side]
        m.read[side] = m.read[side] if math.isnan(read) else read
        flows = m.read[side] > 0.0
        for v in range(len(BUFFERS)):
            flows = flows or values[_INLETS + len(BUFFERS) * side + v] >= 0.5
        m.silent[side] = m.silent[side] + 1.0 if flows and math.isnan(read) else 0.0
    m.read[2] = m.read[3] = 0.0
    for k in range(len(BUFFERS)):
        m.read[2] += states[k]
        m.read[3] += deviations[k] ** 2


@kernel
def balance_line(
    values: np.ndarray, states: np.ndarray, deviations: np.ndarray, told: np.ndarray, ago: np.ndarray,
    others: np.ndarray, m: LineMemory, found: np.ndarray, least: float,
) -> None:  # fmt: skip
    """Take seconds.

    Parameters
    ----------
    values
        As of `Frames`.
    states, deviations
        As of `Followed`.
    told
        (rows,) Whether the line is told to leak after each second.
    ago
        (rows,) Since how many seconds it does where that is found, else NaN.
    others
        (rows,) Whether anything else is told to leak or to be stuck.
    m
        Memory of the seconds before, which is advanced.
    found
        (rows, FOUND) NaN before; filled.
    least
        A leak that has grown or shrunk by less has not [g/s].
    """
    for row in range(len(values)):
        stretch, is_open = m.stretch, False
        m.tight[_AGO] += 1.0
        m.other[_SINCE] += 1.0
        m.other[_SAME] += 1.0
        for k in range(len(BUFFERS)):
            is_open = is_open or values[row, _OUTLETS + k] >= 0.5
        if math.isnan(stretch[_LASTED]) and is_open:
            _begin(m, told[row])
        _read(m, values[row], states[row], deviations[row])
        if not math.isnan(stretch[_LASTED]):
            m.opened[int(stretch[_LASTED])] = 1.0 if is_open else 0.0
            stretch[_LASTED] += 1.0
            stretch[_SHUT] = 0.0 if is_open else stretch[_SHUT] + 1.0
            stretch[_OPEN] += 1.0 if is_open else 0.0
            stretch[_COMPRESSED] += m.read[0]
            stretch[_DISPENSED] += m.read[1]
            if max(m.silent[0], m.silent[1]) > SILENT:
                stretch[_BLIND] = 1.0
        _note_told(m, told[row], ago[row])
        if stretch[_SHUT] >= CLOSED or stretch[_LASTED] >= LONGEST:  # of no stretch they are NaN
            _end(m, others[row], least, found[row])
        found[row, _TIGHT_AGO] = m.tight[_AGO]
        if m.leak[_WEIGHT] > 0.0:
            found[row, _RATE] = m.leak[_WEIGHED] / m.leak[_WEIGHT]
            found[row, _DEVIATION] = 1.0 / math.sqrt(m.leak[_WEIGHT])
