"""Limits of detection in engineering units, its signals, and what it remembers from second to second."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from station.compiled import inlined, kernel
from station.estimation.interface import SHARED_STATES
from station.estimation.resting import runs_of_nothing
from station.geometry import BUFFERS, VALVES
from station.sensor_names import ANALOG, BANK_SENSORS, HEARD, METERS

LEAK_LIMIT = 0.15
"""A buffer that loses so much leaks [g/s]."""

SHARP_LEAK = 0.12
"""One does whose pressures fall below the model's, at a calibrated station, if it also loses so much [g/s]."""

SMOOTHED = 600.0
"""Time over which the estimate of a leak is smoothed at a calibrated station [s]."""

SMOOTHED_NOTHING = 0.01
"""A buffer gains that smoothed estimates say to gain more [g/s]."""

FACTOR_LIMIT = 0.9
"""A compressor that gives less than this part of what it should is weak, a dispenser clogged [1]."""

CLOGS = 10.0
"""For so long in use a dispenser must seem to give too little before it is clogged [s]."""

WARMER_LIMIT = 2.5
"""A precooler by so much warmer than it should be is weak [K]."""

SIGNIFICANT, WARMER_SIGNIFICANT = 4.0, 3.5
"""By so many standard deviations a state must be off as well; a healthy precooler's is by half as many at most."""

FROZEN = 60
"""A sensor that reads one value to the last digit so often in a row is frozen; so is the compressors' meter if it reads
no flow in so many seconds in which one was expected."""

OFFSET_WINDOW = 60
"""A sensor most of whose last readings, so many, lie beyond the filter's gate is off."""

OTHER_SIGN = 3
"""An offset has one sign: at most so many of these readings lie beyond the gate on the other side."""

NOISY_WINDOW = 300
"""Readings over which the noise of a sensor is judged."""

NOISY_LIMIT = 1.5
"""A sensor is noisy if its innovations vary so much from one to the next, as a standard deviation [1]."""

ABSENT = 120
"""A sensor that was silent for so long is absent [s], if it is not one that reads seldom."""

SELDOM = 10.0
"""A silence must be so many times the mean time between a sensor's readings before it."""

SETTLING = 600
"""Seconds from the beginning in which states of health are not judged: the filter still learns them."""

HOLD = 300
"""An event ends when it was not seen for so long [s], noise of a sensor when not for so many readings."""

GAVE, TOGETHER = 150.0, 900.0
"""A leak found so shortly after its buffer gave is the line's if another buffer's is as well within so long [s]."""

STAYS = 450.0
"""A leak that was laid to an outlet or the line is its buffer's if it is still seen so long behind a visit [s]."""

SHOWN = 60.0
"""What an outlet lets through shows as a leak of its buffer within so long of a visit [s]."""

LINE_HOLD = 14_400.0
"""A leak of the line lasts until it was not seen for so long [s]: it is seen with vehicles alone."""

AFTER_VALVES = 600.0
"""Until so long after a valve was found to stick, to be open while told to be closed, or to work again, nothing is told
that this may have caused [s]."""

AFTER_SENSORS = 14_400.0
"""Until so long after a buffer's sensor was off no small leak of it is told [s]."""

KNOWN_FROM, KNOWN_BY = 300.0, 600.0
"""The size of a leak or a weakness that lasts is the mean of its estimates between these, since it was found [s]."""

GROWS, SHRINKS = 60.0, 600.0
"""One is told again where it has been larger, or smaller, for so long [s]: one that ends is smaller for a while."""

CHANGED, CHANGED_LEAK, CHANGED_FACTOR = 0.3, 0.15, 0.1
"""By more than this part of its size, and by so much of a leak or of what a machine gives [1], [g/s], [1]."""

RISING = 30.0
"""An estimate leaves the size that was known so long behind the change [s]."""

REACTS = 15.0
"""A machine's factor, or what its precooler is warmer, shows a fault within so many seconds of its use."""

LEAK_NOTHING, FACTOR_NOTHING = 0.03, 0.02
"""An event begins where a state was last so small, and has passed where it is again [g/s, 1]."""

WARMER_NOTHING = 1.0  # [K]
NOISY_NOTHING = 1.2  # and where the noise was [1]
BEGINS = 120  # an offset's first reading beyond the gate is looked for so far back [s]

HEALTH = len(BUFFERS) + 2
CHANNELS = len(ANALOG)
OFFSETS, NOISES, FREEZES, ABSENCES = (HEALTH + k * CHANNELS for k in range(4))
SIZED = FREEZES  # signals whose size is told from the seconds after they were found
DRIFTS = ABSENCES + HEARD
STICKS = DRIFTS + len(BANK_SENSORS)
LINE = STICKS + len(VALVES)
METER_DRIFTS = LINE + 1
SEATS = METER_DRIFTS + len(METERS)
SIGNALS = SEATS + len(BUFFERS)
PRECOOLER = SIGNALS  # of a plant that precools, one signal more: of the first estimate behind SHARED_STATES
WARMER = len(SHARED_STATES)
FIRST_METER = CHANNELS - len(METERS)
INLETS, OUTLETS = len(ANALOG), len(ANALOG) + VALVES.index("outlet_high")

DriftArrays = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""Of `Drifts`: what sensors are off, how long ago that began, whether it lasts, and falls that are losses."""


class Memory(NamedTuple):
    """Memory of the seconds so far; all float64, counts too."""

    second: np.ndarray  # (1,) seconds so far
    moved: np.ndarray  # (1,) the last in which a valve began or ceased to stick, or was stuck open
    seen: np.ndarray  # (signals,) the second in which a signal was last seen, of noise the reading
    quiet: np.ndarray  # (signals,) the last in which there was nothing of it
    right: np.ndarray  # (signals,) the last in which it was seen that there was nothing of it: a machine works, say
    use: np.ndarray  # (3, 2) of compressor, dispenser, precooler: since when they are used with nothing of it, and for
    # how many seconds
    spoke: np.ndarray  # (CHANNELS,) the last in which a sensor was read
    idle: np.ndarray  # (3,) of the compressors' meter: seconds with an inlet open in which it told no flow against what
    # is expected, and since when; the last in which it told one
    told: np.ndarray  # (signals,) 1: noisy, frozen, absent
    runs: np.ndarray  # (CHANNELS, ENTRIES) of `station.estimation.resting`
    run_begin: np.ndarray  # (CHANNELS,) since which second the last reading is read
    beyond: np.ndarray  # (OFFSET_WINDOW, CHANNELS) errors of the last readings, 0 within the gate
    beyond_second: np.ndarray  # (OFFSET_WINDOW, CHANNELS)
    beyond_place: np.ndarray  # (CHANNELS,) the oldest of them
    above: np.ndarray  # (CHANNELS,) how many of them are above 0
    below: np.ndarray  # (CHANNELS,) and below
    innovation: np.ndarray  # (CHANNELS,) the last
    error: np.ndarray  # (CHANNELS,) the last
    change: np.ndarray  # (NOISY_WINDOW, CHANNELS) half the squares of the last changes of innovations, capped
    change_sum: np.ndarray  # (CHANNELS,) their sum
    changes: np.ndarray  # (CHANNELS,) how many there were
    counted: np.ndarray  # (HEARD,) seconds in which a sensor had to speak
    readings: np.ndarray  # (HEARD,) in which it did
    smoothed: np.ndarray  # (len(BUFFERS),) estimates of leaks [g/s]
    shut: np.ndarray  # (len(BUFFERS),) seconds since a buffer's outlet was open
    leaked: np.ndarray  # (len(BUFFERS), 4) of a leak found after a buffer gave: the second, its begin, its size [g/s],
    # and 1 while it is the line's
    visit: np.ndarray  # (3,) seconds of the newest vehicle's visit, since it, and 1 while it is connected
    opened: np.ndarray  # (len(BUFFERS),) of the visit those in which a buffer's outlet was open
    spelled: np.ndarray  # (len(BUFFERS), 4) of the newest leak found in or behind a visit with its outlet closed: the
    # second, its begin, its size [g/s], and 1 once nothing was lost without a vehicle
    known: np.ndarray  # (HEALTH, 4) of a leak or a weakness that lasts: its size, since when it was found [s], for how
    # long it has been larger, and smaller [s]
    clogs: np.ndarray  # (1,) seconds of use for which the dispenser has seemed to give too little
    silent: np.ndarray  # (HEARD,) since when it does not, in such seconds
    silent_begin: np.ndarray  # (HEARD,)


def memory(signals: int = SIGNALS) -> Memory:
    """Of no second."""
    c, none = CHANNELS, np.nan
    return Memory._make((
        np.zeros(1), np.full(1, -1e9), np.full(signals, -1e9), np.zeros(signals), np.full(signals, -np.inf),
        np.zeros((3, 2)), np.full(c, -np.inf), np.array([0.0, 0.0, -np.inf]), np.zeros(signals),
        runs_of_nothing(c), np.zeros(c), np.zeros((OFFSET_WINDOW, c)), np.zeros((OFFSET_WINDOW, c)),
        *(np.zeros(c) for _ in range(3)), np.full(c, none), np.full(c, none), np.zeros((NOISY_WINDOW, c)),
        np.zeros(c), np.zeros(c), *(np.zeros(HEARD) for _ in range(2)), np.zeros(len(BUFFERS)),
        np.full(len(BUFFERS), 1e9), np.full((len(BUFFERS), 4), -1e9), np.array([0.0, 1e9, 0.0]),
        np.zeros(len(BUFFERS)), np.array([[-1e9, 0.0, 0.0, 0.0]] * len(BUFFERS)),
        np.zeros((HEALTH, 4)), np.zeros(1), *(np.zeros(HEARD) for _ in range(2)),
    ))  # fmt: skip


@inlined
def spell(m: Memory, signal: int, begin: float, first: float, begins: np.ndarray, firsts: np.ndarray) -> None:
    """A signal is seen in this second; a new event unless it was seen within HOLD."""
    second = m.second[0]
    if second - m.seen[signal] > HOLD:
        begins[signal], firsts[signal] = begin, first
    m.seen[signal] = second


@inlined
def _learn_size(m: Memory, k: int, right: float) -> None:
    """Begin to learn the size of a leak or a weakness, of which there was last nothing in a second; -inf: unknown."""
    m.known[k, :] = 0.0
    m.known[k, 1], m.right[k] = m.second[0], right


@inlined
def note_found(m: Memory, begins: np.ndarray) -> None:
    """Begin to learn the size of a leak or a weakness that is found in this second, in whatever way."""
    for k in range(HEALTH):
        if not np.isnan(begins[k]) and m.known[k, 1] != m.second[0]:
            _learn_size(m, k, m.right[k] if k >= HEALTH - 2 else -np.inf)


@inlined
def note_size(
    m: Memory, k: int, value: float, clear: bool, scale: float, begins: np.ndarray, firsts: np.ndarray
) -> None:  # fmt: skip
    """Tell a leak or a weakness again whose size has changed while it lasts; `clear` where a limit is exceeded.

    Not while what a valve caused is held back, nor a buffer's while its outlet or the line is told to leak: one that
    lasts would be taken for one that is found then, and for what these lose.
    """
    known, second = m.known[k], m.second[0]
    besides = k < len(BUFFERS) and (m.told[LINE] > 0.0 or m.told[SEATS + k] > 0.0)
    if besides or not np.isnan(begins[k]) or second - m.seen[k] > HOLD:
        return
    age = second - known[1]
    if age < KNOWN_FROM:
        return
    if age < KNOWN_BY:
        known[0] += (value - known[0]) / (age - KNOWN_FROM + 1.0)
        return
    least = max(CHANGED * known[0], CHANGED_FACTOR if k >= HEALTH - 2 else scale * CHANGED_LEAK)
    larger, smaller = value - known[0] > least, known[0] - value > least
    known[2] = known[2] + 1.0 if larger and clear else 0.0
    known[3] = known[3] + 1.0 if smaller and clear else 0.0
    told = second - m.moved[0] > AFTER_VALVES
    if told and (known[2] >= GROWS or known[3] >= SHRINKS):
        begins[k], firsts[k] = second - max(known[2], known[3]) - RISING, value
        _learn_size(m, k, known[1] + KNOWN_FROM)


@kernel
def note_lasting(m: Memory, lasting: np.ndarray) -> None:
    """Fill in which events last after the newest second, `lasting` (signals,): by sight within HOLD, or still told."""
    second = m.second[0] - 1.0
    for k in range(m.seen.shape[0]):
        by_sight = k < NOISES or k >= PRECOOLER
        lasting[k] = second - m.seen[k] <= HOLD if by_sight else m.told[k] > 0.0
        if k < len(BUFFERS) and m.leaked[k, 3] > 0.0:
            lasting[k] = False
