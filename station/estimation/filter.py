"""An extended Kalman filter of the thesis's plant with augmented states, one pass over a record of seconds.

Jazwinski 1970, *Stochastic Processes and Filtering Theory*, ch. 8 (extended filter); Friedland 1969,
doi:10.1109/TAC.1969.1099223 (biases as states); scalar measurements one after another after Bierman 1977,
*Factorization Methods for Discrete Sequential Estimation*. The equations are those of `station.plants.thesis`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from station.compiled import inlined, kernel
from station.errors import InputError
from station.geometry import BUFFERS, KELVIN, VEHICLE
from station.measurement import ANALOG, SENSORS, Frames
from station.parameters import Station
from station.plants.thesis import (
    THESIS,
    PlantConstants,
    buffer_temperature,
    gas_mass,
    gas_pressure,
    inlet_flow,
    next_mass,
    outlet_flow,
    vehicle_temperature,
)

STATES = (
    *(f"mass_{each}" for each in BUFFERS),
    *(f"temperature_{each}" for each in BUFFERS),
    "mass_vehicle",
    "temperature_vehicle",
    *(f"leak_{each}" for each in BUFFERS),
    "compressor_factor",
    "dispenser_factor",
    "ambient_deviation",
)
"""Names of the filter's states; units g, deg C, g/s, 1 and K."""

PLANT_STATES = 8
"""The first of them, the plant's own; the others are the robust form's."""

_MV, _TV, _LEAK, _KC, _KD, _AMBIENT = 6, 7, 8, 11, 12, 13
_N = len(STATES)
_FLOW_C, _FLOW_D = ANALOG.index("flow_compressor"), ANALOG.index("flow_dispenser")
_VALVES, _CONNECTED, _VOLUME = len(ANALOG), SENSORS.index("vehicle"), SENSORS.index("vehicle_volume")
_UNSEEN_GAS = 30.0  # what an outlet may give in a second in which nobody told which vehicle is connected [g]
_CLEAR = 8.0  # standard deviations between two readings of flow that tell whether a valve is open
_UNSEEN_HEAT = 0.3  # how much warmer a tank may get in a second whose valves nobody told [K]


class Tuning(NamedTuple):
    """How soft the filter's model is: standard deviations of what a second adds, and where a reading is an outlier."""

    mass: float  # [g]
    temperature: float  # [K]
    leak: float  # [g/s]
    factor: float  # [1]
    ambient: float  # [K]
    gate: float  # a reading so many standard deviations off is not used


STIFF = Tuning(mass=0.02, temperature=0.002, leak=0.0, factor=0.0, ambient=0.0, gate=6.0)
"""For a calibrated station: the plant's equations hold."""

ROBUST = Tuning(mass=0.5, temperature=0.01, leak=4e-3, factor=1e-3, ambient=3e-3, gate=6.0)
"""For the states of health: parameters may be half a percent off."""

_FIRST = (0.03, 0.02, 5.0)  # standard deviations at the beginning: leak [g/s], factors [1], ambient [K]


@dataclass(frozen=True)
class Followed:
    """What the filter found, second by second."""

    states: NDArray[
        np.float64
    ]  # (seconds, len(STATES)) after the second's readings; NaN of a vehicle that is not there
    deviations: NDArray[np.float64]  # (seconds, len(STATES)) standard deviations
    innovations: NDArray[np.float64]  # (seconds, len(ANALOG)) in standard deviations; NaN where nothing was read
    errors: NDArray[np.float64]  # (seconds, len(ANALOG)) in the sensor's unit
    gate: float

    @property
    def used(self) -> NDArray[np.float64]:
        """The innovations of the readings that were used; NaN elsewhere."""
        with np.errstate(invalid="ignore"):
            return np.where(np.abs(self.innovations) <= self.gate, self.innovations, np.nan)


@inlined
def _update(
    x: np.ndarray, cov: np.ndarray, size: int, h: np.ndarray, work: np.ndarray, error: float, variance: float,
    gate: float, bounded: bool,
) -> float:  # fmt: skip
    """One reading: `error` is it less its prediction. The innovation in standard deviations.

    Beyond the gate a reading is not used; where `bounded`, it counts as much as one at the gate (Huber 1964,
    doi:10.1214/aoms/1177703732), so that a weak machine is seen by the meter that says so.
    """
    spread = variance
    for i in range(size):
        total = 0.0
        for j in range(size):
            if h[j] != 0.0:
                total += cov[i, j] * h[j]
        work[i] = total
        spread += h[i] * total
    normal = error / np.sqrt(spread)
    if bounded and abs(normal) > gate:
        spread = abs(error / gate) * np.sqrt(spread)
    if bounded or abs(normal) <= gate:
        for i in range(size):
            gain = work[i] / spread
            x[i] += gain * error
            for j in range(size):
                cov[i, j] -= gain * work[j]
    return normal


@inlined
def _propagate(
    cov: np.ndarray, half: np.ndarray, size: int, rows: np.ndarray, cols: np.ndarray, terms: np.ndarray, count: int
) -> None:
    """`cov` becomes F cov F' for F = 1 + the given terms."""
    for i in range(size):
        for j in range(size):
            half[i, j] = cov[i, j]
    for k in range(count):
        r, c, v = rows[k], cols[k], terms[k]
        if r < size and c < size:
            for j in range(size):
                half[r, j] += v * cov[c, j]
    for i in range(size):
        for j in range(size):
            cov[i, j] = half[i, j]
    for k in range(count):
        r, c, v = rows[k], cols[k], terms[k]
        if r < size and c < size:
            for i in range(size):
                cov[i, r] += v * half[i, c]


@inlined
def _restart(cov: np.ndarray, place: int, variance: float) -> None:
    for j in range(_N):
        cov[place, j] = 0.0
        cov[j, place] = 0.0
    cov[place, place] = variance


@inlined
def _infer(
    valve: np.ndarray, unseen: np.ndarray, through: np.ndarray, first: int, read: float, noise: float, relative: float
) -> None:
    """Where nobody told some of three valves, what the flow meter read says of them, if it says so clearly."""
    if unseen[first] + unseen[first + 1] + unseen[first + 2] == 0.0 or np.isnan(read):
        return
    best, second, chosen, spread = np.inf, np.inf, 0, noise
    for opened in range(8):
        flow, possible = 0.0, True
        for v in range(3):
            is_open = opened >> v & 1 != 0
            if unseen[first + v] == 0.0 and is_open != (valve[first + v] != 0.0):
                possible = False
            flow += through[first + v] if is_open else 0.0
        if not possible:
            continue
        off = abs(read - flow)
        if off < best:
            best, second, chosen, spread = off, best, opened, np.sqrt(noise**2 + (relative * flow) ** 2)
        elif off < second:
            second = off
    if second - best >= _CLEAR * spread:
        for v in range(3):
            valve[first + v] = float(chosen >> v & 1)
            unseen[first + v] = 0.0


@kernel
def _run(
    values: np.ndarray, noise: np.ndarray, relative: np.ndarray, x: np.ndarray, cov: np.ndarray, size: int,
    plant: PlantConstants, usual: tuple[float, float, float], tuning: Tuning,
    states: np.ndarray, deviations: np.ndarray, innovations: np.ndarray, errors: np.ndarray,
) -> None:  # fmt: skip
    """Follow a record; `usual` is the pressure, temperature and volume of a vehicle of which nothing is known."""
    h, work, half = np.zeros(_N), np.zeros(_N), np.zeros((_N, _N))
    told_open = np.zeros(3)
    rows, cols, terms = np.zeros(64, np.int64), np.zeros(64, np.int64), np.zeros(64)
    pressure, by_mass, by_heat = np.zeros(4), np.zeros(4), np.zeros(4)
    volume, valve, unseen, through = np.zeros(4), np.zeros(6), np.zeros(6), np.zeros(6)
    for b in range(3):
        volume[b] = plant.buffer_volume[b]
    volume[VEHICLE] = usual[2]
    vehicle = -1.0
    for row in range(values.shape[0]):
        told = values[row, _CONNECTED]
        fresh = False
        if not np.isnan(told) and told != vehicle:
            vehicle = told
            fresh = vehicle >= 0.0
            volume[VEHICLE] = usual[2]
        if vehicle >= 0.0 and not np.isnan(values[row, _VOLUME]):
            volume[VEHICLE] = values[row, _VOLUME]
        if fresh:
            p, t = values[row, VEHICLE], values[row, 4 + VEHICLE]
            sp, st = noise[row, VEHICLE], noise[row, 4 + VEHICLE]
            if np.isnan(p):
                p, sp = usual[0], 100.0
            if np.isnan(t):
                t, st = usual[1], 10.0
            x[_MV], x[_TV] = gas_mass(p, t, volume[VEHICLE]), t
            _restart(cov, _MV, (x[_MV] * sp / p) ** 2 + (x[_MV] * st / (t + KELVIN)) ** 2)
            _restart(cov, _TV, st * st)
            cov[_MV, _TV] = cov[_TV, _MV] = -x[_MV] * st * st / (t + KELVIN)
        connected = vehicle >= 0.0
        doubt = np.isnan(told) and not (row + 1 < values.shape[0] and values[row + 1, _CONNECTED] == vehicle)
        for channel in range(8):
            innovations[row, channel] = np.nan
            errors[row, channel] = np.nan
            tank = channel % 4
            if tank == VEHICLE and (fresh or not connected):
                continue
            y = values[row, channel]
            if np.isnan(y):
                continue
            m, t = (_MV, _TV) if tank == VEHICLE else (tank, 3 + tank)
            h[:] = 0.0
            if channel < 4:
                expected = gas_pressure(x[m], x[t], volume[tank])
                h[m], h[t] = expected / x[m], expected / (x[t] + KELVIN)
            else:
                expected = x[t]
                h[t] = 1.0
            errors[row, channel] = y - expected
            innovations[row, channel] = _update(
                x, cov, size, h, work, y - expected, noise[row, channel] ** 2, tuning.gate, False
            )  # fmt: skip
        for tank in range(4):
            m, t = (_MV, _TV) if tank == VEHICLE else (tank, 3 + tank)
            if tank != VEHICLE or connected:
                pressure[tank] = gas_pressure(x[m], x[t], volume[tank])
                by_mass[tank], by_heat[tank] = pressure[tank] / x[m], pressure[tank] / (x[t] + KELVIN)
        for v in range(6):
            told = values[row, _VALVES + v]
            unseen[v] = 1.0 if np.isnan(told) else 0.0
            if not np.isnan(told):
                valve[v] = 1.0 if told >= 0.5 else 0.0
        for b in range(3):
            told_open[b] = valve[3 + b]
        for side in range(2):
            into = side == 0
            if into or connected:
                scale = x[_KC] if into else x[_KD]
                for b in range(3):
                    one = inlet_flow(pressure[b], plant) if into else outlet_flow(pressure[b], pressure[VEHICLE], plant)
                    through[3 * side + b] = scale * one
                _infer(valve, unseen, through, 3 * side, values[row, _FLOW_C + side], noise[row, _FLOW_C + side],
                       relative[_FLOW_C + side])  # fmt: skip
            else:  # nothing flows out, whatever the valves do
                for b in range(3, 6):
                    unseen[b], valve[b] = 0.0, 0.0
        known_flow_out = connected and not doubt
        known_in = unseen[0] + unseen[1] + unseen[2] == 0.0
        known_out = unseen[3] + unseen[4] + unseen[5] == 0.0
        for channel in range(_FLOW_C, _FLOW_D + 1):
            innovations[row, channel] = np.nan
            errors[row, channel] = np.nan
            y = values[row, channel]
            into = channel == _FLOW_C
            if np.isnan(y) or (into and not known_in) or (not into and not (known_out and known_flow_out)):
                continue
            h[:] = 0.0
            expected = 0.0
            for b in range(3):
                if into and valve[b] != 0.0:
                    one = inlet_flow(pressure[b], plant)
                    slope = -x[_KC] * plant.inlet_coefficient
                    h[b], h[3 + b] = slope * by_mass[b], slope * by_heat[b]
                    h[_KC] += one
                    expected += x[_KC] * one
                elif not into and valve[3 + b] != 0.0:
                    one = outlet_flow(pressure[b], pressure[VEHICLE], plant)
                    slope = x[_KD] * plant.outlet_coefficient
                    h[b], h[3 + b] = slope * by_mass[b], slope * by_heat[b]
                    h[_MV] -= slope * by_mass[VEHICLE]
                    h[_TV] -= slope * by_heat[VEHICLE]
                    h[_KD] += one
                    expected += x[_KD] * one
            if expected <= 0.0:
                continue
            spread = noise[row, channel] ** 2 + (relative[channel] * expected) ** 2
            errors[row, channel] = y - expected
            innovations[row, channel] = _update(x, cov, size, h, work, y - expected, spread, tuning.gate, size == _N)
        for i in range(_N):
            there = connected or i not in (_MV, _TV)
            states[row, i] = x[i] if there else np.nan
            deviations[row, i] = np.sqrt(max(cov[i, i], 0.0)) if there else np.nan
        for tank in range(4):  # readings of flow have moved them
            m, t = (_MV, _TV) if tank == VEHICLE else (tank, 3 + tank)
            if tank != VEHICLE or connected:
                pressure[tank] = gas_pressure(x[m], x[t], volume[tank])
                by_mass[tank], by_heat[tank] = pressure[tank] / x[m], pressure[tank] / (x[t] + KELVIN)
        count = 0
        gained, outlets = 0.0, 0.0
        warm = x[_AMBIENT] * plant.heat_exchange
        for b in range(3):
            inflow, outflow = 0.0, 0.0
            if valve[b] != 0.0:
                one = inlet_flow(pressure[b], plant)
                inflow = x[_KC] * one
                slope = -x[_KC] * plant.inlet_coefficient
                rows[count], cols[count], terms[count] = b, b, slope * by_mass[b]
                rows[count + 1], cols[count + 1], terms[count + 1] = b, 3 + b, slope * by_heat[b]
                rows[count + 2], cols[count + 2], terms[count + 2] = b, _KC, one
                count += 3
            open_outlet = connected and valve[3 + b] != 0.0
            if open_outlet:
                one = outlet_flow(pressure[b], pressure[VEHICLE], plant)
                outflow = x[_KD] * one
                slope = x[_KD] * plant.outlet_coefficient
                for k in range(2):
                    sign = -1.0 if k == 0 else 1.0
                    r = b if k == 0 else _MV
                    rows[count], cols[count], terms[count] = r, b, sign * slope * by_mass[b]
                    rows[count + 1], cols[count + 1], terms[count + 1] = r, 3 + b, sign * slope * by_heat[b]
                    rows[count + 2], cols[count + 2], terms[count + 2] = r, _MV, -sign * slope * by_mass[VEHICLE]
                    rows[count + 3], cols[count + 3], terms[count + 3] = r, _TV, -sign * slope * by_heat[VEHICLE]
                    rows[count + 4], cols[count + 4], terms[count + 4] = r, _KD, sign * one
                    count += 5
                outlets += 1.0
            gained += outflow
            rows[count], cols[count], terms[count] = b, _LEAK + b, -1.0
            rows[count + 1], cols[count + 1], terms[count + 1] = 3 + b, 3 + b, -plant.heat_exchange
            rows[count + 2], cols[count + 2], terms[count + 2] = 3 + b, _AMBIENT, plant.heat_exchange
            count += 3
            x[3 + b] = buffer_temperature(b, x[3 + b], valve[b], 1.0 if open_outlet else 0.0, plant, 1.0) + warm
            x[b] = max(next_mass(x[b], inflow, outflow + x[_LEAK + b], 1.0), 1.0)
        if connected:
            rows[count], cols[count], terms[count] = _TV, _TV, -plant.heat_exchange
            rows[count + 1], cols[count + 1], terms[count + 1] = _TV, _AMBIENT, plant.heat_exchange
            count += 2
            x[_TV] = vehicle_temperature(x[_TV], outlets, plant, 1.0) + warm
            x[_MV] = max(next_mass(x[_MV], gained, 0.0, 1.0), 1.0)
        _propagate(cov, half, size, rows, cols, terms, count)
        most_out = 0.0
        for b in range(3):
            most_in = unseen[b] * through[b]
            out = unseen[3 + b] * through[3 + b]
            if doubt and told_open[b] != 0.0:
                out = _UNSEEN_GAS
            most_out += out**2
            cov[b, b] += tuning.mass**2 + most_in**2 + out**2
            cov[3 + b, 3 + b] += tuning.temperature**2 + _UNSEEN_HEAT**2 * (unseen[b] + unseen[3 + b])
            cov[_LEAK + b, _LEAK + b] += tuning.leak**2
        cov[_MV, _MV] += tuning.mass**2 + most_out
        cov[_TV, _TV] += tuning.temperature**2 + _UNSEEN_HEAT**2 * (unseen[3] + unseen[4] + unseen[5])
        cov[_KC, _KC] += tuning.factor**2 if valve[0] + valve[1] + valve[2] > 0.0 else 0.0
        cov[_KD, _KD] += tuning.factor**2 if outlets > 0.0 else 0.0
        cov[_AMBIENT, _AMBIENT] += tuning.ambient**2


def refuse_unfollowed(station: Station) -> None:
    """Refuse a station whose plant is not followed yet.

    Raises
    ------
    InputError
        naming the plant.
    """
    if station.plant != THESIS.name:
        raise InputError(
            "station", [("plant", f"must be {THESIS.name!r}: no other is followed yet; given {station.plant!r}")]
        )


def follow(frames: Frames, station: Station, tuning: Tuning = ROBUST, plant: PlantConstants | None = None) -> Followed:
    """Follow a record with the filter; robust where the tuning lets a leak be, else the plant's own states alone.

    `plant`: constants instead of the station's own.

    Raises
    ------
    InputError
        if the station's plant is not followed.
    """
    refuse_unfollowed(station)
    constants = plant or station.constants()
    size = _N if tuning.leak > 0 else PLANT_STATES
    x, cov = np.zeros(_N), np.zeros((_N, _N))
    x[_KC] = x[_KD] = 1.0
    for b, buffer in enumerate(station.buffers.all):
        p, sp = _first(frames, b, buffer.initial_pressure_bar, 100.0)
        t, st = _first(frames, 4 + b, constants.ambient_temperature, 15.0)
        x[b], x[3 + b] = gas_mass(p, t, constants.buffer_volume[b]), t
        cov[b, b] = (x[b] * sp / p) ** 2 + (x[b] * st / (t + KELVIN)) ** 2
        cov[3 + b, 3 + b] = st * st
        cov[b, 3 + b] = cov[3 + b, b] = -x[b] * st * st / (t + KELVIN)
        if size == _N:
            cov[_LEAK + b, _LEAK + b] = _FIRST[0] ** 2
    if size == _N:
        cov[_KC, _KC] = cov[_KD, _KD] = _FIRST[1] ** 2
        cov[_AMBIENT, _AMBIENT] = _FIRST[2] ** 2
    usual = (station.vehicle.start_pressure_bar, station.vehicle.start_temperature_c, station.vehicle.volume_m3)
    n = len(frames)
    found = Followed(
        np.empty((n, _N)), np.empty((n, _N)), np.empty((n, len(ANALOG))), np.empty((n, len(ANALOG))), tuning.gate
    )  # fmt: skip
    _run(
        np.ascontiguousarray(frames.values), np.ascontiguousarray(frames.noise), frames.relative, x, cov, size, constants,
        usual, tuning, found.states, found.deviations, found.innovations, found.errors,
    )  # fmt: skip
    return found


def _first(frames: Frames, channel: int, otherwise: float, spread: float) -> tuple[float, float]:
    """The first reading of a channel within a minute and twice its noise, or what to assume."""
    early = frames.values[:60, channel]
    read = np.flatnonzero(np.isfinite(early))
    return (float(early[read[0]]), 2.0 * float(frames.noise[read[0], channel])) if len(read) else (otherwise, spread)
