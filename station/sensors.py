"""A disturbed run: what noisy sensors report, and the limits a shield derives from it with margins."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from station.compiled import inlined
from station.controller import Observation
from station.geometry import OUTLETS, VEHICLE
from station.plants.interface import OWN
from station.plants.thesis import PlantConstants
from station.tube import TankInputs, TankInterval, below, interval_at, next_interval, pressure_interval
from station.valves import ValveLimits, inlet_limit, outlet_limit

OFF, EXACT, UNIFORM, CORNER = range(4)
"""Kinds of sensors: undisturbed run; errors none, uniform, or always at the ends of their half-widths."""

KINDS = {"exact": EXACT, "uniform": UNIFORM, "corner": CORNER}

TUBE = OWN - 4
"""Where the interval of a vehicle that reports nothing begins in RunState.state: Ends, four entries."""


def state_size(kind: int, own: int) -> int:
    """Entries of RunState.state: of an undisturbed run without the interval, where the plant has no `own` ones."""
    return TUBE if kind == OFF and own == 0 else OWN + own


_CHANNELS = 16
_TEMPERATURE = 8
_ADD, _ONE, _TWO = 0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB


class SensorModel(NamedTuple):
    """Sensors and knowledge of a run. In an undisturbed one (`kind` OFF) nothing else is looked at."""

    kind: int
    key: int  # seeds the errors
    pressure: float  # half-width of a pressure reading's error [bar]
    temperature: float  # of a temperature reading's [K]
    parameters: float  # relative, of the parameters'
    finish_pressure: float  # no vehicle that stays connected is above it [bar]
    usual_volume: float  # tank of a vehicle that reports nothing, known as the parameters are [m3]
    known_plant: PlantConstants  # the station with every limit moved by its margin


def key_of(seed: int, replication: int) -> int:
    """The key of a replication's sensor errors: below 2^63."""
    return int(np.random.SeedSequence([seed, replication, 3]).generate_state(1, np.uint64)[0] >> np.uint64(1))


@inlined
def _error(sensors: SensorModel, time: float, channel: int) -> float:
    """The error of a sensor at a time, in half-widths: splitmix64 of key, time and sensor.

    Steele et al. 2014, doi:10.1145/2660193.2660195. It depends on nothing else: every controller meets the
    same errors, and a record's readings can be found again.
    """
    if sensors.kind == EXACT:
        return 0.0
    place = np.uint64(np.int64(time)) * np.uint64(_CHANNELS) + np.uint64(channel + 1)
    mixed = np.uint64(sensors.key) + place * np.uint64(_ADD)
    mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(_ONE)
    mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(_TWO)
    mixed ^= mixed >> np.uint64(31)
    level = np.float64(mixed >> np.uint64(11)) * 2.0**-52 - 1.0
    if sensors.kind == CORNER:
        return 1.0 if level >= 0.0 else -1.0
    return level


@inlined
def read(value: float, tank: int, thermal: bool, time: float, sensors: SensorModel) -> float:
    """Reading of the sensor of a tank's pressure [bar], or temperature [deg C], at a time [s]."""
    if thermal:
        return value + sensors.temperature * _error(sensors, time, tank + _TEMPERATURE)
    return value + sensors.pressure * _error(sensors, time, tank)


@inlined
def _worst_ends(state: np.ndarray, sensors: SensorModel) -> tuple[float, float, float]:
    """Pressures [bar] and temperature [deg C] that stand for the readings of a vehicle that reports nothing.

    The lower pressure is the worst for the flow, the upper one for the gap; the margins count a reading's error,
    which the ends of the interval have already.
    """
    ends = TankInterval(state[TUBE], state[TUBE + 1], state[TUBE + 2], state[TUBE + 3])
    low, high = pressure_interval(ends)
    high = min(high, sensors.finish_pressure)
    return low + sensors.pressure, high - sensors.pressure, ends.warm - sensors.temperature


@inlined
def measure(state: np.ndarray, true: Observation, predicted: bool, sensors: SensorModel) -> Observation:
    """An observation of the truth through the sensors.

    Of a vehicle that reports nothing (`predicted`) it tells the careful ends of the interval, less the sensors'
    half-widths that the margins count: what the shield asks of the gap and of the temperature, a controller can see.
    """
    p, t, now = true.pressure, true.temperature, true.time
    vehicle_pressure, vehicle_temperature = true.vehicle_pressure, true.vehicle_temperature
    if predicted:
        _, vehicle_pressure, vehicle_temperature = _worst_ends(state, sensors)
    elif true.vehicle >= 0:
        vehicle_pressure = read(vehicle_pressure, VEHICLE, False, now, sensors)
        vehicle_temperature = read(vehicle_temperature, VEHICLE, True, now, sensors)
    return Observation(
        now,
        true.period,
        (read(p[0], 0, False, now, sensors), read(p[1], 1, False, now, sensors), read(p[2], 2, False, now, sensors)),
        (read(t[0], 0, True, now, sensors), read(t[1], 1, True, now, sensors), read(t[2], 2, True, now, sensors)),
        true.vehicle,
        vehicle_pressure,
        vehicle_temperature,
        true.vehicle_volume,
        true.communication,
        true.queue_length,
        true.previous,
        true.finish_pressure,
        true.announced,
        true.energy,
        true.timed,
    )


@inlined
def _outlet_limit(
    buffer: int,
    pressure: float,
    temperature: float,
    connected: bool,
    low: float,
    high: float,
    warm: float,
    known: PlantConstants,
    period: float,
) -> int:
    """The limit that forbids an outlet for some vehicle pressure between two [bar], or 0.

    The gap is least at the upper end and the flow largest at the lower one; in between neither is worse.
    """
    limit = outlet_limit(buffer, pressure, temperature, connected, high, warm, known, period)
    return limit if limit != 0 else outlet_limit(buffer, pressure, temperature, connected, low, warm, known, period)


@inlined
def tightened_limits(
    state: np.ndarray, observation: Observation, obeys_hold: bool, sensors: SensorModel
) -> ValveLimits:
    """The limit on each valve as far as readings tell: a valve with none breaks no limit in truth."""
    known, period, previous = sensors.known_plant, observation.period, observation.previous
    p, t = observation.pressure, observation.temperature
    connected = observation.vehicle >= 0
    low, high, warm = observation.vehicle_pressure, observation.vehicle_pressure, observation.vehicle_temperature
    if connected and not observation.communication:
        low, high, warm = _worst_ends(state, sensors)
    return ValveLimits(
        (
            inlet_limit(0, p[0], t[0], previous & 1 != 0, obeys_hold, known, period),
            inlet_limit(1, p[1], t[1], previous & 2 != 0, obeys_hold, known, period),
            inlet_limit(2, p[2], t[2], previous & 4 != 0, obeys_hold, known, period),
        ),
        (
            _outlet_limit(0, p[0], t[0], connected, low, high, warm, known, period),
            _outlet_limit(1, p[1], t[1], connected, low, high, warm, known, period),
            _outlet_limit(2, p[2], t[2], connected, low, high, warm, known, period),
        ),
    )


@inlined
def connect_tube(state: np.ndarray, observation: Observation, sensors: SensorModel) -> None:
    """Begin the interval of a vehicle that reports nothing, at its reading at connection."""
    ends = interval_at(
        observation.vehicle_pressure, observation.vehicle_temperature, sensors.pressure, sensors.temperature
    )  # fmt: skip
    state[TUBE], state[TUBE + 1], state[TUBE + 2], state[TUBE + 3] = ends.low, ends.high, ends.cold, ends.warm


@inlined
def advance_tube(state: np.ndarray, observation: Observation, command: int, sensors: SensorModel) -> None:
    """Carry that interval a second on under a command; at its end the vehicle is below its finish pressure or gone."""
    known, least, most = sensors.known_plant, 1.0 - sensors.parameters, 1.0 + sensors.parameters
    pull, rate, heating = (0.0, 0.0), (0.0, 0.0), (0.0, 0.0)
    for buffer in range(3):
        if command & OUTLETS & (8 << buffer):
            pressure = observation.pressure[buffer]
            pull = (pressure - sensors.pressure, pressure + sensors.pressure)
            usual = known.outlet_coefficient / sensors.usual_volume
            rate = (usual * least / most, usual * most / least)
            heating = (known.vehicle_heating * least, known.vehicle_heating * most)
    drive = TankInputs(
        pull,
        rate,
        heating,
        (known.heat_exchange * least, known.heat_exchange * most),
        (known.ambient_temperature - sensors.temperature, known.ambient_temperature + sensors.temperature),
    )
    ends = TankInterval(state[TUBE], state[TUBE + 1], state[TUBE + 2], state[TUBE + 3])
    ends = below(next_interval(ends, drive), sensors.finish_pressure)
    state[TUBE], state[TUBE + 1], state[TUBE + 2], state[TUBE + 3] = ends.low, ends.high, ends.cold, ends.warm
