"""Constants of the running plant from its readings: what the errors admit of each, and the estimate inside.

A window is a time in which a buffer is filled or rests, or gives or rests, or the stay of a vehicle. Over a window the
mass changes by a flow coefficient times the sum of pressure differences, Eqs (7.1) and (7.6), and the temperature by a
heat rate times the seconds open plus c_Tn times the sum of differences to the ambient temperature, Eqs (7.4) and (7.9):
each is a line in what is unknown.

The set is an interval a constant: whatever errors within their half-widths, the change from the window's first reading
to the present one admits no other value. The estimate is the line of least squares through all readings of a window,
each window with a level of its own, pooled over windows and with the station's figure as one observation more; then it
is moved into the interval. So no difference of two readings a second apart decides anything on its own, and a constant
error of a sensor cancels.
"""

from __future__ import annotations

import math

import numpy as np

from station.compiled import inlined, kernel
from station.control_model import ControlModel, held_mass
from station.controller import Observation
from station.geometry import VEHICLE
from station.parameters import Station
from station.planning import Model
from station.plants.thesis import Rates
from station.tightening import TightenedStation

IDENTIFIED = (
    "inlet_coefficient", "outlet_coefficient",
    "inlet_heating_high", "inlet_heating_medium", "inlet_heating_low",
    "outlet_cooling_high", "outlet_cooling_medium", "outlet_cooling_low",
    "vehicle_heating", "heat_exchange",
)  # fmt: skip
"""The constants identified, in the order of every vector here."""

COUNT = len(IDENTIFIED)

OUTWARD = 1e-9
"""Added to the error of a pressure [bar], a temperature [K] and, relatively, of a constant: the rounding of doubles."""

WINDOW_MAX = 600.0
"""Longest window [s]: what is not known of the exchange with the surroundings grows with it."""

_NOWHERE = 1e-30
"""Stands for the variance of a constant that is known."""

_INLET, _OUTLET, _HEAT, _EXCHANGE = 0, 1, 2, 9
_FLOWS, _RATES = 2, 7

# Parts of the memory: the interval, what is believed of the constants before any reading, the estimate.
LOW, HIGH, CENTRE, HALF, ESTIMATE = (COUNT * part for part in range(5))
_ERROR = 5 * COUNT  # of a pressure [bar], of a temperature [K]
_COMPRESSOR, _AMBIENT = _ERROR + 2, _ERROR + 3  # readings of p0 [bar] and T_env [deg C]
_COVOLUME = _ERROR + 4  # b [m3/g]
_CAPPED = _ERROR + 5  # 1: nozzle and ramp hold the flow to a vehicle, so it tells nothing of the coefficient
_TIME, _SEEN = _ERROR + 6, _ERROR + 7  # time of the readings before, vehicle then (-1: none it reports of)
_PRESSURE, _TEMPERATURE = _ERROR + 8, _ERROR + 12  # and what they were
_FLOW = _ERROR + 16  # of each coefficient: sums of squares and products by the variance of a mass
_RATE = _FLOW + 2 * _FLOWS  # of each heat rate: squares, products with the exchange, with the temperature
_SHARED = _RATE + 3 * _RATES  # of the exchange: squares, products with the temperature
_WINDOWS = _SHARED + 2

# Entries of a window.
_MODE, _READINGS, _LEAST, _MOST, _WEIGHT, _DRIVE, _MEAN_DRIVE, _MEAN_MASS = range(8)
_FIRST, _OPEN, _PULL, _MEAN_OPEN, _MEAN_PULL, _MEAN_TEMPERATURE = range(8, 14)
_ENTRIES = 14
_NONE, _CLOSED, _FILLED, _GIVING, _SERVED = range(5)

IDENTIFICATION_SIZE = _WINDOWS + 4 * _ENTRIES
"""Entries of memory `learn` uses."""


def believed(plant: Rates) -> np.ndarray:
    """The constants identified as `plant` has them, (COUNT,)."""
    return np.array(
        [
            plant.inlet_coefficient, plant.outlet_coefficient, *plant.inlet_heating, *plant.outlet_cooling,
            plant.vehicle_heating, plant.heat_exchange,
        ]
    )  # fmt: skip


def start_identification(station: Station, parameters: float | None, assumed: float) -> np.ndarray:
    """The memory of `learn` before any reading, (IDENTIFICATION_SIZE,).

    The errors are those a disturbed scenario states; where none are stated, readings are taken as exact and the
    constants as known to the relative error `assumed`. `parameters` is preferred to either.
    """
    plant, pressure, temperature = station.control_constants(), 0.0, 0.0
    width = assumed
    if isinstance(station, TightenedStation):
        plant = station.nominal.control_constants()
        width = station.uncertainty.parameters
        pressure, temperature = station.uncertainty.pressure_bar, station.uncertainty.temperature_k
    width = width if parameters is None else parameters
    memory = np.zeros(IDENTIFICATION_SIZE)
    memory[_ERROR : _ERROR + 2] = pressure + OUTWARD, temperature + OUTWARD
    memory[_COMPRESSOR], memory[_AMBIENT] = plant.driving_pressure, plant.ambient_temperature
    memory[_COVOLUME], memory[_CAPPED] = plant.covolume, math.isfinite(plant.ramp)
    memory[_TIME] = np.nan
    believe(believed(plant), width, memory)
    return memory


def believe(constants: np.ndarray, width: float, memory: np.ndarray) -> None:
    """Begin from `constants` (COUNT,), each known to the relative error `width`; 0: nothing is left to identify."""
    memory[CENTRE:HALF] = constants
    memory[HALF:ESTIMATE] = constants * width
    restart(memory)


@kernel
def restart(memory: np.ndarray) -> None:
    """Forget every reading."""
    for item in range(COUNT):
        centre, half = memory[CENTRE + item], memory[HALF + item]
        memory[LOW + item] = centre - half - OUTWARD * centre
        memory[HIGH + item] = centre + half + OUTWARD * centre
        memory[ESTIMATE + item] = centre
    memory[_FLOW:] = 0.0


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
    error, thermal = memory[_ERROR], memory[_ERROR + 1]
    return (
        held_mass(pressure - error, temperature + thermal, volume, memory[_COVOLUME]),
        held_mass(pressure + error, temperature - thermal, volume, memory[_COVOLUME]),
    )


@kernel
def _open_window(
    mode: int, pressure: float, temperature: float, volume: float, window: np.ndarray, memory: np.ndarray
) -> None:
    """Begin a window at the readings of a tank."""
    window[:] = 0.0
    window[_MODE], window[_READINGS] = mode, 1.0
    window[_LEAST], window[_MOST] = _mass_ends(pressure, temperature, volume, memory)
    window[_MEAN_MASS] = held_mass(pressure, temperature, volume, memory[_COVOLUME])
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
    mass = sign * held_mass(pressure, temperature, volume, memory[_COVOLUME])
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
    memory[_FLOW + 2 * coefficient] += weight * off_drive * off_drive
    memory[_FLOW + 2 * coefficient + 1] += weight * off_drive * off_mass
    return _narrow(coefficient, low, high, memory)


@inlined
def _product(one: tuple[float, float], other: tuple[float, float]) -> tuple[float, float]:
    """Between what the product of two numbers lies."""
    a, b, c, d = one[0] * other[0], one[0] * other[1], one[1] * other[0], one[1] * other[1]
    return min(a, b, c, d), max(a, b, c, d)


@kernel
def _narrow_heat(rate: int, temperature: float, window: np.ndarray, memory: np.ndarray) -> bool:
    """Narrow a heat rate (-1: the tank is closed) by what is known of the exchange, and the exchange by it."""
    error = memory[_ERROR + 1]
    seconds, opened = window[_READINGS], window[_OPEN]
    rise = temperature - window[_FIRST]
    pull = (window[_PULL] - 2.0 * seconds * error, window[_PULL] + 2.0 * seconds * error)
    heating = (0.0, 0.0)
    if rate >= 0 and opened != 0.0:
        item = _HEAT + rate
        flow = _product((memory[LOW + _EXCHANGE], memory[HIGH + _EXCHANGE]), pull)
        ends = (rise - 2.0 * error - flow[1]) / opened, (rise + 2.0 * error - flow[0]) / opened
        if not _narrow(item, min(ends), max(ends), memory):
            return False
        heating = _product((memory[LOW + item], memory[HIGH + item]), (opened, opened))
    if pull[0] <= 0.0 <= pull[1]:
        return True
    left = rise - 2.0 * error - heating[1], rise + 2.0 * error - heating[0]
    low, high = _product(left, (1.0 / pull[1], 1.0 / pull[0]))
    return _narrow(_EXCHANGE, low, high, memory)


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
        place = _RATE + 3 * rate
        memory[place] += weight * opened * opened
        memory[place + 1] += weight * opened * pull
        memory[place + 2] += weight * opened * rise
    memory[_SHARED] += weight * pull * pull
    memory[_SHARED + 1] += weight * pull * rise
    return _narrow_heat(rate, temperature, window, memory)


@inlined
def _kind_of(inlet: int, outlet: int, window: np.ndarray) -> int:
    """What a buffer's window is to be: a rest belongs to the one before it, and the first one after it to a rest."""
    kind = _FILLED if inlet else _GIVING if outlet else int(window[_MODE])
    return _CLOSED if kind == _NONE else kind


@kernel
def _learn_buffer(buffer: int, observation: Observation, model: Model, memory: np.ndarray) -> bool:
    """Take in what the second before did to a buffer."""
    begin = _WINDOWS + buffer * _ENTRIES
    window = memory[begin : begin + _ENTRIES]
    volume = model.buffer_volume[buffer]
    inlet, outlet = observation.previous >> buffer & 1, observation.previous >> (3 + buffer) & 1
    before, warmth = memory[_PRESSURE + buffer], memory[_TEMPERATURE + buffer]
    kind = _kind_of(inlet, outlet, window)
    if (kind != window[_MODE] and window[_MODE] != _CLOSED) or window[_READINGS] > WINDOW_MAX:
        _open_window(kind, before, warmth, volume, window, memory)
    window[_MODE] = kind
    window[_OPEN] += inlet - outlet
    window[_PULL] += memory[_AMBIENT] - warmth
    if inlet:
        window[_DRIVE] += memory[_COMPRESSOR] - before
    elif outlet and memory[_SEEN] >= 0.0 and memory[_CAPPED] == 0.0:
        window[_DRIVE] += before - memory[_PRESSURE + VEHICLE]
    elif outlet:
        window[_WEIGHT] = 0.0  # nobody knows against what pressure it gives, or that is not what makes it flow
    readings = (observation.pressure[buffer], observation.temperature[buffer], volume)
    coefficient, sign, rate = _INLET, 1.0, -1
    if kind == _GIVING:
        coefficient, sign, rate = _OUTLET, -1.0, 3 + buffer
    elif kind == _FILLED:
        rate = buffer
    consistent = _learn_flow(coefficient, sign, readings, 2.0 * memory[_ERROR], window, memory)
    consistent = _learn_heat(rate, observation.temperature[buffer], window, memory) and consistent
    window[_READINGS] += 1.0
    return consistent


@kernel
def _learn_vehicle(observation: Observation, memory: np.ndarray) -> bool:
    """Take in what the second before did to the vehicle; its window is its stay."""
    begin = _WINDOWS + VEHICLE * _ENTRIES
    window = memory[begin : begin + _ENTRIES]
    unknown = not observation.communication or memory[_CAPPED] != 0.0
    if unknown or observation.vehicle < 0 or observation.vehicle != memory[_SEEN]:
        window[_MODE] = _NONE
        return True
    volume = observation.vehicle_volume
    before, warmth = memory[_PRESSURE + VEHICLE], memory[_TEMPERATURE + VEHICLE]
    if window[_MODE] != _SERVED:
        _open_window(_SERVED, before, warmth, volume, window, memory)
    window[_PULL] += memory[_AMBIENT] - warmth
    for buffer in range(3):
        if observation.previous >> (3 + buffer) & 1:
            window[_OPEN] += 1.0
            window[_DRIVE] += memory[_PRESSURE + buffer] - before
    readings = (observation.vehicle_pressure, observation.vehicle_temperature, volume)
    consistent = _learn_flow(_OUTLET, 1.0, readings, 2.0 * memory[_ERROR], window, memory)
    consistent = _learn_heat(_RATES - 1, observation.vehicle_temperature, window, memory) and consistent
    window[_READINGS] += 1.0
    return consistent


@inlined
def _inside(item: int, value: float, memory: np.ndarray) -> float:
    """An estimate moved into the interval; the station's figure of a constant that is known."""
    if memory[HALF + item] == 0.0:
        return memory[CENTRE + item]
    return min(max(value, memory[LOW + item]), memory[HIGH + item])


@inlined
def _precision(item: int, memory: np.ndarray) -> float:
    """What the station's own figure of a constant counts in its estimate: one by its variance, if uniform."""
    return 1.0 / max(memory[HALF + item] ** 2 / 3.0, _NOWHERE * max(memory[CENTRE + item] ** 2, _NOWHERE))


@kernel
def _estimate(memory: np.ndarray) -> None:
    """Solve the normal equations: coefficients one by one, heat rates with the exchange they share."""
    for item in range(_FLOWS):
        prior = _precision(item, memory)
        squares, products = memory[_FLOW + 2 * item], memory[_FLOW + 2 * item + 1]
        value = (products + prior * memory[CENTRE + item]) / (squares + prior)
        memory[ESTIMATE + item] = _inside(item, value, memory)
    variance = memory[_ERROR + 1] ** 2 / 3.0
    prior = variance * _precision(_EXCHANGE, memory)
    squares, products = memory[_SHARED] + prior, memory[_SHARED + 1] + prior * memory[CENTRE + _EXCHANGE]
    for rate in range(_RATES):
        place, own = _RATE + 3 * rate, variance * _precision(_HEAT + rate, memory)
        both = memory[place + 1] / (memory[place] + own)
        squares -= both * memory[place + 1]
        products -= both * (memory[place + 2] + own * memory[CENTRE + _HEAT + rate])
    exchange = _inside(_EXCHANGE, products / squares, memory)
    memory[ESTIMATE + _EXCHANGE] = exchange
    for rate in range(_RATES):
        item, place = _HEAT + rate, _RATE + 3 * rate
        own = variance * _precision(item, memory)
        value = memory[place + 2] - exchange * memory[place + 1] + own * memory[CENTRE + item]
        memory[ESTIMATE + item] = _inside(item, value / (memory[place] + own), memory)


@inlined
def _finite(observation: Observation) -> bool:
    """Whether every reading is a number."""
    total = 0.0
    for buffer in range(3):
        total += observation.pressure[buffer] + observation.temperature[buffer]
    if observation.communication and observation.vehicle >= 0:
        total += observation.vehicle_pressure + observation.vehicle_temperature + observation.vehicle_volume
    return math.isfinite(total)


@kernel
def learn(observation: Observation, model: Model, memory: np.ndarray) -> None:
    """Take in the readings of this second and the command of the one before; `memory` (IDENTIFICATION_SIZE,).

    Buffer volumes come from `model`. Readings that do not follow on those before, a second earlier, and readings after
    one that is no number begin every window anew; readings no constant can explain begin the whole identification
    anew: the plant has changed.
    """
    usable = _finite(observation)
    if usable and observation.time - memory[_TIME] == observation.period:
        consistent = _learn_vehicle(observation, memory)
        for buffer in range(3):
            consistent = _learn_buffer(buffer, observation, model, memory) and consistent
        if not consistent:
            restart(memory)
        _estimate(memory)
    else:
        for tank in range(4):
            memory[_WINDOWS + tank * _ENTRIES + _MODE] = _NONE
    memory[_TIME] = observation.time if usable else math.nan
    reports = observation.communication and observation.vehicle >= 0
    memory[_SEEN] = observation.vehicle if reports else -1.0
    for buffer in range(3):
        memory[_PRESSURE + buffer] = observation.pressure[buffer]
        memory[_TEMPERATURE + buffer] = observation.temperature[buffer]
    memory[_PRESSURE + VEHICLE] = observation.vehicle_pressure if reports else math.nan
    memory[_TEMPERATURE + VEHICLE] = observation.vehicle_temperature if reports else math.nan


@kernel
def identified(known: ControlModel, memory: np.ndarray) -> ControlModel:
    """The station of `known` with the constants identified, and its limits as `known` has them.

    Eq. (7.11) is a limit on a flow, but is granted by what is known of it: the same pressure difference. So the
    flow it admits is that difference at the coefficient identified.
    """
    value = memory[ESTIMATE : ESTIMATE + COUNT]
    return ControlModel(
        known.buffer_volume, known.compressor_pressure, value[0], value[1], (value[2], value[3], value[4]),
        (value[5], value[6], value[7]), value[8], value[9], known.ambient_temperature, known.buffer_temperature_max,
        known.vehicle_temperature_max, known.dispenser_flow_max * (value[1] / known.outlet_coefficient),
        known.outlet_gap_min, known.hold_pressure, known.compressor_count, known.unfilled,
        known.buffer_pressure_min, known.buffer_temperature_min,
        known.driving_pressure, known.covolume, known.nozzle_flow, known.ramp, known.delivered_temperature,
        known.wall_conductance,
    )  # fmt: skip
