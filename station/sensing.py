"""A disturbed run: what noisy sensors report, and the limits a shield derives from it with margins."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from station.compiled import inlined, kernel
from station.controller import Observation
from station.limits import OUTLETS, VALVES, Admission, inlet_limit, outlet_limit
from station.plant import BUFFERS, VEHICLE, PlantConstants
from station.tube import Drive, Ends, below, ends_at, next_ends, pressure_ends

if TYPE_CHECKING:
    from station.record import Record

OFF, EXACT, UNIFORM, CORNER = range(4)
"""Kinds of sensors: undisturbed run; errors none, uniform, or always at the ends of their half-widths."""

KINDS = {"exact": EXACT, "uniform": UNIFORM, "corner": CORNER}

TUBE = 18
"""Where the interval of a vehicle that reports nothing begins in Run.state: Ends, four entries."""

STATE_SIZE = TUBE + 4
"""Entries of Run.state in a disturbed run."""

_CHANNELS = 16
_TEMPERATURE = 8
_ADD, _ONE, _TWO = 0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB


class Sensing(NamedTuple):
    """Sensors and knowledge of a run. In an undisturbed one (`kind` OFF) nothing else is looked at."""

    kind: int
    key: int  # seeds the errors
    pressure: float  # half-width of a pressure reading's error [bar]
    temperature: float  # of a temperature reading's [K]
    parameters: float  # relative, of the parameters'
    finish_pressure: float  # no vehicle that stays connected is above it [bar]
    usual_volume: float  # tank of a vehicle that reports nothing, known as the parameters are [m3]
    told: PlantConstants  # the station with every limit moved by its margin


def key_of(seed: int, replication: int) -> int:
    """The key of a replication's sensor errors: below 2^63."""
    return int(np.random.SeedSequence([seed, replication, 3]).generate_state(1, np.uint64)[0] >> np.uint64(1))


@inlined
def _error(sensing: Sensing, time: float, channel: int) -> float:
    """The error of a sensor at a time, in half-widths: splitmix64 of key, time and sensor.

    Steele et al. 2014, doi:10.1145/2660193.2660195. It depends on nothing else: every controller meets the
    same errors, and a record's readings can be found again.
    """
    if sensing.kind == EXACT:
        return 0.0
    place = np.uint64(np.int64(time)) * np.uint64(_CHANNELS) + np.uint64(channel + 1)
    mixed = np.uint64(sensing.key) + place * np.uint64(_ADD)
    mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(_ONE)
    mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(_TWO)
    mixed ^= mixed >> np.uint64(31)
    level = np.float64(mixed >> np.uint64(11)) * 2.0**-52 - 1.0
    if sensing.kind == CORNER:
        return 1.0 if level >= 0.0 else -1.0
    return level


@inlined
def read(value: float, tank: int, thermal: bool, time: float, sensing: Sensing) -> float:
    """What the sensor of a tank's pressure [bar], or temperature [deg C], reports at a time [s]."""
    if thermal:
        return value + sensing.temperature * _error(sensing, time, tank + _TEMPERATURE)
    return value + sensing.pressure * _error(sensing, time, tank)


@inlined
def _careful(state: np.ndarray, sensing: Sensing) -> tuple[float, float, float]:
    """Pressures [bar] and temperature [deg C] that stand for the readings of a vehicle that reports nothing.

    The lower pressure is the worst for the flow, the upper one for the gap; the margins count a reading's error,
    which the ends of the interval have already.
    """
    ends = Ends(state[TUBE], state[TUBE + 1], state[TUBE + 2], state[TUBE + 3])
    low, high = pressure_ends(ends)
    high = min(high, sensing.finish_pressure)
    return low + sensing.pressure, high - sensing.pressure, ends.warm - sensing.temperature


@inlined
def sensed(state: np.ndarray, true: Observation, predicted: bool, sensing: Sensing) -> Observation:
    """An observation of the truth through the sensors.

    Of a vehicle that reports nothing (`predicted`) it tells the careful ends of the interval, less the sensors'
    half-widths that the margins count: what the shield asks of the gap and of the temperature, a controller can see.
    """
    p, t, now = true.pressure, true.temperature, true.time
    vehicle_pressure, vehicle_temperature = true.vehicle_pressure, true.vehicle_temperature
    if predicted:
        _, vehicle_pressure, vehicle_temperature = _careful(state, sensing)
    elif true.vehicle >= 0:
        vehicle_pressure = read(vehicle_pressure, VEHICLE, False, now, sensing)
        vehicle_temperature = read(vehicle_temperature, VEHICLE, True, now, sensing)
    return Observation(
        now,
        true.period,
        (read(p[0], 0, False, now, sensing), read(p[1], 1, False, now, sensing), read(p[2], 2, False, now, sensing)),
        (read(t[0], 0, True, now, sensing), read(t[1], 1, True, now, sensing), read(t[2], 2, True, now, sensing)),
        true.vehicle,
        vehicle_pressure,
        vehicle_temperature,
        true.vehicle_volume,
        true.communication,
        true.queue_length,
        true.previous,
        true.finish_pressure,
        true.announced,
    )


@inlined
def _outlet_limit(
    pressure: float, connected: bool, low: float, high: float, warm: float, told: PlantConstants, period: float
) -> int:
    """The limit that forbids an outlet for some vehicle pressure between two [bar], or 0.

    The gap is least at the upper end and the flow largest at the lower one; in between neither is worse.
    """
    limit = outlet_limit(pressure, connected, high, warm, told, period)
    return limit if limit != 0 else outlet_limit(pressure, connected, low, warm, told, period)


@inlined
def cautious_limits(state: np.ndarray, observation: Observation, obeys_hold: bool, sensing: Sensing) -> Admission:
    """The limit on each valve as far as readings tell: a valve with none breaks no limit in truth."""
    told, period, previous = sensing.told, observation.period, observation.previous
    p, t = observation.pressure, observation.temperature
    connected = observation.vehicle >= 0
    low, high, warm = observation.vehicle_pressure, observation.vehicle_pressure, observation.vehicle_temperature
    if connected and not observation.communication:
        low, high, warm = _careful(state, sensing)
    return Admission(
        (
            inlet_limit(0, p[0], t[0], previous & 1 != 0, obeys_hold, told, period),
            inlet_limit(1, p[1], t[1], previous & 2 != 0, obeys_hold, told, period),
            inlet_limit(2, p[2], t[2], previous & 4 != 0, obeys_hold, told, period),
        ),
        (
            _outlet_limit(p[0], connected, low, high, warm, told, period),
            _outlet_limit(p[1], connected, low, high, warm, told, period),
            _outlet_limit(p[2], connected, low, high, warm, told, period),
        ),
    )


@inlined
def connect_tube(state: np.ndarray, observation: Observation, sensing: Sensing) -> None:
    """Begin the interval of a vehicle that reports nothing, at its reading at connection."""
    ends = ends_at(
        observation.vehicle_pressure, observation.vehicle_temperature, sensing.pressure, sensing.temperature
    )  # fmt: skip
    state[TUBE], state[TUBE + 1], state[TUBE + 2], state[TUBE + 3] = ends.low, ends.high, ends.cold, ends.warm


@inlined
def advance_tube(state: np.ndarray, observation: Observation, command: int, sensing: Sensing) -> None:
    """Carry that interval a second on under a command; at its end the vehicle is below its finish pressure or gone."""
    told, least, most = sensing.told, 1.0 - sensing.parameters, 1.0 + sensing.parameters
    pull, rate, heating = (0.0, 0.0), (0.0, 0.0), (0.0, 0.0)
    for buffer in range(3):
        if command & OUTLETS & (8 << buffer):
            pressure = observation.pressure[buffer]
            pull = (pressure - sensing.pressure, pressure + sensing.pressure)
            usual = told.outlet_coefficient / sensing.usual_volume
            rate = (usual * least / most, usual * most / least)
            heating = (told.vehicle_heating * least, told.vehicle_heating * most)
    drive = Drive(
        pull,
        rate,
        heating,
        (told.heat_exchange * least, told.heat_exchange * most),
        (told.ambient_temperature - sensing.temperature, told.ambient_temperature + sensing.temperature),
    )
    ends = Ends(state[TUBE], state[TUBE + 1], state[TUBE + 2], state[TUBE + 3])
    ends = below(next_ends(ends, drive), sensing.finish_pressure)
    state[TUBE], state[TUBE + 1], state[TUBE + 2], state[TUBE + 3] = ends.low, ends.high, ends.cold, ends.warm


@kernel
def _read_again(times: np.ndarray, values: np.ndarray, thermal: bool, sensing: Sensing) -> np.ndarray:
    found = np.empty_like(values)
    for row in range(values.shape[1]):
        for tank in range(values.shape[0]):
            found[tank, row] = read(values[tank, row], tank, thermal, times[row], sensing)
    return found


def readings(record: Record) -> tuple[np.ndarray, np.ndarray]:
    """The pressures [bar] and temperatures [deg C] that the sensors reported, each (4, rows); NaN without a vehicle.

    Without communication the vehicle's row holds the reading of its connection only; the rest is NaN.
    """
    sensing = record.scenario.sensing(record.replication)
    found = []
    for what in ("pressure", "temperature"):
        true = np.array([record[f"{what}_{tank}"] for tank in (*BUFFERS, "vehicle")])
        if not record.scenario.communication:
            vehicle = record["vehicle"]
            true[VEHICLE, 1:][vehicle[1:] == vehicle[:-1]] = np.nan
        read_again = true if sensing.kind == OFF else _read_again(record["time"], true, what == "temperature", sensing)
        found.append(read_again)
    return found[0], found[1]


def observations(record: Record) -> Iterator[Observation]:
    """What the sensors reported second by second, for anyone who looks at a run afterwards.

    Of a vehicle without communication it holds what was reported at its connection; NaN later, when nothing is.
    """
    pressure, temperature = readings(record)
    scenario = record.scenario
    command = np.bitwise_or.reduce([record[valve].astype(int) << bit for bit, valve in enumerate(VALVES)])
    for row in range(len(record)):
        vehicle = int(record["vehicle"][row])
        known = scenario.communication and vehicle >= 0
        p, t = pressure[:, row].tolist(), temperature[:, row].tolist()
        yield Observation(
            float(record["time"][row]), 1.0, tuple(p[:VEHICLE]), tuple(t[:VEHICLE]), vehicle, p[VEHICLE], t[VEHICLE],
            float(record.vehicles["volume"][vehicle]) if known else scenario.station.vehicle.volume_m3,
            scenario.communication, int(record["queue_length"][row]), int(command[row - 1]) if row else 0,
        )  # fmt: skip
