"""The kernel of detection: second by second, whether something is found wrong; see `station.estimation.detection`."""

from __future__ import annotations

import numpy as np

from station.compiled import inlined, kernel
from station.estimation.detection_causes import (
    hold_back,
    judge_line,
    judge_outlets,
    mute_hidden,
    net_loss,
    note_drifts,
    note_meters,
    note_stuck,
)
from station.estimation.detection_memory import (
    ABSENCES,
    ABSENT,
    AFTER_SENSORS,
    BEGINS,
    CHANNELS,
    CLOGS,
    FACTOR_LIMIT,
    FACTOR_NOTHING,
    FIRST_METER,
    FREEZES,
    FROZEN,
    HEALTH,
    HOLD,
    INLETS,
    LEAK_LIMIT,
    LEAK_NOTHING,
    NOISES,
    NOISY_LIMIT,
    NOISY_NOTHING,
    NOISY_WINDOW,
    OFFSET_WINDOW,
    OFFSETS,
    OTHER_SIGN,
    OUTLETS,
    PRECOOLER,
    REACTS,
    SELDOM,
    SETTLING,
    SIGNIFICANT,
    SMOOTHED,
    SMOOTHED_NOTHING,
    STICKS,
    WARMER,
    WARMER_LIMIT,
    WARMER_NOTHING,
    WARMER_SIGNIFICANT,
    DriftArrays,
    Memory,
    note_found,
    note_lasting,
    note_size,
    spell,
)
from station.estimation.interface import LEAK, MV
from station.estimation.resting import RUN, is_last, is_resting, note_innovation, note_reading
from station.geometry import BUFFERS, TANKS, VEHICLE
from station.sensor_names import HEARD


@inlined
def _failed(m: Memory, c: int) -> bool:
    """Whether a channel was told to be off lately, or is to be frozen or absent."""
    return m.second[0] - m.seen[OFFSETS + c] <= AFTER_SENSORS or m.told[FREEZES + c] + m.told[ABSENCES + c] > 0.0


@inlined
def _smooth_leak(m: Memory, k: int, value: float) -> None:
    """Smooth the estimate of a leak.

    Not where a sensor of the buffer failed: the model knows less well what it would read, or comes to believe it.
    """
    if m.second[0] < SETTLING or _failed(m, k) or _failed(m, len(TANKS) + k):
        m.smoothed[k] = 0.0
    else:
        m.smoothed[k] += (value - m.smoothed[k]) / SMOOTHED


@inlined
def _judge_small_leaks(
    m: Memory, states: np.ndarray, limits: np.ndarray, scale: float, begins: np.ndarray, firsts: np.ndarray
) -> None:  # fmt: skip
    """What a station whose parameters are known well lets one see of leaks; gas that another seems to gain is none."""
    for k in range(len(BUFFERS)):
        _smooth_leak(m, k, states[LEAK + k])
    for k in range(len(BUFFERS)):
        net = m.smoothed[k]
        for j in range(len(BUFFERS)):
            net += min(0.0, m.smoothed[j] + scale * SMOOTHED_NOTHING) if j != k else 0.0
        if net > limits[k]:
            spell(m, k, m.quiet[k], max(states[LEAK + k], m.smoothed[k]), begins, firsts)


@inlined
def _goes_on(m: Memory, values: np.ndarray, connected: bool, clear: bool) -> bool:
    """Whether a dispenser that seems to give too little has done so for CLOGS seconds of use, as far as that is told.

    What it gave in a second in which nobody told its valves misleads the filter for a few.
    """
    flow, silent = values[FIRST_METER + 1], np.isnan(values[FIRST_METER + 1])
    used = flow > 0.0
    for outlet in range(OUTLETS, OUTLETS + len(BUFFERS)):
        used, silent = used or values[outlet] >= 0.5, silent and np.isnan(values[outlet])
    if not clear:
        m.clogs[0] = 0.0
    elif used or (silent and connected):
        m.clogs[0] += 1.0
    return bool(m.clogs[0] >= CLOGS)


@inlined
def _judge_health(
    m: Memory, values: np.ndarray, states: np.ndarray, deviations: np.ndarray, small_leak: np.ndarray, scale: float,
    begins: np.ndarray, firsts: np.ndarray, sizes: np.ndarray,
) -> None:  # fmt: skip
    """Leaks, compressor and dispenser, from the filter's states."""
    _judge_small_leaks(m, states, small_leak, scale, begins, firsts)
    for k in range(HEALTH):
        value, limit, nothing = states[LEAK + k], scale * LEAK_LIMIT, scale * LEAK_NOTHING
        if k < HEALTH - 2 and np.isfinite(small_leak[k]):
            limit = max(limit, small_leak[k])
        if k >= HEALTH - 2:
            value, limit, nothing = 1.0 - value, 1.0 - FACTOR_LIMIT, FACTOR_NOTHING
        net = value if k >= HEALTH - 2 else net_loss(states, k, scale)
        sizes[k] = value
        clear = m.second[0] >= SETTLING and net > limit and value > SIGNIFICANT * deviations[LEAK + k]
        if k == HEALTH - 1:
            clear = _goes_on(m, values, not np.isnan(states[MV]), clear)
        if clear:
            spell(m, k, m.quiet[k], value, begins, firsts)
        note_size(m, k, value, clear, scale, begins, firsts)
        if value <= nothing:
            m.quiet[k] = m.second[0]


@inlined
def _judge_precooler(
    m: Memory, states: np.ndarray, deviations: np.ndarray, begins: np.ndarray, firsts: np.ndarray, sizes: np.ndarray
) -> None:
    """A precooler, where there is one, from the filter's state."""
    if m.seen.shape[0] > PRECOOLER:
        value = sizes[PRECOOLER] = states[WARMER]
        if m.second[0] >= SETTLING and value > WARMER_LIMIT and value > WARMER_SIGNIFICANT * deviations[WARMER]:
            spell(m, PRECOOLER, m.quiet[PRECOOLER], value, begins, firsts)
        if value <= WARMER_NOTHING:
            m.quiet[PRECOOLER] = m.second[0]


@inlined
def _note_machine(m: Memory, signal: int, place: int, used: bool) -> None:
    """A machine that was used for REACTS seconds with nothing of a signal did what it should when they began."""
    if m.quiet[signal] != m.second[0]:
        m.use[place, 1] = 0.0
    elif used:
        if m.use[place, 1] == 0.0:
            m.use[place, 0] = m.second[0]
        m.use[place, 1] += 1.0
        if m.use[place, 1] >= REACTS:
            m.right[signal], m.use[place, 1] = m.use[place, 0], 0.0


@inlined
def _note_machines(m: Memory, values: np.ndarray) -> None:
    """Note machines that are in use and seen to do what they should, after their states were judged.

    Where gas is precooled ramps hold the flow, and hide what a dispenser has lost.
    """
    if values[FIRST_METER] > 0.0:
        m.idle[0], m.idle[2] = 0.0, m.second[0]
    inlets = values[INLETS] >= 0.5 or values[INLETS + 1] >= 0.5 or values[INLETS + 2] >= 0.5
    outlets = values[OUTLETS] >= 0.5 or values[OUTLETS + 1] >= 0.5 or values[OUTLETS + 2] >= 0.5
    _note_machine(m, HEALTH - 2, 0, inlets)
    if m.seen.shape[0] > PRECOOLER:
        _note_machine(m, PRECOOLER, 2, outlets)
    else:
        _note_machine(m, HEALTH - 1, 1, outlets)


@inlined
def _judge_frozen(
    m: Memory, c: int, value: float, noise: float, begins: np.ndarray, firsts: np.ndarray
) -> bool:  # fmt: skip
    """Whether a channel's readings rest on one value, as a sensor's with noise do not; a flow of nothing is none."""
    if np.isnan(value):
        return False
    if note_reading(m.runs, c, value):
        m.run_begin[c], m.right[FREEZES + c], m.told[FREEZES + c] = m.second[0], m.spoke[c], 0.0
    m.spoke[c] = m.second[0]
    resting = is_resting(m.runs, c, noise)
    if resting and m.runs[c, RUN] >= FROZEN and m.told[FREEZES + c] == 0.0:
        begins[FREEZES + c], firsts[FREEZES + c] = m.run_begin[c], value
        m.told[FREEZES + c] = 1.0
    return resting


@inlined
def _reads_nothing(m: Memory, value: float, beyond: bool, begins: np.ndarray, firsts: np.ndarray) -> bool:
    """Whether the compressors' meter tells no flow, to the last digit, where one is expected; for FROZEN it is frozen.

    One that tells a flow meanwhile, in whatever second, is not. With an inlet that is stuck closed nobody knows whether
    one was to be expected. A dispenser's meter is judged by what it fills.
    """
    signal = FREEZES + FIRST_METER
    sticks = m.told[STICKS] > 0.0 or m.told[STICKS + 1] > 0.0 or m.told[STICKS + 2] > 0.0
    if value != 0.0 or not beyond or sticks:
        m.idle[0] = 0.0
        return False
    if m.idle[0] == 0.0:
        m.idle[1] = m.second[0]
    m.idle[0] += 1.0
    if m.idle[0] >= FROZEN and m.told[signal] == 0.0:
        begins[signal], firsts[signal], m.right[signal], m.told[signal] = m.idle[1], 0.0, m.idle[2], 1.0
    return True


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
    elif m.above[c] + m.below[c] <= 1.0:
        m.right[OFFSETS + c] = m.second[0]
    many = 2.0 * (m.above[c] + m.below[c]) > OFFSET_WINDOW and min(m.above[c], m.below[c]) <= OTHER_SIGN
    if m.second[0] < SETTLING or not many:
        return
    total, begin = 0.0, m.second[0]
    for k in range(OFFSET_WINDOW):
        total += m.beyond[k, c]
        if m.beyond[k, c] != 0.0 and m.second[0] - BEGINS <= m.beyond_second[k, c] < begin:
            begin = m.beyond_second[k, c]
    spell(m, OFFSETS + c, begin, total / (m.above[c] + m.below[c]), begins, firsts)


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
    limit = NOISY_LIMIT if m.told[signal] == 0.0 else NOISY_NOTHING
    if m.second[0] >= SETTLING and mean > limit**2:
        if m.told[signal] == 0.0:
            begins[signal], firsts[signal], m.told[signal] = m.quiet[signal], expected * (mean - 1.0), 1.0
        m.seen[signal] = m.changes[c]  # by readings: a vehicle's sensor does not recover between two vehicles
    elif m.changes[c] - m.seen[signal] > HOLD:
        m.told[signal] = 0.0
    if mean <= NOISY_NOTHING**2:
        m.quiet[signal] = m.second[0]


@inlined
def _judge_absent(m: Memory, k: int, value: float, begins: np.ndarray, firsts: np.ndarray) -> None:
    """A sensor that had to speak in this second."""
    m.counted[k] += 1.0
    if not np.isnan(value):
        m.readings[k] += 1.0
        m.silent[k] = m.told[ABSENCES + k] = 0.0
        m.right[ABSENCES + k] = m.second[0]
        return
    if m.silent[k] == 0.0:
        m.silent_begin[k] = m.second[0]
    m.silent[k] += 1.0
    usual = (m.counted[k] - m.silent[k]) / max(m.readings[k], 1.0)
    if m.told[ABSENCES + k] == 0.0 and m.silent[k] >= max(ABSENT, SELDOM * usual):
        begins[ABSENCES + k], firsts[ABSENCES + k] = m.silent_begin[k], m.silent[k]
        m.told[ABSENCES + k] = 1.0


@inlined
def _tell_right(m: Memory, begins: np.ndarray, rights: np.ndarray) -> None:
    """Of what is found, when it was last seen that there was nothing of it."""
    for k in range(m.seen.shape[0]):
        if not np.isnan(begins[k]):
            rights[k] = m.right[k]


@kernel
def scan(
    values: np.ndarray, noise: np.ndarray, innovations: np.ndarray, errors: np.ndarray, states: np.ndarray,
    deviations: np.ndarray, measured: np.ndarray, mute: np.ndarray, gate: float,
    small_leak: np.ndarray, scale: float, drifts: DriftArrays, stuck: np.ndarray, m: Memory, begins: np.ndarray,
    firsts: np.ndarray, rights: np.ndarray, sizes: np.ndarray, lasting: np.ndarray,
) -> None:  # fmt: skip
    """Judge seconds one after the other; arrays that are filled have NaN in them.

    `begins` (rows, signals) has the second in which something began where it is found, `firsts` how large it seems
    there, `rights` the last second in which it was seen that there was nothing of it; `sizes` (rows, signals) is what
    its size is told from later; `lasting` (rows, signals) says what lasts after each second. `noise` (rows, CHANNELS)
    is that of the tags; `measured` (HEARD,): 1 where a sensor has a tag; `mute` is that of `mute_hidden`;
    `small_leak` (buffers,) [g/s]: beyond it the smoothed estimate of a leak tells one; infinite where the station's
    parameters are not known so well. `scale` multiplies the limits of leaks. `drifts` are the arrays of `Drifts`, and
    `stuck` (rows, STUCK) is of valves: of no second where none are looked for.
    """
    for row in range(len(values)):
        begin, first, size = begins[row], firsts[row], sizes[row]
        _judge_health(m, values[row], states[row], deviations[row], small_leak, scale, begin, first, size)
        _judge_precooler(m, states[row], deviations[row], begin, first, size)
        _note_machines(m, values[row])
        note_stuck(m, row, stuck, begin, first)
        note_drifts(m, row, states[row], drifts, small_leak, scale, begin, first, size)
        note_found(m, begin)
        mute_hidden(m, mute, begin)  # what a bank seems to lose of which little is known is not laid to the line
        judge_line(m, values[row], states[row], scale, begin, first)
        note_meters(m, row, stuck, begin, first, size)
        judge_outlets(m, row, values[row], states[row], scale, stuck, begin, first, size)
        note_found(m, begin)
        connected = not np.isnan(states[row, MV])
        compresses = values[row, INLETS] >= 0.5 or values[row, INLETS + 1] >= 0.5 or values[row, INLETS + 2] >= 0.5
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
            if c == FIRST_METER and compresses:
                rests = _reads_nothing(m, value, abs(normal) > gate, begin, first) or rests
            _judge_noise(m, c, normal, error, gate, begin, first, size)
            if not rests and m.told[NOISES + c] == 0.0:
                _judge_offset(m, c, normal, error, gate, begin, first, size)
        hold_back(m, begin)
        mute_hidden(m, mute, begin)
        _tell_right(m, begin, rights[row])
        m.second[0] += 1.0
        note_lasting(m, lasting[row])
