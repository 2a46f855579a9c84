"""A second of commands, vehicle and readings, as what is remembered of valves takes it. Kernels."""

from __future__ import annotations

import numpy as np

from station.compiled import inlined
from station.estimation.valves.memory import (
    AVERAGED,
    BANKS,
    FIRST_VALVE,
    LONGEST_REST,
    READINGS,
    SWITCHES,
    WARMTH,
    ValveMemory,
    alone,
)  # fmt: skip
from station.geometry import KELVIN, TANKS, VEHICLE
from station.sensor_names import SENSORS

SILENT = 8.0
"""A valve through which nothing flows for so long since it opened is closed, if the side gave just before or just
after [s]; a clock that is 6 s off is none."""

_CONNECTED = SENSORS.index("vehicle")


@inlined
def _goes_to_and_fro(m: ValveMemory) -> bool:
    """Whether one inlet is opened and closed again and again, each time for SWITCHES at most: what moved adds up."""
    now, last = alone(m, 0), int(m.inlet[0])
    return m.inlet[1] <= SWITCHES and (_is_closed(m) or (now >= 0 and last in (-1, now)))


@inlined
def _is_closed(m: ValveMemory) -> bool:
    """Whether all inlets are told to be closed."""
    return bool(m.told[0] + m.told[1] + m.told[2] == 0.0)


@inlined
def _begin_stretch(m: ValveMemory) -> None:
    m.since[0] = 0.0
    m.flow[:, :] = 0.0
    m.first[:, :] = 0.0
    m.last[:, :] = 0.0


@inlined
def patience(m: ValveMemory, side: int) -> float:
    """For so long nothing must flow [s]: a source that holds its readings tells a flow of nothing for longer."""
    return SILENT + float(m.again[side, 2])


@inlined
def _hear_side(m: ValveMemory, side: int, values: np.ndarray) -> bool:
    """Take what three valves are told; whether one of them moved. What nobody told is as it was."""
    changed, before = False, alone(m, side)
    m.closed[side, 1] += 1.0
    m.gave[side, 0] += 1.0
    for v in range(BANKS * side, BANKS * (side + 1)):
        m.works[v, 0], m.works[v, 1] = m.works[v, 0] + 1.0, m.works[v, 1] + 1.0
        told = values[FIRST_VALVE + v]
        m.heard[v] = m.heard[v] + 1.0 if np.isnan(told) else 0.0
        if not np.isnan(told) and (told >= 0.5) != (m.told[v] > 0.0):
            m.told[v], changed = (1.0 if told >= 0.5 else 0.0), True
    now = alone(m, side)
    if before >= 0 and now != before:
        m.closed[side, 0], m.closed[side, 1] = before, 0.0
    if now >= 0 and now != before:
        last = int(m.closed[side, 0])
        silent = last >= 0 and last != now and m.still[last] > 0.0 and m.silent[last] >= patience(m, side)
        m.after[now] = 1.0 + last if silent and m.closed[side, 1] <= SWITCHES else 0.0
        m.giving[now] = 0.0
    return changed


@inlined
def hear(m: ValveMemory, values: np.ndarray) -> None:
    """Take a second's commands, vehicle and pressures."""
    moved = (_hear_side(m, 0, values), _hear_side(m, 1, values))
    vehicle = values[_CONNECTED]
    another = not np.isnan(vehicle) and vehicle != m.vehicle[0]
    if another:
        m.vehicle[0], m.pressure[VEHICLE] = vehicle, np.nan
        m.fed[0], m.fed[1], m.fed[2] = np.nan, 0.0, 0.0
    m.inlet[1] += 1.0
    if moved[1] or another or (moved[0] and not _goes_to_and_fro(m)):
        _begin_stretch(m)
        m.inlet[0] = -1.0
    if not _is_closed(m):
        m.inlet[0] = alone(m, 0) if alone(m, 0) >= 0 else -2.0
    m.inlet[1] = 0.0 if moved[0] else m.inlet[1]
    m.since[0] += 1.0
    for tank in range(4):
        m.fresh[tank] = 0.0
        if tank < BANKS:
            m.rest[tank, 0] += 1.0
        if not np.isnan(values[tank]) and values[tank] != m.pressure[tank]:
            m.pressure[tank], m.fresh[tank] = values[tank], 1.0
            if tank < BANKS:
                _note_pressure(m, tank, values[tank])
        warm = values[len(TANKS) + tank] + KELVIN
        if tank < BANKS and not np.isnan(warm):
            m.kelvin[tank] = warm if np.isnan(m.kelvin[tank]) else m.kelvin[tank] + (warm - m.kelvin[tank]) / WARMTH


@inlined
def _note_pressure(m: ValveMemory, bank: int, read: float) -> None:
    """The mean of the last few readings, and how they spread, whatever the tag says of it: by second differences."""
    m.rest[bank, 1], m.rest[bank, 0] = max(m.rest[bank, 1], min(m.rest[bank, 0], LONGEST_REST)), 0.0
    change = (read - 2.0 * m.rough[bank, 1] + m.rough[bank, 0]) ** 2 / 6.0
    if not np.isnan(change):
        m.rough[bank, 2] += (change - m.rough[bank, 2]) / AVERAGED
    m.rough[bank, 0], m.rough[bank, 1] = m.rough[bank, 1], read
    m.smooth[bank] = read if np.isnan(m.smooth[bank]) else m.smooth[bank] + (read - m.smooth[bank]) / READINGS
