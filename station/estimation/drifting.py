"""Sensors of buffers that drift, at a calibrated station: what they are off is judged second by second.

A filter in which no buffer leaks, and what every sensor of a buffer is off is a state (biases as states: Friedland
1969, doi:10.1109/TAC.1969.1099223), runs beside the one that knows leaks. Mass is conserved: gas that no meter saw was
lost, which is a leak and fast enough to be told as one, or a sensor is wrong.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from station.compiled import inlined
from station.geometry import BUFFERS
from station.sensor_names import ANALOG, BANK_SENSORS

TEMPERATURE_LIMIT = 0.5
"""A thermometer of a calibrated station drifts that is off by so much [K]; of pressures it is the plant's."""

LASTING = 45.0
"""For so long [s]."""

NOTHING = 0.25
"""Part of a limit below which a sensor is right; from there it drifts."""

LOSS, FASTEST = 0.03, 4.5
"""A pressure sensor that falls as if its buffer lost more since it was right does not drift, if it also falls faster
than a sensor that drifts: gas is lost [g/s], [bar/h]."""

LOSING = 86_400.0
"""Where it fell so twice within so long, what falls is a leak for as long [s]."""

OTHERS, BESIDE = 1.2, 0.8
"""What falls is a leak where all other sensors but one are off by so much beside it, or by BESIDE where that one is
beyond its limit and no thermometer of the same buffer; and what rises is the leak of another, in limits [1]."""

SWIFT, SLOWLY = 2.7, 1.6
"""What falls slower, [bar/h], is a leak where the others are off by so much, [1]: leaks that are large enough to be
told mostly make a pressure fall faster. A sensor that drifts by 3 bar in an hour seems slower, since it shows late."""

TAKEN_WARMING = 30.0
"""What is taken off a pressure's readings changes no faster than the sensor drifts and as if its buffer lost or gained
LOSS beside it, and of a thermometer by no more than this beside it [K/h]: a leak behind a drift is so seen."""

SLOWEST_PRESSURE, SLOWEST_TEMPERATURE = 0.9, 0.75
"""A sensor that is off for long is off by more than its limit where it drifts, by so much for each hour [bar/h], [K/h]:
parameters that are wrong by a little make sensors seem to be off by a little for long."""

FAR = 3.0
"""One that is off by so many limits drifts however slowly."""

CHANGED = 0.05
"""A machine has changed that gives by so much more or less than it mostly did [1]."""

DISTURBED = 1800.0
"""Where a buffer loses gas or a machine has changed, what sensors are off is not known for so long [s]."""

LOST, WARMED = 3.0, 0.1
"""What a second may then add to the mass of a buffer, as a standard deviation [g]; and to the temperature of one that
is left out [K], or what warms it would be laid to the air."""

REFUSED = 10.0
"""So many readings beyond the filter's gate in a row are no sensor that drifts."""

SHARP, SLACK = 30.0, 0.5
"""A buffer loses gas where the cumulative sum of what its pressures lie below the model's, less SLACK a reading, is so
large; in standard deviations (Page 1954, doi:10.1093/biomet/41.1-2.100)."""

SURELY = 1.5
"""Where it is so many times as large nothing is known of drift."""

GRADUAL = 12.0
"""Readings that it takes to be so from a quarter of it: what falls at once is a sensor that jumps, or a second of which
little was told."""

JUMPS, RECENT = 2.5, 5.0
"""A sensor that drifts was put right, or replaced, where the mean of its RECENT innovations is so large [1]."""

USUAL, EARLY = 7200.0, 1800.0
"""What a sensor is off is judged against its mean over so long, and at first as if it had been right for so long before
[s]: parameters that are wrong by a little let sensors be off by a little all the time."""

ENTRIES = 11
"""Entries of a sensor: seconds since it was right, seconds in a row in which it was off by too much, 1 while it drifts,
what is taken off its readings, readings beyond the gate in a row, the cumulative sum, readings since it was a quarter,
the mean of recent innovations, seconds in which a fall is remembered (inf: it is left out), what it is usually off, and
for how long that was seen. A last row has: how long what sensors are off is not known yet [s], what compressor and
dispenser mostly give [1], and the limit of pressures [bar]."""

_AGO, _BEYOND, _DRIFTS, _TAKEN, _REFUSED, _SUM, _RUN, _MEAN, _FELL, _OFF, _SEEN = range(ENTRIES)
_UNKNOWN, _COMPRESSOR, _DISPENSER, _PRESSURE_LIMIT = range(4)
_KEPT = np.exp(-1.0 / 10800.0)  # part of a bias left a second later: what was off long ago is gas after all [1]
_PART = 0.2  # and by this part of what falls [1]
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


def leave_out(drifts: np.ndarray, buffers: Iterable[str]) -> None:
    """Judge no sensor of buffers whose volumes are not known: what their pressures say of their mass is wrong.

    Their masses follow their readings, and spoil nothing that is judged of other sensors.
    """
    for name in buffers:
        bank = BUFFERS.index(name)
        drifts[bank, _FELL] = drifts[_PRESSURES + bank, _FELL] = np.inf


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
    if np.isnan(normal) or np.isinf(drifts[sensor, _FELL]):
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
        if (drift[_SUM] > SHARP and drift[_RUN] < GRADUAL) or drift[_SUM] > SURELY * SHARP:
            drifts[_SENSORS, _UNKNOWN] = DISTURBED


@inlined
def _beside_usual(drifts: np.ndarray, sensor: int, bias: float) -> float:
    """By how much more than usually a sensor is off."""
    drift = drifts[sensor]
    if drifts[_SENSORS, _UNKNOWN] > 0.0:
        drift[_OFF] = drift[_SEEN] = 0.0
    elif drift[_DRIFTS] == 0.0:
        drift[_SEEN] += 1.0
        drift[_OFF] += (bias - drift[_OFF]) / min(drift[_SEEN] + EARLY, USUAL)
    return float(bias - drift[_OFF])


@inlined
def _others(drifts: np.ndarray, judged: np.ndarray, sensor: int) -> tuple[float, float]:
    """By how much all other sensors but one are off, the root of the sum of their squares, and that one; in limits.

    One may drift as well. What flows from a buffer that has lost gas is less than a model says which knows no leak, and
    by that all the others seem to be off.
    """
    total, largest = 0.0, 0.0
    for k in range(_SENSORS):
        square = (judged[k] / _limit(drifts, k)) ** 2 if k != sensor else 0.0
        total, largest = total + square, max(largest, square)
    return float(np.sqrt(max(total - largest, 0.0))), float(np.sqrt(largest))


@inlined
def _is_lost(drifts: np.ndarray, bank: int) -> None:
    """A buffer loses gas: its pressure does not drift."""
    drifts[bank, _DRIFTS], drifts[bank, _FELL] = 0.0, 2.0 * LOSING
    drifts[_SENSORS, _UNKNOWN] = DISTURBED


@inlined
def _lowest(drifts: np.ndarray, judged: np.ndarray) -> int:
    """The buffer whose pressure reads most too little, or -1."""
    found = -1
    for k in range(_PRESSURES):
        if judged[k] < -NOTHING * _limit(drifts, k) and (found < 0 or judged[k] < judged[found]):
            found = k
    return found


@inlined
def _find(drifts: np.ndarray, judged: np.ndarray, sensor: int, worst: float, grams: float) -> float:
    """Judge a second of a sensor; the seconds since its drift began where one is found, else NaN.

    `grams` of a bar in its buffer [g/bar].
    """
    drift, bias = drifts[sensor], judged[sensor]
    off = abs(bias) / _limit(drifts, sensor)
    drift[_AGO] += 1.0
    drift[_FELL] = max(drift[_FELL] - 1.0, 0.0)
    if off < NOTHING:
        drift[_AGO], drift[_DRIFTS] = 0.0, 0.0
    known = drifts[_SENSORS, _UNKNOWN] == 0.0
    slowest = SLOWEST_PRESSURE if sensor < _PRESSURES else SLOWEST_TEMPERATURE
    least = min(max(slowest * drift[_AGO] / _HOUR / _limit(drifts, sensor), 1.0), FAR)
    drift[_BEYOND] = drift[_BEYOND] + 1.0 if known and off > max(least, _LARGEST * worst) else 0.0
    if drift[_BEYOND] < LASTING or drift[_DRIFTS] > 0.0:
        return np.nan
    if sensor < _PRESSURES and bias < 0.0:
        if -bias / drift[_AGO] > max(LOSS / grams, FASTEST / _HOUR):
            drift[_FELL] += LOSING if drift[_FELL] == 0.0 else max(2.0 * LOSING - drift[_FELL], 0.0)
            drifts[_SENSORS, _UNKNOWN] = DISTURBED
            return np.nan
        if drift[_FELL] > LOSING:
            return np.nan
    elif _others(drifts, judged, sensor)[0] > max(BESIDE, _PART * off):
        drifts[_SENSORS, _UNKNOWN] = DISTURBED
        lowest = _lowest(drifts, judged)
        if lowest >= 0:
            _is_lost(drifts, lowest)
        return np.nan
    drift[_DRIFTS] = 1.0
    return drift[_AGO]


@inlined
def _doubt_falls(drifts: np.ndarray, judged: np.ndarray) -> None:
    """Take a fall that was told as drift for the leak that it was, where the other sensors say so."""
    for k in range(_PRESSURES):
        if drifts[k, _DRIFTS] == 0.0 or judged[k] > 0.0:
            continue
        others, largest = _others(drifts, judged, k)
        elsewhere = largest >= 1.0 and largest > abs(judged[k + _PRESSURES]) / TEMPERATURE_LIMIT
        enough = BESIDE if elsewhere else OTHERS
        if -judged[k] * _HOUR < SWIFT * drifts[k, _AGO]:
            enough = SLOWLY
        if others > max(enough, _PART * abs(judged[k]) / _limit(drifts, k)):
            _is_lost(drifts, k)


@inlined
def judge_drifts(
    drifts: np.ndarray, judged: np.ndarray, innovations: np.ndarray, gate: float, machines: tuple[float, float],
    grams: tuple[float, float, float],
) -> None:  # fmt: skip
    """Judge a second.

    `judged` (JUDGED,) has what each sensor is off, which becomes by how much more than usually, and the rest is filled.
    `drifts` (len(BANK_SENSORS) + 1, ENTRIES) is what is remembered, `innovations` (len(ANALOG),) those of the second in
    standard deviations, `machines` what is left of compressor and dispenser, `grams` of a bar in each buffer [g/bar].
    """
    for k in range(_SENSORS):
        _note_reading(drifts, k, innovations[_CHANNELS[k]], gate)
    _note_machine(drifts, _COMPRESSOR, machines[0])
    _note_machine(drifts, _DISPENSER, machines[1])
    for k in range(_SENSORS):
        judged[k] = _beside_usual(drifts, k, judged[k])
    _doubt_falls(drifts, judged)
    drifts[_SENSORS, _UNKNOWN] = max(drifts[_SENSORS, _UNKNOWN] - 1.0, 0.0)
    for k in range(_PRESSURES):
        if drifts[_SENSORS, _UNKNOWN] > 0.0:
            drifts[k, _SUM] = 0.0
        judged[4 * _SENSORS + k] = 1.0 if drifts[k, _SUM] > SHARP else 0.0
    worst = 0.0
    for k in range(_SENSORS):
        worst = max(worst, abs(judged[k]) / _limit(drifts, k))
    for k in range(_SENSORS):
        weight = grams[k] if k < _PRESSURES else 1.0
        judged[_SENSORS + k] = _find(drifts, judged, k, worst, weight)
        step = drifts[k, _DRIFTS] * judged[k] - drifts[k, _TAKEN]
        most = LOSS / weight if k < _PRESSURES else TAKEN_WARMING / _HOUR
        most += abs(judged[k]) / max(drifts[k, _AGO], 1.0)
        drifts[k, _TAKEN] += min(max(step, -most), most)
        judged[2 * _SENSORS + k], judged[3 * _SENSORS + k] = drifts[k, _DRIFTS], drifts[k, _TAKEN]


@inlined
def is_drifting(drifts: np.ndarray, bank: int, thermal: bool) -> bool:
    """Whether a buffer's thermometer, or its pressure, drifts."""
    return drifts[_PRESSURES + bank if thermal else bank, _DRIFTS] > 0.0


@inlined
def _is_unknown(drifts: np.ndarray, sensor: int) -> bool:
    """Whether nothing says what a sensor is off: it does not of a pressure whose buffer loses gas."""
    return drifts[_SENSORS, _UNKNOWN] > 0.0 or drifts[sensor, _FELL] > LOSING


@inlined
def lost_mass(drifts: np.ndarray, bank: int) -> float:
    """The mass that a second may add to a buffer's beside the model's, as a standard deviation [g]."""
    return LOST if _is_unknown(drifts, bank) else 0.0


@inlined
def warmed(drifts: np.ndarray, bank: int) -> float:
    """The warmth that a second may add to a buffer beside the model's, as a standard deviation [K]."""
    return WARMED if np.isinf(drifts[bank, _FELL]) else 0.0


@inlined
def forget(mean: np.ndarray, cov: np.ndarray, place: int, walk: float, drifts: np.ndarray, sensor: int) -> None:
    """Take what a sensor is off, a state at `place` of mean and covariance, a second on.

    A sensor that does not drift is right in the long run, and while nothing is known.
    """
    kept = 0.0 if _is_unknown(drifts, sensor) else _KEPT
    if drifts[sensor, _DRIFTS] > 0.0:
        kept = 1.0
    mean[place] *= kept
    for j in range(len(mean)):
        cov[place, j] *= kept
        cov[j, place] *= kept
    cov[place, place] += walk**2
