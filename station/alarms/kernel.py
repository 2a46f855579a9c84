"""The kernel of alarms: seconds in, and which conditions begin or end in them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import types

from station.alarm_signals import COUNTED, INPUTS, MARGINS, SIGNALS, WINDOW
from station.compiled import entry, inlined, numba_type

_PRESSURE, _TEMPERATURE = INPUTS.index("pressure_high"), INPUTS.index("temperature_high")
_FLOW, _VEHICLE = INPUTS.index("flow_dispenser"), INPUTS.index("vehicle")
_MARGIN, _TIME_TO = SIGNALS.index(MARGINS[0]), SIGNALS.index(MARGINS[0]) + len(MARGINS)
_FILLING, _IDLE = (SIGNALS.index(name) for name in COUNTED)
_FINISH = len(MARGINS) - 1
_BUFFERS, _TANKS = 3, 4


class AlarmPlan(NamedTuple):
    """Rules as arrays, one entry each, and the limits of the station."""

    signal: np.ndarray  # (rules,) int64, places among SIGNALS
    sign: np.ndarray  # (rules,) 1: above, -1: below
    limit: np.ndarray  # (rules,) in the signal's unit
    deadband: np.ndarray  # (rules,)
    on_delay: np.ndarray  # (rules,) [s]
    off_delay: np.ndarray  # (rules,) [s]
    limits: np.ndarray  # (len(MARGINS),): temperatures [degC], pressures, and that from which fills are ended [bar]


class AlarmMemory(NamedTuple):
    """Memory of the seconds so far."""

    active: np.ndarray  # (rules,) 1: the condition holds, delays counted
    since: np.ndarray  # (rules,) since when the other of the two has held [s]; NaN: it does not
    last: np.ndarray  # (2 * tanks,) pressures and temperatures as they were read last
    recent: np.ndarray  # (WINDOW, len(MARGINS)) margins of the last seconds
    counts: np.ndarray  # (4,) seconds so far, of this fill, without flow; its vehicle


def alarm_memory(rules: int) -> AlarmMemory:
    """Of no second."""
    return AlarmMemory(
        np.zeros(rules), np.full(rules, np.nan), np.full(2 * _TANKS, np.nan), np.full((WINDOW, len(MARGINS)), np.nan),
        np.array([0.0, 0.0, 0.0, -1.0]),
    )  # fmt: skip


@inlined
def _remember(given: np.ndarray, m: AlarmMemory, signals: np.ndarray) -> None:
    """A reading that is missing is as it was; a vehicle's is none while there is no vehicle."""
    vehicle = given[_VEHICLE]
    if np.isnan(vehicle):
        vehicle = signals[_VEHICLE] = m.counts[3]
    for k in range(2 * _TANKS):
        of_vehicle = k % _TANKS == _BUFFERS
        if of_vehicle and (vehicle < 0.0 or vehicle != m.counts[3]):
            m.last[k] = np.nan
        if not np.isnan(given[_PRESSURE + k]):
            m.last[k] = given[_PRESSURE + k]
        signals[_PRESSURE + k] = np.nan if of_vehicle and vehicle < 0.0 else m.last[k]
    if vehicle != m.counts[3]:
        m.counts[1] = m.counts[2] = 0.0
    m.counts[3] = vehicle
    if vehicle >= 0.0:
        m.counts[1] += 1.0
        if not np.isnan(given[_FLOW]):
            m.counts[2] = 0.0 if given[_FLOW] > 0.0 else m.counts[2] + 1.0
    signals[_FILLING], signals[_IDLE] = m.counts[1], m.counts[2]


@inlined
def _measure(m: AlarmMemory, limits: np.ndarray, signals: np.ndarray) -> None:
    """Margins, and how long until they are used up."""
    highest = -np.inf
    for k in range(_BUFFERS):
        pressure = signals[_PRESSURE + k]
        signals[_MARGIN + _TANKS + k] = limits[_TANKS + k] - pressure
        highest = max(highest, pressure)
    for k in range(_TANKS):
        there = k < _BUFFERS or m.counts[3] >= 0.0
        signals[_MARGIN + k] = limits[k] - signals[_TEMPERATURE + k] if there else np.inf
    signals[_MARGIN + _FINISH] = highest - limits[_FINISH] if highest > -np.inf else np.nan
    place = int(m.counts[0]) % WINDOW
    for k in range(limits.shape[0]):
        now, before = signals[_MARGIN + k], m.recent[place, k]
        m.recent[place, k] = now
        signals[_TIME_TO + k] = np.inf
        if now <= 0.0:
            signals[_TIME_TO + k] = 0.0
        elif np.isfinite(before) and before > now:
            signals[_TIME_TO + k] = now * WINDOW / (before - now)
    m.counts[0] += 1.0


@inlined
def _changes(k: int, time: float, value: float, plan: AlarmPlan, m: AlarmMemory) -> bool:
    """Whether the condition of a rule begins or ends in a second; of a value that is not known it stays as it is."""
    if np.isnan(value):
        return False
    beyond = plan.sign[k] * (value - plan.limit[k])
    is_active = m.active[k] > 0.0
    other = beyond <= -plan.deadband[k] if is_active else beyond > 0.0
    if not other:
        m.since[k] = np.nan
        return False
    if np.isnan(m.since[k]):
        m.since[k] = time
    if time - m.since[k] < (plan.off_delay[k] if is_active else plan.on_delay[k]):
        return False
    m.active[k], m.since[k] = 0.0 if is_active else 1.0, np.nan
    return True


def _types() -> tuple[object, ...]:
    row, rows = np.zeros(1), np.zeros((1, 1))
    plan = AlarmPlan(np.zeros(1, np.int64), *(np.zeros(1) for _ in range(6)))
    return tuple(map(numba_type, (row, rows, plan, alarm_memory(1), np.zeros((1, 1), np.int8), rows)))


@entry(types.int64(*_types()))
def advance(
    times: np.ndarray, inputs: np.ndarray, plan: AlarmPlan, m: AlarmMemory, changed: np.ndarray, values: np.ndarray
) -> int:
    """Look at seconds one after the other; how many conditions begin or end in them.

    `inputs` (seconds, len(INPUTS)); `changed` (seconds, rules) becomes 1 where a condition begins, -1 where it ends,
    and `values` the signal there.
    """
    count = 0
    signals = np.full(len(SIGNALS), np.nan)
    for row in range(len(times)):
        signals[: len(INPUTS)] = inputs[row]
        _remember(inputs[row], m, signals)
        _measure(m, plan.limits, signals)
        for k in range(len(plan.signal)):
            changed[row, k] = 0
            value = signals[plan.signal[k]]
            if _changes(k, times[row], value, plan, m):
                count += 1
                changed[row, k], values[row, k] = (1 if m.active[k] > 0.0 else -1), value
    return count
