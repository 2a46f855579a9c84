"""The kernel of detection: second by second, whether something is found wrong; see `station.estimation.detection`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from station.compiled import inlined, kernel
from station.estimation.interface import LEAK, MV, SHARED_STATES
from station.estimation.resting import RUN, is_last, is_resting, note_innovation, note_reading, runs_of_nothing
from station.geometry import BUFFERS, VALVES, VEHICLE
from station.sensor_names import ANALOG, BANK_SENSORS, HEARD

LEAK_LIMIT = 0.15
"""A buffer that loses so much leaks [g/s]."""

SHARP_LEAK = 0.12
"""One does whose pressures fall below the model's, at a calibrated station, if it also loses so much [g/s]."""

SMOOTHED = 600.0
"""Time over which the estimate of a leak is smoothed at a calibrated station [s]."""

FACTOR_LIMIT = 0.9
"""A compressor that gives less than this part of what it should is weak, a dispenser clogged [1]."""

WARMER_LIMIT = 2.5
"""A precooler by so much warmer than it should be is weak [K]."""

SIGNIFICANT = 4.0
"""By so many standard deviations a state must be off as well."""

FROZEN = 60
"""A sensor that reads one value to the last digit so often in a row is frozen."""

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

LINE_HOLD = 14_400.0
"""A leak of the line lasts until it was not seen for so long [s]: it is seen with vehicles alone."""

AFTER_VALVES = 600.0
"""Until so long after a valve was found to stick, to be open while told to be closed, or to work again, nothing is told
that this may have caused [s]."""

LEAK_NOTHING, FACTOR_NOTHING = 0.03, 0.02
"""An event begins where a state was last so small, and has passed where it is again [g/s, 1]."""

_WARMER_NOTHING = 1.0  # [K]
_NOISY_NOTHING = 1.2  # and where the noise was [1]
_BEGINS = 120  # an offset's first reading beyond the gate is looked for so far back [s]

HEALTH = len(BUFFERS) + 2
CHANNELS = len(ANALOG)
OFFSETS, NOISES, FREEZES, ABSENCES = (HEALTH + k * CHANNELS for k in range(4))
SIZED = FREEZES  # signals whose size is told from the seconds after they were found
DRIFTS = ABSENCES + HEARD
STICKS = DRIFTS + len(BANK_SENSORS)
LINE = STICKS + len(VALVES)
SIGNALS = LINE + 1
PRECOOLER = SIGNALS  # of a plant that precools, one signal more: of the first estimate behind SHARED_STATES
_WARMER = len(SHARED_STATES)


_OUTLETS = len(ANALOG) + VALVES.index("outlet_high")
_Drifts = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


class Memory(NamedTuple):
    """Memory of the seconds so far; all float64, counts too."""

    second: np.ndarray  # (1,) seconds so far
    moved: np.ndarray  # (1,) the last in which a valve began or ceased to stick, or was stuck open
    seen: np.ndarray  # (signals,) the second in which a signal was last seen, of noise the reading
    quiet: np.ndarray  # (signals,) the last in which there was nothing of it
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
    silent: np.ndarray  # (HEARD,) since when it does not, in such seconds
    silent_begin: np.ndarray  # (HEARD,)


def memory(signals: int = SIGNALS) -> Memory:
    """Of no second."""
    c, none = CHANNELS, np.nan
    return Memory._make((
        np.zeros(1), np.full(1, -1e9), np.full(signals, -1e9), np.zeros(signals), np.zeros(signals),
        runs_of_nothing(c), np.zeros(c), np.zeros((OFFSET_WINDOW, c)), np.zeros((OFFSET_WINDOW, c)),
        *(np.zeros(c) for _ in range(3)), np.full(c, none), np.full(c, none), np.zeros((NOISY_WINDOW, c)),
        np.zeros(c), np.zeros(c), *(np.zeros(HEARD) for _ in range(2)), np.zeros(len(BUFFERS)),
        np.full(len(BUFFERS), 1e9), np.full((len(BUFFERS), 4), -1e9),
        *(np.zeros(HEARD) for _ in range(2)),
    ))  # fmt: skip


@inlined
def _spell(m: Memory, signal: int, begin: float, first: float, begins: np.ndarray, firsts: np.ndarray) -> None:
    """A signal is seen in this second; a new event unless it was seen within HOLD."""
    second = m.second[0]
    if second - m.seen[signal] > HOLD:
        begins[signal], firsts[signal] = begin, first
    m.seen[signal] = second


@inlined
def _judge_small_leak(
    m: Memory, k: int, value: float, limit: float, begins: np.ndarray, firsts: np.ndarray
) -> None:  # fmt: skip
    """What a station whose parameters are known well lets one see of a leak."""
    if m.second[0] < SETTLING:
        return
    m.smoothed[k] += (value - m.smoothed[k]) / SMOOTHED
    if m.smoothed[k] > limit:
        _spell(m, k, m.quiet[k], max(value, m.smoothed[k]), begins, firsts)


@inlined
def _judge_health(
    m: Memory, states: np.ndarray, deviations: np.ndarray, small_leak: np.ndarray, scale: float, begins: np.ndarray,
    firsts: np.ndarray, sizes: np.ndarray,
) -> None:  # fmt: skip
    """Leaks, compressor and dispenser, from the filter's states."""
    for k in range(HEALTH - 2):
        _judge_small_leak(m, k, states[LEAK + k], small_leak[k], begins, firsts)
    for k in range(HEALTH):
        value, limit, nothing = states[LEAK + k], scale * LEAK_LIMIT, scale * LEAK_NOTHING
        if k < HEALTH - 2 and np.isfinite(small_leak[k]):
            limit = max(limit, small_leak[k])
        if k >= HEALTH - 2:
            value, limit, nothing = 1.0 - value, 1.0 - FACTOR_LIMIT, FACTOR_NOTHING
        sizes[k] = value
        if m.second[0] >= SETTLING and value > limit and value > SIGNIFICANT * deviations[LEAK + k]:
            _spell(m, k, m.quiet[k], value, begins, firsts)
        if value <= nothing:
            m.quiet[k] = m.second[0]
    if m.seen.shape[0] > PRECOOLER:
        value = sizes[PRECOOLER] = states[_WARMER]
        if m.second[0] >= SETTLING and value > WARMER_LIMIT and value > SIGNIFICANT * deviations[_WARMER]:
            _spell(m, PRECOOLER, m.quiet[PRECOOLER], value, begins, firsts)
        if value <= _WARMER_NOTHING:
            m.quiet[PRECOOLER] = m.second[0]


@inlined
def _judge_frozen(
    m: Memory, c: int, value: float, noise: float, begins: np.ndarray, firsts: np.ndarray
) -> bool:  # fmt: skip
    """Whether a channel's readings rest on one value, as a sensor's with noise do not; a flow of nothing is none."""
    if np.isnan(value):
        return False
    if note_reading(m.runs, c, value):
        m.run_begin[c], m.told[FREEZES + c] = m.second[0], 0.0
    resting = is_resting(m.runs, c, noise)
    if resting and m.runs[c, RUN] >= FROZEN and m.told[FREEZES + c] == 0.0:
        begins[FREEZES + c], firsts[FREEZES + c] = m.run_begin[c], value
        m.told[FREEZES + c] = 1.0
    return resting


@inlined
def _judge_offset(
    m: Memory, c: int, normal: float, error: float, gate: float, begins: np.ndarray, firsts: np.ndarray,
    sizes: np.ndarray,
) -> None:  # fmt: skip
    """Most readings beyond the gate, on one side."""
    place = int(m.beyond_place[c])
    m.above[c] -= 1.0 if m.beyond[place, c] > 0.0 else 0.0
    m.below[c] -= 1.0 if m.beyond[place, c] < 0.0 else 0.0
    m.beyond[place, c] = error if abs(normal) > gate else 0.0
    m.above[c] += 1.0 if m.beyond[place, c] > 0.0 else 0.0
    m.below[c] += 1.0 if m.beyond[place, c] < 0.0 else 0.0
    m.beyond_second[place, c] = m.second[0]
    m.beyond_place[c] = (place + 1) % OFFSET_WINDOW
    if abs(normal) > gate:
        sizes[OFFSETS + c] = error
    many = 2.0 * (m.above[c] + m.below[c]) > OFFSET_WINDOW and min(m.above[c], m.below[c]) <= OTHER_SIGN
    if m.second[0] < SETTLING or not many:
        return
    total, begin = 0.0, m.second[0]
    for k in range(OFFSET_WINDOW):
        total += m.beyond[k, c]
        if m.beyond[k, c] != 0.0 and m.second[0] - _BEGINS <= m.beyond_second[k, c] < begin:
            begin = m.beyond_second[k, c]
    _spell(m, OFFSETS + c, begin, total / (m.above[c] + m.below[c]), begins, firsts)


@inlined
def _judge_noise(
    m: Memory, c: int, normal: float, error: float, gate: float, begins: np.ndarray, firsts: np.ndarray,
    sizes: np.ndarray,
) -> None:  # fmt: skip
    """Changes from one innovation to the next, which neither an offset nor a drift makes large.

    A change counts at most as one at the gate, so that single outliers are no noise.
    """
    change = (normal - m.innovation[c]) ** 2 / 2.0
    expected = (error / normal) ** 2
    excess = (error - m.error[c]) ** 2 / 2.0 - expected
    m.innovation[c], m.error[c] = normal, error
    if np.isnan(change) or np.isnan(excess):
        return
    place = int(m.changes[c]) % NOISY_WINDOW
    m.change_sum[c] += min(change, gate**2) - m.change[place, c]
    m.change[place, c] = min(change, gate**2)
    m.changes[c] += 1.0
    sizes[NOISES + c] = excess
    if m.changes[c] < NOISY_WINDOW:
        return
    mean = m.change_sum[c] / NOISY_WINDOW
    signal = NOISES + c
    limit = NOISY_LIMIT if m.told[signal] == 0.0 else _NOISY_NOTHING
    if m.second[0] >= SETTLING and mean > limit**2:
        if m.told[signal] == 0.0:
            begins[signal], firsts[signal], m.told[signal] = m.quiet[signal], expected * (mean - 1.0), 1.0
        m.seen[signal] = m.changes[c]  # by readings: a vehicle's sensor does not recover between two vehicles
    elif m.changes[c] - m.seen[signal] > HOLD:
        m.told[signal] = 0.0
    if mean <= _NOISY_NOTHING**2:
        m.quiet[signal] = m.second[0]


@inlined
def _judge_absent(m: Memory, k: int, value: float, begins: np.ndarray, firsts: np.ndarray) -> None:
    """A sensor that had to speak in this second."""
    m.counted[k] += 1.0
    if not np.isnan(value):
        m.readings[k] += 1.0
        m.silent[k] = m.told[ABSENCES + k] = 0.0
        return
    if m.silent[k] == 0.0:
        m.silent_begin[k] = m.second[0]
    m.silent[k] += 1.0
    usual = (m.counted[k] - m.silent[k]) / max(m.readings[k], 1.0)
    if m.told[ABSENCES + k] == 0.0 and m.silent[k] >= max(ABSENT, SELDOM * usual):
        begins[ABSENCES + k], firsts[ABSENCES + k] = m.silent_begin[k], m.silent[k]
        m.told[ABSENCES + k] = 1.0


@kernel
def note_lasting(m: Memory, lasting: np.ndarray) -> None:
    """Fill in which events last after the newest second, `lasting` (signals,): by sight within HOLD, or still told."""
    second = m.second[0] - 1.0
    for k in range(m.seen.shape[0]):
        by_sight = k < NOISES or k >= PRECOOLER
        lasting[k] = second - m.seen[k] <= HOLD if by_sight else m.told[k] > 0.0
        if k < len(BUFFERS) and m.leaked[k, 3] > 0.0:
            lasting[k] = False


@inlined
def _note_drifts(
    m: Memory, row: int, states: np.ndarray, drifts: _Drifts, small_leak: np.ndarray, scale: float, begins: np.ndarray,
    firsts: np.ndarray, sizes: np.ndarray,
) -> None:  # fmt: skip
    """What sensors are off [bar], [K], as `station.estimation.drifting` has judged it, and buffers whose gas is lost.

    The size of a drift is of an hour. Where a buffer is seen to leak its pressure sensor is not said to drift.
    """
    biases, ago, lasts, falls = drifts
    if row >= len(biases):  # none are looked for
        return
    for k in range(falls.shape[1]):
        if (
            falls[row, k] > 0.0
            and states[LEAK + k] > max(scale * SHARP_LEAK, small_leak[k])
            and m.second[0] >= SETTLING
        ):
            _spell(m, k, m.quiet[k], states[LEAK + k], begins, firsts)
    for k in range(biases.shape[1]):
        signal = DRIFTS + k
        leaks = k < len(BUFFERS) and m.second[0] - m.seen[k] <= HOLD
        found = not np.isnan(ago[row, k]) and not leaks
        if found:
            m.quiet[signal] = m.second[0] - ago[row, k]
        m.told[signal] = lasts[row, k]
        if lasts[row, k] > 0.0:
            sizes[signal] = 3600.0 * biases[row, k] / max(m.second[0] - m.quiet[signal], 1.0)
        if found:
            begins[signal], firsts[signal] = m.quiet[signal], sizes[signal]


@inlined
def _note_stuck(m: Memory, row: int, stuck: np.ndarray, begins: np.ndarray, firsts: np.ndarray) -> None:
    """Valves that stick, as `station.estimation.valves` has judged it; the size is 1 of one that is open."""
    if row >= len(stuck):  # none are looked for
        return
    for k in range(len(VALVES)):
        position, ago = stuck[row, k], stuck[row, len(VALVES) + k]
        if not np.isnan(ago):
            begins[STICKS + k], firsts[STICKS + k] = m.second[0] - ago, 1.0 if position > 0.0 else 0.0
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
def _judge_line(
    m: Memory, values: np.ndarray, states: np.ndarray, scale: float, begins: np.ndarray, firsts: np.ndarray
) -> None:
    """Gas that the line loses is missed by the buffers that give, while they do."""
    for k in range(len(BUFFERS)):
        m.shut[k] = 0.0 if values[_OUTLETS + k] >= 0.5 else m.shut[k] + 1.0
        if states[LEAK + k] <= scale * LEAK_NOTHING:
            m.leaked[k, 3] = 0.0
        if not np.isnan(begins[k]) and m.shut[k] <= GAVE:
            _blame_line(m, k, begins, firsts)
    m.told[LINE] = 1.0 if m.second[0] - m.seen[LINE] <= LINE_HOLD else 0.0


@inlined
def _hold_back(m: Memory, begins: np.ndarray) -> None:
    """Tell nothing that a valve which sticks, or works again, may have caused; what lasts is told afterwards."""
    if m.second[0] - m.moved[0] > AFTER_VALVES:
        return
    for k in range(m.seen.shape[0]):
        caused = k < FREEZES or k >= LINE
        if caused and not np.isnan(begins[k]):
            begins[k], m.seen[k], m.told[k] = np.nan, -np.inf, 0.0


@inlined
def _mute(m: Memory, mute: np.ndarray, begins: np.ndarray) -> None:
    """Tell nothing that may come from a pressure which nobody measures."""
    for k in range(m.seen.shape[0]):
        if mute[k] != 0.0 and not np.isnan(begins[k]):
            begins[k], m.seen[k], m.told[k] = np.nan, -np.inf, 0.0


@kernel
def scan(
    values: np.ndarray, noise: np.ndarray, innovations: np.ndarray, errors: np.ndarray, states: np.ndarray,
    deviations: np.ndarray, measured: np.ndarray, mute: np.ndarray, gate: float,
    small_leak: np.ndarray, scale: float, drifts: _Drifts, stuck: np.ndarray, m: Memory, begins: np.ndarray,
    firsts: np.ndarray, sizes: np.ndarray, lasting: np.ndarray,
) -> None:  # fmt: skip
    """Judge seconds one after the other; arrays that are filled have NaN in them.

    `begins` (rows, signals) has the second in which something began where it is found, `firsts` how large it seems
    there; `sizes` (rows, signals) is what its size is told from later; `lasting` (rows, signals) says what lasts after
    each second. `noise` (rows, CHANNELS) is that of the tags; `measured` (HEARD,): 1 where a sensor has a tag;
    `mute` (signals,): 1 of what is not told;
    `small_leak` (buffers,) [g/s]: beyond it the smoothed estimate of a leak tells one; infinite where the station's
    parameters are not known so well. `scale` multiplies the limits of leaks. `drifts` are the arrays of `Drifts`, and
    `stuck` (rows, STUCK) is of valves: of no second where none are looked for.
    """
    for row in range(len(values)):
        begin, first, size = begins[row], firsts[row], sizes[row]
        _judge_health(m, states[row], deviations[row], small_leak, scale, begin, first, size)
        _note_stuck(m, row, stuck, begin, first)
        _note_drifts(m, row, states[row], drifts, small_leak, scale, begin, first, size)
        _judge_line(m, values[row], states[row], scale, begin, first)
        connected = not np.isnan(states[row, MV])
        for k in range(HEARD):
            of_vehicle = k in (VEHICLE, 4 + VEHICLE)
            if measured[k] != 0.0 and (connected or not of_vehicle):
                _judge_absent(m, k, values[row, k], begin, first)
        for c in range(CHANNELS):
            if measured[c] == 0.0:
                continue
            value = values[row, c]
            if c in (VEHICLE, 4 + VEHICLE) and not connected and not is_last(m.runs, c, value):
                value = np.nan  # without a vehicle a sensor may read what it likes, the same all the time
            rests = _judge_frozen(m, c, value, noise[row, c], begin, first)
            normal, error = innovations[row, c], errors[row, c]
            if np.isnan(normal):
                continue
            note_innovation(m.runs, c, normal, gate)
            _judge_noise(m, c, normal, error, gate, begin, first, size)
            if not rests and m.told[NOISES + c] == 0.0:
                _judge_offset(m, c, normal, error, gate, begin, first, size)
        _hold_back(m, begin)
        _mute(m, mute, begin)
        m.second[0] += 1.0
        note_lasting(m, lasting[row])
