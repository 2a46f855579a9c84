"""Windows: what the readings of one tank, while one of its valves acts, admit of the constants and add to sums."""

from __future__ import annotations

import numpy as np

from controllers.adaptive.memory import (
    AMBIENT,
    CAPPED,
    CENTRE,
    COMPRESSOR,
    COVOLUME,
    ENTRIES,
    ERROR,
    EXCHANGE,
    FLOW,
    HALF,
    HEAT,
    HIGH,
    INLET,
    LOW,
    OUTLET,
    OUTWARD,
    PRESSURE,
    RATE,
    RATES,
    SEEN,
    SHARED,
    TEMPERATURE,
    WINDOWS,
)
from station.compiled import inlined, kernel
from station.control_model import held_mass
from station.controller import Observation
from station.geometry import VEHICLE
from station.planning import Model

WINDOW_MAX = 600.0
"""Longest window [s]: what is not known of the exchange with the surroundings grows with it."""

# Entries of a window.
MODE, _READINGS, _LEAST, _MOST, _WEIGHT, _DRIVE, _MEAN_DRIVE, _MEAN_MASS = range(8)
_FIRST, _OPEN, _PULL, _MEAN_OPEN, _MEAN_PULL, _MEAN_TEMPERATURE = range(8, 14)
NONE, _CLOSED, _FILLED, _GIVING, _SERVED = range(5)


@inlined
def _narrow(item: int, low: float, high: float, memory: np.ndarray) -> bool:
    """Keep what lies between `low` and `high` of a constant's interval; False where nothing would be left.

    What contradicts the stated error of the constant itself is passed over: the estimate then goes to the nearer end.
    """
    slack = OUTWARD * memory[CENTRE + item]
    least = memory[CENTRE + item] - memory[HALF + item] - slack
    most = memory[CENTRE + item] + memory[HALF + item] + slack
    if low > most or high < least:
        return True
    memory[LOW + item] = max(memory[LOW + item], low)
    memory[HIGH + item] = min(memory[HIGH + item], high)
    return bool(memory[LOW + item] <= memory[HIGH + item])


@inlined
def _mass_ends(pressure: float, temperature: float, volume: float, memory: np.ndarray) -> tuple[float, float]:
    """Between what the mass [g] of a tank lies whose readings are given."""
    error, thermal = memory[ERROR], memory[ERROR + 1]
    return (
        held_mass(pressure - error, temperature + thermal, volume, memory[COVOLUME]),
        held_mass(pressure + error, temperature - thermal, volume, memory[COVOLUME]),
    )


@kernel
def _open_window(
    mode: int, pressure: float, temperature: float, volume: float, window: np.ndarray, memory: np.ndarray
) -> None:
    """Begin a window at the readings of a tank."""
    window[:] = 0.0
    window[MODE], window[_READINGS] = mode, 1.0
    window[_LEAST], window[_MOST] = _mass_ends(pressure, temperature, volume, memory)
    window[_MEAN_MASS] = held_mass(pressure, temperature, volume, memory[COVOLUME])
    window[_WEIGHT] = 12.0 / (window[_MOST] - window[_LEAST]) ** 2
    window[_FIRST] = window[_MEAN_TEMPERATURE] = temperature


@kernel
def _learn_flow(
    coefficient: int, sign: float, readings: tuple[float, float, float], error: float, window: np.ndarray,
    memory: np.ndarray,
) -> bool:  # fmt: skip
    """Take in a tank's pressure [bar], temperature [deg C] and volume [m3] at the end of a second of a window.

    `error` [bar] is that of one pressure difference, `sign` whether gas comes (1) or goes (-1). A window of weight 0
    tells nothing.
    """
    if window[_WEIGHT] == 0.0:
        return True
    pressure, temperature, volume = readings
    mass = sign * held_mass(pressure, temperature, volume, memory[COVOLUME])
    least, most = _mass_ends(pressure, temperature, volume, memory)
    drive, slack = window[_DRIVE], abs(window[_OPEN]) * error
    come, go = least - window[_MOST], most - window[_LEAST]
    if sign < 0.0:
        come, go = -go, -come
    low = come / (drive + slack) if drive > 0.0 else 0.0
    high = go / (drive - slack) if drive > slack else np.inf
    share = 1.0 / (window[_READINGS] + 1.0)
    off_drive, off_mass = drive - window[_MEAN_DRIVE], mass - sign * window[_MEAN_MASS]
    window[_MEAN_DRIVE] += share * off_drive
    window[_MEAN_MASS] += share * sign * off_mass
    weight = window[_WEIGHT] * (1.0 - share)
    memory[FLOW + 2 * coefficient] += weight * off_drive * off_drive
    memory[FLOW + 2 * coefficient + 1] += weight * off_drive * off_mass
    return _narrow(coefficient, low, high, memory)


@inlined
def _product(one: tuple[float, float], other: tuple[float, float]) -> tuple[float, float]:
    """Between what the product of two numbers lies."""
    a, b, c, d = one[0] * other[0], one[0] * other[1], one[1] * other[0], one[1] * other[1]
    return min(a, b, c, d), max(a, b, c, d)


@kernel
def _narrow_heat(rate: int, temperature: float, window: np.ndarray, memory: np.ndarray) -> bool:
    """Narrow a heat rate (-1: the tank is closed) by what is known of the exchange, and the exchange by it."""
    error = memory[ERROR + 1]
    seconds, opened = window[_READINGS], window[_OPEN]
    rise = temperature - window[_FIRST]
    pull = (window[_PULL] - 2.0 * seconds * error, window[_PULL] + 2.0 * seconds * error)
    heating = (0.0, 0.0)
    if rate >= 0 and opened != 0.0:
        item = HEAT + rate
        flow = _product((memory[LOW + EXCHANGE], memory[HIGH + EXCHANGE]), pull)
        ends = (rise - 2.0 * error - flow[1]) / opened, (rise + 2.0 * error - flow[0]) / opened
        if not _narrow(item, min(ends), max(ends), memory):
            return False
        heating = _product((memory[LOW + item], memory[HIGH + item]), (opened, opened))
    if pull[0] <= 0.0 <= pull[1]:
        return True
    left = rise - 2.0 * error - heating[1], rise + 2.0 * error - heating[0]
    low, high = _product(left, (1.0 / pull[1], 1.0 / pull[0]))
    return _narrow(EXCHANGE, low, high, memory)


@kernel
def _learn_heat(rate: int, temperature: float, window: np.ndarray, memory: np.ndarray) -> bool:
    """Take in a tank's temperature [deg C] at the end of a second of a window; `rate` -1: the tank is closed."""
    share = 1.0 / (window[_READINGS] + 1.0)
    opened = window[_OPEN] - window[_MEAN_OPEN]
    pull = window[_PULL] - window[_MEAN_PULL]
    rise = temperature - window[_MEAN_TEMPERATURE]
    window[_MEAN_OPEN] += share * opened
    window[_MEAN_PULL] += share * pull
    window[_MEAN_TEMPERATURE] += share * rise
    weight = 1.0 - share
    if rate >= 0:
        place = RATE + 3 * rate
        memory[place] += weight * opened * opened
        memory[place + 1] += weight * opened * pull
        memory[place + 2] += weight * opened * rise
    memory[SHARED] += weight * pull * pull
    memory[SHARED + 1] += weight * pull * rise
    return _narrow_heat(rate, temperature, window, memory)


@inlined
def _kind_of(inlet: int, outlet: int, window: np.ndarray) -> int:
    """What a buffer's window is to be: a rest belongs to the one before it, and the first one after it to a rest."""
    kind = _FILLED if inlet else _GIVING if outlet else int(window[MODE])
    return _CLOSED if kind == NONE else kind


@kernel
def learn_buffer(buffer: int, observation: Observation, model: Model, memory: np.ndarray) -> bool:
    """Take in what the second before did to a buffer."""
    begin = WINDOWS + buffer * ENTRIES
    window = memory[begin : begin + ENTRIES]
    volume = model.buffer_volume[buffer]
    inlet, outlet = observation.previous >> buffer & 1, observation.previous >> (3 + buffer) & 1
    before, warmth = memory[PRESSURE + buffer], memory[TEMPERATURE + buffer]
    kind = _kind_of(inlet, outlet, window)
    if (kind != window[MODE] and window[MODE] != _CLOSED) or window[_READINGS] > WINDOW_MAX:
        _open_window(kind, before, warmth, volume, window, memory)
    window[MODE] = kind
    window[_OPEN] += inlet - outlet
    window[_PULL] += memory[AMBIENT] - warmth
    if inlet:
        window[_DRIVE] += memory[COMPRESSOR] - before
    elif outlet and memory[SEEN] >= 0.0 and memory[CAPPED] == 0.0:
        window[_DRIVE] += before - memory[PRESSURE + VEHICLE]
    elif outlet:
        window[_WEIGHT] = 0.0  # nobody knows against what pressure it gives, or that is not what makes it flow
    readings = (observation.pressure[buffer], observation.temperature[buffer], volume)
    coefficient, sign, rate = INLET, 1.0, -1
    if kind == _GIVING:
        coefficient, sign, rate = OUTLET, -1.0, 3 + buffer
    elif kind == _FILLED:
        rate = buffer
    consistent = _learn_flow(coefficient, sign, readings, 2.0 * memory[ERROR], window, memory)
    consistent = _learn_heat(rate, observation.temperature[buffer], window, memory) and consistent
    window[_READINGS] += 1.0
    return consistent


@kernel
def learn_vehicle(observation: Observation, memory: np.ndarray) -> bool:
    """Take in what the second before did to the vehicle; its window is its stay."""
    begin = WINDOWS + VEHICLE * ENTRIES
    window = memory[begin : begin + ENTRIES]
    unknown = not observation.communication or memory[CAPPED] != 0.0
    if unknown or observation.vehicle < 0 or observation.vehicle != memory[SEEN]:
        window[MODE] = NONE
        return True
    volume = observation.vehicle_volume
    before, warmth = memory[PRESSURE + VEHICLE], memory[TEMPERATURE + VEHICLE]
    if window[MODE] != _SERVED:
        _open_window(_SERVED, before, warmth, volume, window, memory)
    window[_PULL] += memory[AMBIENT] - warmth
    for buffer in range(3):
        if observation.previous >> (3 + buffer) & 1:
            window[_OPEN] += 1.0
            window[_DRIVE] += memory[PRESSURE + buffer] - before
    readings = (observation.vehicle_pressure, observation.vehicle_temperature, volume)
    consistent = _learn_flow(OUTLET, 1.0, readings, 2.0 * memory[ERROR], window, memory)
    consistent = _learn_heat(RATES - 1, observation.vehicle_temperature, window, memory) and consistent
    window[_READINGS] += 1.0
    return consistent
