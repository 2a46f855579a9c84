"""Readings equal to the last digit: of a source that holds them, or of a sensor that is stuck. Kernels for all.

A sensor with noise hardly reads one value twice. So a reading equal to the one before is heard no second time: many
sources tell the last one again until there is another. A sensor that reads in coarse steps, or without noise, does say
one value for long where nothing changes, and is heard each time. It is known by its readings before: their changes are
multiples of one step, most of their runs were long, or its innovations hardly spread. What lies between two steps is
noise that the tag does not tell.
"""

from __future__ import annotations

import numpy as np

from station.compiled import inlined, kernel
from station.sensor_names import ANALOG

RESTING = 10
"""So many equal readings in a row say nothing more: the sensor may be stuck."""

NOISELESS = 0.1
"""A sensor whose innovations spread no more has no noise [1]: at rest it says one value all the time."""

COARSE = 2.0
"""Steps of more than so many times a sensor's noise hide it: within one nothing is seen to move."""

_LIKELY = 3.0  # a sensor that reads in steps may rest so many times as long as it did before
_SHORTEST, _LONGEST_RUN = 0.3, 60.0  # steps that count, by the noise; runs before that tell how long it may rest
_SHOWN = 24.0  # runs of a reading or two before a sensor is known to have noise: a step would have shown
_STEPS, _OTHERS = 8.0, 0.1  # so many changes tell a step, if so few of them were no multiples of it
_MULTIPLE = 0.02  # of a step: so close to a multiple of it a change is one

_FEW_HELD, _MOSTLY = 8.0, 4.0  # readings told again that tell a source which holds them, and by those told once
_REGULAR, _FEW_BEYOND = 3.0, 0.05  # where so few were more times as long as most are, it does so for as long each time
_FEWEST = 10  # readings before anything is said of a sensor's noise
_FIRST_FLOW = ANALOG.index("flow_compressor")

# Entries of a channel: its last reading, how often in a row, runs before of at most two readings and of more; how many
# innovations lay within the gate, their mean, and the sum of the squares of their deviations from it; the step that its
# changes seem to be multiples of, how many were and how many were not; its longest run before;
# its last reading, a flow of nothing as well; how many readings a run has most often; for how many seconds it
# has told no flow; and how many runs there were of each length, the last for all that are longer.
_VALUE, RUN, _SHORT, _LONG, _WITHIN, _MEAN, _SQUARE, _STEP, _MULTIPLES, _OTHER, _LONGEST, _LAST = range(12)
_USUAL, _NO_FLOW, _OF_LENGTH = 12, 13, 14
_LENGTHS = 64
ENTRIES = _OF_LENGTH + _LENGTHS


def runs_of_nothing(channels: int) -> np.ndarray:
    """Of channels that have read nothing, (channels, ENTRIES)."""
    runs = np.zeros((channels, ENTRIES))
    runs[:, _VALUE] = runs[:, _LAST] = np.nan
    return runs


@inlined
def _note_step(runs: np.ndarray, c: int, change: float) -> None:
    """Note by how much a channel's reading changed; NaN for a first one."""
    if np.isnan(change):
        return
    if runs[c, _STEP] == 0.0:
        runs[c, _STEP] = change
    times = change / runs[c, _STEP]
    if times > 0.5 and abs(times - np.round(times)) <= _MULTIPLE:
        runs[c, _MULTIPLES] += 1.0
        return
    runs[c, _OTHER] += 1.0
    if runs[c, _OTHER] > 1.0 + _OTHERS * runs[c, _MULTIPLES]:
        runs[c, _STEP], runs[c, _MULTIPLES], runs[c, _OTHER] = min(change, runs[c, _STEP]), 0.0, 0.0


@inlined
def step_of(runs: np.ndarray, c: int, noise: float) -> float:
    """The step in which a channel reads, in its unit; 0 if it is none, or small beside its noise."""
    step = runs[c, _STEP]
    told = runs[c, _MULTIPLES] >= _STEPS and runs[c, _OTHER] <= _OTHERS * runs[c, _MULTIPLES]
    return float(step) if told and step > _SHORTEST * noise else 0.0


@inlined
def noise_between(step: float, noise: float) -> float:
    """The noise of a sensor that reads in steps: that of its tag, and what lies between two steps."""
    lost = step * step if step > COARSE * noise else step * step / 12.0
    return float(np.sqrt(noise * noise + lost)) if step > 0.0 else noise


@inlined
def _again(runs: np.ndarray, c: int) -> float:
    """How many of a channel's readings were told more than once."""
    return float(runs[c, _SHORT] + runs[c, _LONG] - runs[c, _OF_LENGTH])


@inlined
def is_held(runs: np.ndarray, c: int) -> bool:
    """Whether a channel's source tells its readings again until there is another one."""
    return bool(_again(runs, c) >= max(_FEW_HELD, _MOSTLY * runs[c, _OF_LENGTH]))


@inlined
def _note_run(runs: np.ndarray, c: int, length: int) -> None:
    """Note how many equal readings a channel gave before another one."""
    if length > 2:
        runs[c, _LONG] += 1.0
    else:
        runs[c, _SHORT] += 1.0
    place = min(length, _LENGTHS) - 1
    runs[c, _OF_LENGTH + place] += 1.0
    if runs[c, _USUAL] == 0.0 or runs[c, _OF_LENGTH + place] > runs[c, _OF_LENGTH + int(runs[c, _USUAL]) - 1]:
        runs[c, _USUAL] = place + 1.0


@inlined
def note_reading(runs: np.ndarray, c: int, value: float) -> bool:
    """Note a channel's reading of a second, NaN for none; whether it is another than the one before.

    A flow of nothing is no reading.
    """
    nothing = value == 0.0 or (np.isnan(value) and runs[c, _LAST] == 0.0)
    runs[c, _NO_FLOW] = runs[c, _NO_FLOW] + 1.0 if nothing else 0.0
    if np.isnan(value):
        return False
    runs[c, _LAST] = value
    if c >= _FIRST_FLOW and value == 0.0:
        return False
    if value == runs[c, _VALUE]:
        runs[c, RUN] += 1.0
        return False
    if runs[c, RUN] < _LONGEST_RUN * (runs[c, _USUAL] if is_held(runs, c) else 1.0):
        runs[c, _LONGEST] = max(runs[c, _LONGEST], runs[c, RUN])
    _note_step(runs, c, abs(value - runs[c, _VALUE]))
    if runs[c, RUN] > 0.0:
        _note_run(runs, c, int(runs[c, RUN]))
    runs[c, _VALUE], runs[c, RUN] = value, 1.0
    return True


@inlined
def is_last(runs: np.ndarray, c: int, value: float) -> bool:
    """Whether a channel's reading is the one noted last."""
    return bool(value == runs[c, _VALUE])


@inlined
def note_innovation(runs: np.ndarray, c: int, normal: float, gate: float) -> None:
    """Note what a channel's reading was off [standard deviations]; NaN for no reading."""
    if abs(normal) <= gate:
        runs[c, _WITHIN] += 1.0
        off = normal - runs[c, _MEAN]
        runs[c, _MEAN] += off / runs[c, _WITHIN]
        runs[c, _SQUARE] += off * (normal - runs[c, _MEAN])


@inlined
def _is_noiseless(runs: np.ndarray, c: int) -> bool:
    """Whether a channel's innovations hardly spread, of as many as it takes to say so."""
    return bool(runs[c, _WITHIN] >= _FEWEST and runs[c, _SQUARE] <= NOISELESS**2 * runs[c, _WITHIN])


@inlined
def says_again(runs: np.ndarray, c: int, value: float, step: float) -> bool:
    """Whether a reading, which is not noted yet, is the last one told again, and so says nothing.

    Of a source that holds readings of a sensor that reads in steps, another one may be equal: they come as far apart as
    they mostly do, as those of no flow do. A meter that holds none says so each time, once it is known to hold none.
    """
    if value != runs[c, _LAST]:
        return False
    if c >= _FIRST_FLOW and value == 0.0:
        if is_held(runs, c):
            return bool(runs[c, _NO_FLOW] % runs[c, _USUAL] != 0.0)
        return bool(runs[c, _OF_LENGTH] < max(_SHOWN, _again(runs, c)))
    if step > 0.0:
        return bool(is_held(runs, c) and runs[c, RUN] % max(runs[c, _USUAL], 1.0) != 0.0)
    return not _is_noiseless(runs, c)


@inlined
def _is_regular(runs: np.ndarray, c: int) -> bool:
    """Whether a source holds its readings for about as long each time; one that waits for a change does not."""
    total, beyond = runs[c, _SHORT] + runs[c, _LONG], 0.0
    for length in range(int(_REGULAR * runs[c, _USUAL]), _LENGTHS):
        beyond += runs[c, _OF_LENGTH + length]
    return bool(runs[c, _LONG] >= _SHOWN and beyond <= _FEW_BEYOND * total)


@inlined
def has_rest(runs: np.ndarray, c: int, step: float, noise: float) -> bool:
    """Whether a channel may say one value for long while its sensor works."""
    if step > COARSE * noise or runs[c, _WITHIN] < _FEWEST or _is_noiseless(runs, c):
        return True
    return bool((runs[c, _SHORT] < _SHOWN or runs[c, _LONG] > runs[c, _SHORT]) and not _is_regular(runs, c))


@inlined
def is_resting(runs: np.ndarray, c: int, noise: float) -> bool:
    """Whether a channel's readings rest on one value, and its sensor, of `noise` by its tag, has no rest."""
    if runs[c, RUN] < RESTING:
        return False
    step = step_of(runs, c, noise)
    longest = _LIKELY * runs[c, _LONGEST] if step > 0.0 else 0.0
    if is_held(runs, c):
        longest = max(longest, RESTING * runs[c, _USUAL])
    return bool(runs[c, RUN] >= longest and not has_rest(runs, c, step, noise))


@inlined
def hear(runs: np.ndarray, values: np.ndarray, noise: np.ndarray, heard: np.ndarray, noise_heard: np.ndarray) -> None:
    """Write into `heard` what the sensors of a second tell, with which noise; of those that are stuck nothing."""
    for k in range(heard.shape[0]):
        heard[k] = values[k]
    for c in range(runs.shape[0]):
        step = step_of(runs, c, noise[c])
        again = says_again(runs, c, values[c], step)
        note_reading(runs, c, values[c])
        noise_heard[c] = noise_between(step_of(runs, c, noise[c]), noise[c])
        if again or is_resting(runs, c, noise[c]):
            heard[c] = np.nan


@kernel
def _note_readings(runs: np.ndarray, values: np.ndarray, noise: np.ndarray, coarse: np.ndarray) -> None:
    for c in range(noise.shape[0]):
        for row in range(values.shape[0]):
            note_reading(runs, c, values[row, c])
        coarse[c] = step_of(runs, c, noise[c]) > COARSE * noise[c]


def coarse_channels(values: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Which channels read in steps that hide their noise (channels,), of readings (seconds, channels or more)."""
    found = np.zeros(len(noise), np.bool_)
    _note_readings(runs_of_nothing(len(noise)), values, noise, found)
    return found


@kernel
def _usual_run(runs: np.ndarray, values: np.ndarray) -> float:
    for value in values:
        note_reading(runs, 0, value)
    return float(runs[0, _USUAL]) if is_held(runs, 0) else 1.0


def held_for(values: np.ndarray) -> float:
    """How often in a row a source tells each of its readings (n,), mostly; 1 where it holds none."""
    return float(_usual_run(runs_of_nothing(1), np.ascontiguousarray(values, float)))
