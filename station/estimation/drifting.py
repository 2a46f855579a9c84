"""Sensors of buffers that drift, at a calibrated station: what they are off is judged second by second.

A filter in which no buffer leaks, and what every sensor of a buffer is off is a state (biases as states: Friedland
1969, doi:10.1109/TAC.1969.1099223), runs beside the one that knows leaks. Mass is conserved: gas that no meter saw was
lost, which is a leak and fast enough to be told as one, or a sensor is wrong.
"""

from __future__ import annotations

import numpy as np

from station.compiled import inlined
from station.geometry import BUFFERS
from station.sensor_names import ANALOG, BANK_SENSORS

TEMPERATURE_LIMIT = 0.5
"""A thermometer of a calibrated station drifts that is off by so much [K]; of pressures it is the plant's."""

LASTING = 60.0
"""For so long [s]."""

NOTHING = 0.25
"""Part of a limit below which a sensor is right; from there it drifts."""

FASTEST = 7.0
"""A pressure sensor that falls faster since it was right does not drift: the buffer loses gas [bar/h]. What is taken
off its readings falls no faster: a leak behind a drift is so seen."""

CHANGED = 0.05
"""A machine has changed that gives by so much more or less than it mostly did [1]."""

DISTURBED = 1800.0
"""Where a buffer loses gas or a machine has changed, what sensors are off is not known for so long [s]."""

LOST = 3.0
"""What a second may then add to the mass of a buffer, as a standard deviation [g]."""

REFUSED = 10.0
"""So many readings beyond the filter's gate in a row are no sensor that drifts."""

SHARP, SLACK = 30.0, 0.5
"""A buffer loses gas where the cumulative sum of what its pressures lie below the model's, less SLACK a reading, is so
large; in standard deviations (Page 1954, doi:10.1093/biomet/41.1-2.100)."""

GRADUAL = 12.0
"""Readings that it takes to be so from a quarter of it: what falls at once is a sensor that jumps, or a second of which
little was told."""

JUMPS, RECENT = 2.5, 5.0
"""A sensor that drifts was put right, or replaced, where the mean of its RECENT innovations is so large [1]."""

ENTRIES = 8
"""Entries of a sensor: seconds since it was right, seconds in a row in which it was off by too much, 1 while it drifts,
what is taken off its readings, readings beyond the gate in a row, the cumulative sum, readings since it was a quarter,
the mean of recent innovations. A last row has: how long what sensors are off is not known yet [s], what compressor and
dispenser mostly give [1], and the limit of pressures [bar]."""

_AGO, _BEYOND, _DRIFTS, _TAKEN, _REFUSED, _SUM, _RUN, _MEAN = range(ENTRIES)
_UNKNOWN, _COMPRESSOR, _DISPENSER, _PRESSURE_LIMIT = range(4)
_KEPT = np.exp(-1.0 / 10800.0)  # part of a bias left a second later: what was off long ago is gas after all [1]
_LARGEST = 0.7  # a sensor off by less than this part of the worst is off by that one's fault, in limits
_HOUR = 3600.0
_PRESSURES = len(BUFFERS)
_SENSORS = len(BANK_SENSORS)
_CHANNELS = tuple(ANALOG.index(name) for name in BANK_SENSORS)

JUDGED = 4 * _SENSORS + _PRESSURES
"""Columns of a judged second: what each sensor is off, seconds since its drift began where one is found (else NaN), 1
while it drifts, what is to be taken off its readings; and of each buffer 1 where it seems to lose gas."""


def drifts_of_nothing(pressure_limit: float) -> np.ndarray:
    """Remember no second, at a station whose pressure sensors drift if they are off by so much [bar]."""
    remembered = np.zeros((_SENSORS + 1, ENTRIES))
    remembered[_SENSORS, _COMPRESSOR] = remembered[_SENSORS, _DISPENSER] = 1.0
    remembered[_SENSORS, _PRESSURE_LIMIT] = pressure_limit
    return remembered


@inlined
def _limit(drifts: np.ndarray, sensor: int) -> float:
    return drifts[_SENSORS, _PRESSURE_LIMIT] if sensor < _PRESSURES else TEMPERATURE_LIMIT


@inlined
def _note_machine(drifts: np.ndarray, machine: int, gives: float) -> None:
    """What a machine gives [1]."""
    usual = drifts[_SENSORS, machine]
    if abs(gives - usual) > CHANGED:
        drifts[_SENSORS, _UNKNOWN] = DISTURBED
    drifts[_SENSORS, machine] += (gives - usual) / _HOUR


@inlined
def _note_reading(drifts: np.ndarray, sensor: int, normal: float, gate: float) -> None:
    """The innovation of a sensor's reading in standard deviations; NaN for none."""
    if np.isnan(normal):
        return
    drifts[sensor, _REFUSED] = drifts[sensor, _REFUSED] + 1.0 if abs(normal) > gate else 0.0
    if drifts[sensor, _REFUSED] >= REFUSED:
        drifts[_SENSORS, _UNKNOWN] = DISTURBED
    drift = drifts[sensor]
    drift[_MEAN] += (normal - drift[_MEAN]) / RECENT
    if drift[_DRIFTS] > 0.0 and abs(drift[_MEAN]) > JUMPS:
        drift[_DRIFTS] = drift[_TAKEN] = 0.0
        drifts[_SENSORS, _UNKNOWN] = DISTURBED
    if sensor < _PRESSURES:
        drift[_SUM] = max(drift[_SUM] - normal - SLACK, 0.0)
        drift[_RUN] = drift[_RUN] + 1.0 if drift[_SUM] > 0.25 * SHARP else 0.0
        if drift[_SUM] > SHARP and drift[_RUN] < GRADUAL:
            drifts[_SENSORS, _UNKNOWN] = DISTURBED


@inlined
def _find(drifts: np.ndarray, sensor: int, bias: float, worst: float) -> float:
    """Judge a second of a sensor; the seconds since its drift began where one is found, else NaN."""
    drift, off = drifts[sensor], abs(bias) / _limit(drifts, sensor)
    drift[_AGO] += 1.0
    if off < NOTHING:
        drift[_AGO], drift[_DRIFTS] = 0.0, 0.0
    known = drifts[_SENSORS, _UNKNOWN] == 0.0
    drift[_BEYOND] = drift[_BEYOND] + 1.0 if known and off > max(1.0, _LARGEST * worst) else 0.0
    if drift[_BEYOND] < LASTING or drift[_DRIFTS] > 0.0:
        return np.nan
    if sensor < _PRESSURES and -bias / drift[_AGO] > FASTEST / _HOUR:
        drifts[_SENSORS, _UNKNOWN] = DISTURBED
        return np.nan
    drift[_DRIFTS] = 1.0
    return drift[_AGO]


@inlined
def judge_drifts(
    drifts: np.ndarray, judged: np.ndarray, innovations: np.ndarray, gate: float, compressor: float, dispenser: float
) -> None:
    """Judge a second; `judged` (JUDGED,) has what each sensor is off, and the rest of it is filled.

    `drifts` (len(BANK_SENSORS) + 1, ENTRIES) is what is remembered, `innovations` (len(ANALOG),) those of the second in
    standard deviations, `compressor` and `dispenser` what is left of them.
    """
    for k in range(_SENSORS):
        _note_reading(drifts, k, innovations[_CHANNELS[k]], gate)
    _note_machine(drifts, _COMPRESSOR, compressor)
    _note_machine(drifts, _DISPENSER, dispenser)
    drifts[_SENSORS, _UNKNOWN] = max(drifts[_SENSORS, _UNKNOWN] - 1.0, 0.0)
    for k in range(_PRESSURES):
        if drifts[_SENSORS, _UNKNOWN] > 0.0:
            drifts[k, _SUM] = 0.0
        judged[4 * _SENSORS + k] = 1.0 if drifts[k, _SUM] > SHARP else 0.0
    worst = 0.0
    for k in range(_SENSORS):
        worst = max(worst, abs(judged[k]) / _limit(drifts, k))
    for k in range(_SENSORS):
        judged[_SENSORS + k] = _find(drifts, k, judged[k], worst)
        step = drifts[k, _DRIFTS] * judged[k] - drifts[k, _TAKEN]
        drifts[k, _TAKEN] += max(step, -FASTEST / _HOUR) if k < _PRESSURES else step
        judged[2 * _SENSORS + k], judged[3 * _SENSORS + k] = drifts[k, _DRIFTS], drifts[k, _TAKEN]


@inlined
def lost_mass(drifts: np.ndarray) -> float:
    """The mass that a second may add to a buffer's beside the model's, as a standard deviation [g]."""
    return LOST if drifts[_SENSORS, _UNKNOWN] > 0.0 else 0.0


@inlined
def forget(mean: np.ndarray, cov: np.ndarray, place: int, walk: float, drifts: np.ndarray, sensor: int) -> None:
    """Take what a sensor is off, a state at `place` of mean and covariance, a second on.

    A sensor that does not drift is right in the long run, and while nothing is known.
    """
    kept = 0.0 if drifts[_SENSORS, _UNKNOWN] > 0.0 else _KEPT
    if drifts[sensor, _DRIFTS] > 0.0:
        kept = 1.0
    mean[place] *= kept
    for j in range(len(mean)):
        cov[place, j] *= kept
        cov[j, place] *= kept
    cov[place, place] += walk**2
