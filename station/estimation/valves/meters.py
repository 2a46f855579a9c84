"""Flow meters while nothing flows: what they read is what they are off by, and is taken off their readings. Kernels.

A side is at rest while its valves are told to be closed, the dispenser's while no vehicle is connected either. Readings
count that lie far enough within such a time; those equal to the one before say nothing: the sensor may be stuck.
"""

from __future__ import annotations

import math

import numpy as np

from station.compiled import inlined
from station.estimation.valves.hearing import patience
from station.estimation.valves.memory import (
    BANKS,
    EDGES,
    FINE,
    KNOWN,
    METER,
    METERS,
    SEEN_OTHER,
    SEEN_RIGHT,
    SWITCHES,
    UNTOLD,
    WITHIN,
    ValveMemory,
)
from station.geometry import VEHICLE

LEAST_OFF = 0.05
"""A meter that is off by no more is right [g/s]."""

FASTEST_DRIFT = 10.0
"""One that is off by more than it could have drifted at this rate has an offset [g/s/h]."""

SHOWS, STANDS = 300.0, 1800.0
"""Seconds for which it must go on to drift before that is told, and that it must not before an offset is [s]."""

SELDOM = 300.0
"""A side that has not rested for so long is seen at short rests as well [s]."""

DRIFTS_NOW, IS_OFF, READS_NOTHING = 2, 3, 4
"""What is known of a meter, as `judged` tells it: that it drifts, that it has an offset, that it reads no flow where
there is one."""

FILLED, WITHIN_FILL = 10.0, 30.0
"""A vehicle that is filled by so much [bar] within so long [s] gets gas, whatever the meter of the dispenser says."""

NEVER_READ = 60.0
"""For so long [s] where it never read a flow: its source may hold its readings."""

RISES = 4.0
"""By so much [bar] it must have been before that is doubted."""

DOUBTED = 15.0
"""For so long [s] after an outlet was opened the dispenser's meter is not heard where it reads no flow."""

_SETTLES = 60.0  # seconds from where a meter is seen to be off until the mean has followed [s]
_READINGS = 30.0  # of which the mean is taken [1]
_ANEW = 60.0  # seconds without one behind which the mean begins anew [s]
_CLEAR = 6.0  # standard deviations of it [1]
_OFTEN = 3.0  # readings that say so, and short rests in which a meter must have read nothing [1]
_LIKE_FLOW = 0.5  # part of the usual flow from which on a reading is one [1]
_TENTH = 0.1  # part of what is taken off that it may be wrong by [1]
_PUT = 0.5  # part of what it is off by which a reading at rest must be other than that to be of another time [1]
_RISES = 0.25  # part of what a meter is off that it must have drifted since that was seen [1]
_RIGHT, _SEEN = 0, 1  # what is known of a meter
_WHAT, _OFF, _VARIANCE, _COUNT, _RESTS, _AGE, _FINE, _FIRST, _SINCE, _RATE, _LAST, _READ, _LESS, _ODD, _TRUST = range(
    15
)  # of `ValveMemory.meter`


@inlined
def _is_resting(m: ValveMemory, side: int) -> bool:
    for v in range(BANKS * side, BANKS * (side + 1)):
        if m.heard[v] > SWITCHES or m.told[v] > 0.0 or m.position[v] > 0.0:
            return False
    return side == 0 or m.vehicle[0] < 0.0


@inlined
def _is_other(meter: np.ndarray, read: float) -> bool:
    """Whether a reading at rest is not of the mean of those before."""
    off = meter[_OFF] + meter[_RATE] * meter[_AGE]
    least = max(LEAST_OFF, _CLEAR * math.sqrt(meter[_VARIANCE]))
    return abs(read - off) > max(least, _PUT * abs(off))


@inlined
def _note_other(m: ValveMemory, side: int, read: float, judged: np.ndarray) -> None:
    """Note where the first reading at rest says that not the right thing was taken off since the last one."""
    meter = m.meter[side]
    off = meter[_OFF] + meter[_RATE] * meter[_AGE]
    if meter[_AGE] > _ANEW and abs(read - off) > max(LEAST_OFF, _TENTH * abs(off)):
        judged[KNOWN + side] = SEEN_OTHER


@inlined
def _take(m: ValveMemory, side: int, read: float) -> None:
    """Take a reading of a meter through which nothing flows; not a single one that is other than those before.

    Gas may flow for a second in which nobody told the valve. Of a meter that is off, two others begin the mean anew.
    """
    meter = m.meter[side]
    if meter[_AGE] > _ANEW:
        meter[_COUNT] = 0.0
    before, odd = meter[_ODD], meter[_COUNT] > 0.0 and _is_other(meter, read)
    meter[_ODD], meter[_AGE] = (1.0 if odd else 0.0), 0.0
    if odd and before == 0.0:
        return
    if odd and meter[_WHAT] != _RIGHT:
        meter[_COUNT] = meter[_RATE] = 0.0
    meter[_COUNT] = min(meter[_COUNT] + 1.0, _READINGS)
    meter[_OFF] += (read - meter[_OFF]) / meter[_COUNT]
    if meter[_COUNT] > 1.0:
        meter[_VARIANCE] += ((read - meter[_LAST]) ** 2 / 2.0 - meter[_VARIANCE]) / (meter[_COUNT] - 1.0)
    meter[_LAST] = read


@inlined
def _judge_meter(m: ValveMemory, side: int, noise: float, judged: np.ndarray) -> None:
    """What is known of a meter after a reading at rest."""
    meter = m.meter[side]
    least = max(LEAST_OFF, _CLEAR * noise, _CLEAR * math.sqrt(meter[_VARIANCE] / _READINGS))
    off = abs(meter[_OFF])
    if meter[_COUNT] < _READINGS:
        return
    if off <= 0.5 * least:
        meter[_FINE], meter[_WHAT] = 0.0, _RIGHT
    if off <= least and meter[_WHAT] == _RIGHT:
        return
    if meter[_WHAT] == _RIGHT:
        meter[_WHAT], meter[_SINCE], meter[_RATE] = _SEEN, -_SETTLES, 0.0
    if meter[_WHAT] == _SEEN and meter[_SINCE] < 0.0:
        meter[_FIRST] = meter[_OFF]
    elif meter[_WHAT] == _SEEN:
        risen = (meter[_OFF] - meter[_FIRST]) * math.copysign(1.0, meter[_OFF])
        jumped = off > least + FASTEST_DRIFT / 3600.0 * (meter[_FINE] + _READINGS)
        if jumped or (meter[_SINCE] >= STANDS and risen <= _RISES * off):
            meter[_WHAT], judged[METER + 2 * 2 + side] = IS_OFF, meter[_FINE]
        elif meter[_SINCE] >= SHOWS and risen > max(_RISES * off, 0.5 * least):
            began = off / risen * meter[_SINCE]
            meter[_WHAT], judged[METER + 2 * 2 + side] = DRIFTS_NOW, began
            judged[FINE + side] = meter[_FINE] + least / off * began + 2.0 * (_READINGS + EDGES)  # the mean lags
    if meter[_WHAT] == DRIFTS_NOW and meter[_SINCE] >= SHOWS:
        meter[_RATE] = (meter[_OFF] - meter[_FIRST]) / meter[_SINCE]


@inlined
def _may_be_short(m: ValveMemory, side: int, read: float, least: float) -> bool:
    """Whether a meter's reading within a short rest tells what it is off by.

    One that was right must have read nothing in the first second of rests: it does not lag, and its clock is right. A
    reading like a flow is that of another second.
    """
    meter = m.meter[side]
    for v in range(BANKS * side, BANKS * (side + 1)):
        if m.heard[v] > 0.0:
            return False
    if abs(read) > _LIKE_FLOW * m.usual[side, 0]:
        meter[_TRUST] = 0.0
        return False
    if meter[_RESTS] == 1.0 and meter[_WHAT] == _RIGHT and abs(read) <= least:
        meter[_TRUST] = min(meter[_TRUST] + 1.0, _OFTEN)
    return meter[_TRUST] >= _OFTEN and meter[_AGE] > SELDOM and _CLEAR * math.sqrt(meter[_VARIANCE]) <= least


@inlined
def _judge_short(m: ValveMemory, side: int, read: float, noise: float, judged: np.ndarray) -> None:
    """Take a reading within a short rest of a meter that was not seen at a long one lately: one tells, two if other."""
    meter = m.meter[side]
    if not _may_be_short(m, side, read, max(LEAST_OFF, _CLEAR * noise)):
        return
    odd = _is_other(meter, read)
    before, meter[_ODD] = meter[_ODD], (1.0 if odd else 0.0)
    if odd and before == 0.0:
        return
    _note_other(m, side, read, judged)
    seen = meter[_WHAT] == _RIGHT
    meter[_OFF], meter[_LAST], meter[_AGE], meter[_COUNT], meter[_ODD] = read, read, 0.0, _READINGS, 0.0
    _judge_meter(m, side, noise, judged)
    if seen and meter[_WHAT] == _SEEN:
        meter[_SINCE], meter[_FIRST] = 0.0, read
    judged[KNOWN + side] += SEEN_RIGHT


@inlined
def _judge_less(meter: np.ndarray, put: float, noise: float) -> None:
    """A meter of which more is taken off than it reads was put right."""
    less = meter[_OFF] > 0.0 and put < -max(LEAST_OFF, _CLEAR * noise, _TENTH * abs(meter[_OFF]))
    meter[_LESS] = meter[_LESS] + 1.0 if less else 0.0
    if meter[_LESS] >= _OFTEN:
        meter[_WHAT], meter[_FINE], meter[_COUNT], meter[_OFF] = _RIGHT, 0.0, 0.0, 0.0


@inlined
def _judge_nothing(m: ValveMemory, values: np.ndarray, judged: np.ndarray) -> None:
    """A dispenser's meter that reads no flow while the vehicle's pressure rises is not heard until it reads one.

    One that read a flow in the same visit may have a least flow, or a source that holds its readings.
    """
    read, pressure, fed = values[METERS + 1], m.pressure[VEHICLE], m.fed
    if read > 0.0:
        fed[0], fed[1], fed[2], fed[3] = np.nan, -np.inf, 0.0, 0.0
    elif fed[1] < 0.0:
        return
    elif not fed[0] <= pressure or (fed[1] % WITHIN_FILL == 0.0 and fed[2] == 0.0):
        fed[0], fed[2] = pressure, 0.0
    if read == 0.0 and m.told[BANKS] + m.told[BANKS + 1] + m.told[BANKS + 2] > 0.0:
        fed[1] += 1.0
        fed[2] = fed[2] + 1.0 if pressure - fed[0] >= FILLED else 0.0
    if fed[2] >= (patience(m, 1) if m.usual[1, 1] > 0.0 else NEVER_READ) and fed[3] == 0.0:
        fed[3], m.untold[1], judged[METER + 2 * 2 + 1] = 1.0, UNTOLD, fed[1]
    if fed[3] > 0.0:
        judged[METER + 1], values[METERS + 1] = READS_NOTHING, np.nan


@inlined
def is_filled(m: ValveMemory) -> bool:
    """Whether the vehicle seems to be filled though the dispenser's meter reads no flow."""
    return bool(m.fed[3] > 0.0 or (m.fed[1] >= 0.0 and m.pressure[VEHICLE] - m.fed[0] >= RISES))


@inlined
def doubt_nothing(m: ValveMemory, values: np.ndarray) -> None:
    """Do not hear a dispenser's meter that reads no flow yet: whether the vehicle is filled shows in some seconds."""
    if 0.0 < m.fed[1] <= DOUBTED and values[METERS + 1] == 0.0:
        values[METERS + 1] = np.nan


@inlined
def is_right(m: ValveMemory, side: int) -> bool:
    """Whether a meter is not known to be off."""
    return m.meter[side, _WHAT] == _RIGHT


@inlined
def judge_meters(m: ValveMemory, values: np.ndarray, noise: np.ndarray, judged: np.ndarray) -> None:
    """Take a second; readings of meters that are off are put right. `noise` (2,) is absolute [g/s]."""
    place = int(m.ring[2, 0])
    m.ring[2, 0] = (place + 1) % EDGES
    for side in range(2):
        meter, read = m.meter[side], values[METERS + side]
        meter[_AGE], meter[_FINE], meter[_SINCE] = meter[_AGE] + 1.0, meter[_FINE] + 1.0, meter[_SINCE] + 1.0
        meter[_RESTS] = meter[_RESTS] + 1.0 if _is_resting(m, side) else 0.0
        judged[KNOWN + side] = 0.0
        same = read == meter[_READ] and read != 0.0
        earlier, m.ring[side, place] = m.ring[side, place], np.nan if same else read
        meter[_READ] = meter[_READ] if np.isnan(read) else read
        if meter[_RESTS] > 2 * EDGES and not np.isnan(earlier + read):
            _note_other(m, side, earlier, judged)
            _take(m, side, earlier)
            _judge_meter(m, side, noise[side], judged)
            judged[KNOWN + side] += SEEN_RIGHT if meter[_COUNT] >= _READINGS and meter[_ODD] == 0.0 else 0.0
        elif side == 0 and meter[_RESTS] > 0.0 and not np.isnan(m.ring[side, place]):
            _judge_short(m, side, read, noise[side], judged)
        if meter[_AGE] > WITHIN and meter[_WHAT] == _SEEN:
            meter[_WHAT] = _RIGHT
        if meter[_WHAT] != _RIGHT and not np.isnan(read):
            put = read - meter[_OFF] - meter[_RATE] * (meter[_AGE] + EDGES)
            _judge_less(meter, put, noise[side])
        if meter[_WHAT] != _RIGHT and not np.isnan(read):
            values[METERS + side] = 0.0 if meter[_RESTS] > 0.0 and abs(put) <= LEAST_OFF else max(put, 0.0)
        judged[KNOWN + side] = SEEN_RIGHT if meter[_WHAT] == _RIGHT else judged[KNOWN + side]
        judged[METER + side] = meter[_WHAT]
        judged[METER + 2 + side] = meter[_RATE] * 3600.0 if meter[_WHAT] == DRIFTS_NOW else meter[_OFF]
    _judge_nothing(m, values, judged)
