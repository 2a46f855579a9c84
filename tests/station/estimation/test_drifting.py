"""Sensors of a calibrated station that drift are told, by nothing else, and leaks are no drift."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from benchmarks.drills import OFF
from benchmarks.following import HALF_DAY, WIDTH, day_of, played
from benchmarks.measured_forecasts import drawn_station
from benchmarks.measured_forecasts import measured as measured_with_noise
from station import load_station
from station.estimation.detection import detect
from station.estimation.filter import follow
from station.estimation.interface import Followed
from station.estimation.verdict import judged
from station.frames import Frames, frames_of
from station.geometry import BUFFERS
from station.measurement import samples_of
from station.sensor_names import ANALOG, BANK_SENSORS, SENSORS
from tests.station.estimation.hidden import day, hidden_station, measured, replayed, tags, truth
from tests.station.estimation.sensors import STATIONS

SECONDS, CARS, BEGIN = 50_000, 23, 15_000
AN_HOUR = 3.0  # [bar/h], [K/h]
LATEST = {"thesis-fit": 2400, "h70-light": 4000}  # [s]


@cache
def frames_and_known(name, faults=()):
    """A day of a station 0.1 % off, as calibrations leave it, and that station as it is known."""
    station = STATIONS[name](41, spread=0.001, ambient=1.0)
    given = [dict(each) for each in faults]
    table = measured(truth(day(station, CARS, SECONDS, faults=given), SECONDS), 41)
    return frames_of(samples_of(table, tags())), load_station(name).model_copy(update={"calibrated": True})


def drifting(frames: Frames, sensor: str, an_hour: float, end: int = SECONDS) -> Frames:
    values = frames.values.copy()
    seconds = np.arange(len(values))
    off = an_hour / 3600 * np.clip(seconds - BEGIN, 0, None) * (seconds < end)
    values[:, SENSORS.index(sensor)] += off
    return Frames(
        frames.start, values, frames.noise, frames.relative, frames.measured, frames.time_constants
    )  # fmt: skip


def told(frames, known) -> tuple[list, list[str], Followed]:
    followed = follow(frames, known)
    events = detect(frames, followed, known)
    return events, judged(followed, frames.start, events)[1], followed


@pytest.mark.slow
@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize("sensor", BANK_SENSORS)
@pytest.mark.parametrize("name", STATIONS)
def test_a_drift_is_told_by_nothing_else(name, sensor, way):
    """Also where it has gone on for ten hours, and is thirty times the noise."""
    frames, known = frames_and_known(name)
    events, refused, followed = told(drifting(frames, sensor, way * AN_HOUR), known)
    assert refused == []
    (event,) = events
    assert event.name == f"drift_{sensor}"
    assert BEGIN < event.found_s <= BEGIN + LATEST[name]
    assert abs(event.begin_s - BEGIN) < 1200
    assert event.size == pytest.approx(way * AN_HOUR, abs=1.5)
    assert event.unit == ("bar/h" if sensor.startswith("pressure") else "degC/h")
    off = followed.drifts.biases[-1, BANK_SENSORS.index(sensor)]
    assert off == pytest.approx(way * AN_HOUR * (SECONDS - BEGIN) / 3600, rel=0.25)


@pytest.mark.parametrize("sensor", ["pressure_low", "temperature_high"])
def test_a_drift_is_told_and_taken_off(sensor):
    frames, known = frames_and_known("thesis-fit")
    events, refused, followed = told(drifting(frames, sensor, AN_HOUR), known)
    assert refused == []
    assert [event.name for event in events] == [f"drift_{sensor}"]
    there = np.isfinite(followed.innovations[-3600:, ANALOG.index(sensor)])
    assert abs(followed.innovations[-3600:, ANALOG.index(sensor)][there].mean()) < 0.3


def test_a_sensor_that_was_put_right_is_right_again():
    frames, known = frames_and_known("thesis-fit")
    events, refused, followed = told(drifting(frames, "pressure_low", AN_HOUR, BEGIN + 6000), known)
    assert refused == []
    assert [event.name for event in events] == ["drift_pressure_low"]
    assert followed.drifts.lasts[BEGIN + 5900].any()
    assert not followed.drifts.lasts[-1].any()


@pytest.mark.parametrize("name", STATIONS)
@pytest.mark.parametrize(
    "rate", [pytest.param(0.1, marks=pytest.mark.slow), 0.5, pytest.param(2.0, marks=pytest.mark.slow)]
)
def test_a_leak_is_no_drift(name, rate):
    for buffer in BUFFERS:
        leak = {"kind": "leak", "buffer": buffer, "rate_g_per_s": rate, "begin_s": 20_000.0, "end_s": 24_000.0}
        events, _, _ = told(*frames_and_known(name, (tuple(leak.items()),)))
        assert [event.name for event in events] == [f"leak_{buffer}"]


FAULTS = [
    {"kind": "compressor_weak", "loss_percent": 20.0, "begin_s": 20_000.0},
    {"kind": "compressor_tripped", "begin_s": 20_000.0, "end_s": 24_000.0},
    {"kind": "dispenser_clogged", "loss_percent": 60.0, "begin_s": 20_000.0, "end_s": 24_000.0},
    {"kind": "precooler_weak", "warmer_k": 5.0, "begin_s": 20_000.0, "end_s": 24_000.0},  # of real gas alone
]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "fault"),
    [
        (name, fault)
        for name in STATIONS
        for fault in FAULTS
        if (name, fault["kind"]) != ("thesis-fit", "precooler_weak")
    ],
    ids=lambda each: each if isinstance(each, str) else each["kind"],
)
def test_a_machine_that_ails_is_no_drift(name, fault):
    events, _, _ = told(*frames_and_known(name, (tuple(fault.items()),)))
    assert fault["kind"].replace("tripped", "weak") in {event.name for event in events}
    assert [event.name for event in events if event.name.startswith("drift_")] == []


@pytest.mark.slow
@pytest.mark.parametrize("rate", [0.03, 0.04, 0.05])
@pytest.mark.parametrize("buffer", BUFFERS)
def test_a_small_leak_is_told_of_no_other_buffer(buffer, rate):
    """It may be taken for a drift at first; once the others seem to be off as well it is a leak."""
    leak = {"kind": "leak", "buffer": buffer, "rate_g_per_s": rate, "begin_s": float(BEGIN)}
    events, refused, _ = told(*frames_and_known("thesis-fit", (tuple(leak.items()),)))
    assert refused == []
    assert {event.name for event in events} <= {f"leak_{buffer}", f"drift_pressure_{buffer}"}


def test_parameters_that_are_wrong_by_a_little_are_no_drift():
    station = STATIONS["thesis-fit"](51, spread=0.003, ambient=5.0)
    frames = frames_of(samples_of(measured(truth(day(station, CARS, SECONDS), SECONDS), 51), tags()))
    known = load_station("thesis-fit").model_copy(update={"calibrated": True})
    assert told(frames, known)[:2] == ([], [])


@pytest.mark.parametrize("an_hour", [1.5, 10.0])
def test_slower_and_faster_drifts_are_told(an_hour):
    frames, known = frames_and_known("thesis-fit")
    events, refused, _ = told(drifting(frames, "pressure_low", an_hour), known)
    assert refused == []
    assert [event.name for event in events] == ["drift_pressure_low"]


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "begin"), [(6, 11_977), (16, 18_444)])
def test_a_fall_by_which_all_sensors_seem_off_stays_a_drift(seed, begin):
    """In air that waves, by a controller whose valves move every second; it was told as a leak an hour later."""
    fault = {"kind": "sensor_drift", "sensor": f"pressure_{BUFFERS[seed % 3]}", "drift_bar_per_h": -3.0}
    hidden = drawn_station("thesis-fit", seed, OFF / WIDTH)
    record = played(day_of(hidden, HALF_DAY, [{**fault, "begin_s": begin}]), "minlp1", 20_000 + seed)
    known = load_station("thesis-fit").model_copy(update={"calibrated": True})
    events, _, _ = told(measured_with_noise(record, 20_000 + seed), known)
    assert [event.name for event in events] == [f"drift_{fault['sensor']}"]


def test_air_that_waves_is_no_drift():
    station = STATIONS["thesis-fit"](60, spread=0.001, ambient=1.0)
    air = 5.0 * np.sin(2 * np.pi * np.arange(86_400) / 86_400 + 1.0)
    true = replayed(station, day(station), lambda _row, _state: None, 86_400, air=lambda row: air[row])
    known = load_station("thesis-fit").model_copy(update={"calibrated": True})
    assert told(frames_of(samples_of(measured(true, 60), tags())), known)[:2] == ([], [])


@pytest.mark.parametrize("name", STATIONS)
def test_of_a_healthy_station_no_drift_is_told(name):
    events, refused, followed = told(*frames_and_known(name))
    assert (events, refused) == ([], [])
    assert np.isfinite(followed.drifts.biases).all()


@cache
def _with_an_unknown_buffer():
    """A day of `switched`, which gives from low, and a station's file that has low's volume and cooling wrong."""
    hidden = hidden_station(41, spread=0.001)
    frames = frames_of(samples_of(measured(truth(day(hidden, CARS, SECONDS, "switched"), SECONDS), 41), tags()))
    low = hidden.buffers.low
    wrong = low.model_copy(
        update={"volume_m3": 0.88 * low.volume_m3, "outlet_cooling_k_per_s": 0.75 * low.outlet_cooling_k_per_s}
    )  # fmt: skip
    buffers = hidden.buffers.model_copy(update={"low": wrong})
    return frames, hidden.model_copy(update={"buffers": buffers, "calibrated": True, "unknown_buffers": ["low"]})


def test_a_buffer_that_is_not_known_spoils_nothing_that_is_told_of_others():
    """What low seems to lose, and what cools it, was laid to the air, and by that to the others' thermometers."""
    frames, known = _with_an_unknown_buffer()
    events, refused, followed = told(frames, known)
    assert np.ptp(frames["outlet_low"][np.isfinite(frames["outlet_low"])]) == 1.0
    assert (events, refused) == ([], [])
    low = [BANK_SENSORS.index(f"{kind}_low") for kind in ("pressure", "temperature")]
    assert followed.drifts is not None
    assert np.abs(followed.drifts.biases[:, low]).max() < 0.1


@pytest.mark.parametrize("sensor", ["pressure_high", "temperature_medium"])
def test_drift_is_told_beside_a_buffer_that_is_not_known(sensor):
    frames, known = _with_an_unknown_buffer()
    events, _, _ = told(drifting(frames, sensor, AN_HOUR), known)
    (event,) = events
    assert event.name == f"drift_{sensor}"
    assert BEGIN < event.found_s <= BEGIN + LATEST["thesis-fit"]
    assert event.size == pytest.approx(AN_HOUR, abs=1.5)


def test_a_station_that_was_not_calibrated_has_none():
    frames, known = frames_and_known("thesis-fit")
    _, _, followed = told(drifting(frames, "pressure_low", AN_HOUR), known.model_copy(update={"calibrated": False}))
    assert followed.drifts is None
