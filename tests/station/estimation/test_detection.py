"""Faults of a hidden station are found and named, and a healthy one has none."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from station import load_station
from station.estimation.clock import skew_of
from station.estimation.detection import SIZE, Detector, detect, latest
from station.estimation.filter import STATES, follow
from station.frames import frames_of
from station.geometry import BUFFERS, VALVES
from station.measurement import samples_of
from station.sensor_names import ANALOG, POWER, SENSORS
from tests.station.estimation.hidden import day, hidden_station, leaking, measured, replayed, tags, truth

BEGIN = 40_000
END = BEGIN + 7200


def _followed(true, seed, until=None):
    cut = {name: read[:until] for name, read in true.items()}
    frames = frames_of(samples_of(measured(cut, seed), tags()))
    return frames, follow(frames, load_station("thesis-fit"))


def _events(true, seed, until=None):
    return detect(*_followed(true, seed, until))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_healthy_station_has_no_fault(near, seed):
    assert _events(near.true, seed) == []


@pytest.mark.parametrize("buffer", range(3))
def test_a_leak_is_found_and_named(near, buffer):
    """Of two hours: a buffer that has leaked for long is empty, and its sensor reads below its range."""
    (event,) = _events(leaking(near.station, near.record, buffer, BEGIN, 0.5, END), 10 + buffer)
    assert event.name == f"leak_{BUFFERS[buffer]}"
    assert BEGIN <= event.found_s <= BEGIN + 150
    assert abs(event.begin_s - BEGIN) < 120
    assert event.size == pytest.approx(0.5, abs=0.1)


@pytest.mark.slow
def test_small_leaks_are_found_at_calibrated_stations_and_none_in_thirty_healthy_days():
    known = load_station("thesis-fit")

    def found(station, seed, seconds, **more):
        record = day(station, seconds=seconds, **more)
        frames = frames_of(samples_of(measured(truth(record, seconds), seed), tags()))
        return detect(frames, follow(frames, known), known.model_copy(update={"calibrated": True}))

    for seed in range(301, 331):
        station = hidden_station(seed, spread=0.001)
        assert found(station, seed, 86_400) == []
        leak = {"kind": "leak", "buffer": BUFFERS[seed % 3], "rate_g_per_s": 0.1}
        (event,) = found(
            station, seed, 24_000, vehicles=11, faults=[{**leak, "begin_s": 20_000.0, "end_s": 24_000.0}]
        )  # fmt: skip
        assert event.name == f"leak_{leak['buffer']}"
        assert 20_000.0 < event.found_s <= 20_800.0
        assert event.size == pytest.approx(0.1, abs=0.04)


def test_a_weak_compressor_is_found(near):
    true = replayed(
        near.station, near.record, lambda row, state: None, END, compressor=lambda row: 0.8 if row >= BEGIN else 1.0
    )
    (event,) = _events(true, 6)
    assert event.name == "compressor_weak"
    assert BEGIN <= event.found_s <= BEGIN + 500
    assert event.size == pytest.approx(20, abs=3)


def _sensor(true, name, change):
    changed = {**true, name: true[name].copy()}
    change(changed[name])
    return changed


def _frozen(table, name, begin, end):
    """The table with a sensor that goes on saying its last value."""
    stuck = table[name].to_numpy(zero_copy_only=False).copy()
    stuck[begin:end] = stuck[:begin][np.isfinite(stuck[:begin])][-1]
    return table.set_column(table.column_names.index(name), name, [stuck])


@pytest.mark.parametrize("sensor", ["temperature_high", "pressure_vehicle", "flow_dispenser"])
def test_any_sensor_that_is_frozen_is_found(near, sensor):
    """Its last reading is one that flows, or of the vehicle that left before."""
    read = near.true[sensor]
    begin = np.flatnonzero(np.isfinite(read[:BEGIN]) & (read[:BEGIN] != 0))[-1] + 1
    frames = frames_of(samples_of(_frozen(measured(near.true, 7), sensor, begin, BEGIN + 3600), tags()))
    events = detect(frames, follow(frames, load_station("thesis-fit")))
    event = next(event for event in events if event.name == f"frozen_{sensor}")
    assert begin <= event.found_s <= begin + 70
    assert all(np.isfinite([event.begin_s, event.size]).all() and event.begin_s <= event.found_s for event in events)


def test_a_frozen_sensor_is_found(near):
    frames = frames_of(samples_of(_frozen(measured(near.true, 7), "pressure_medium", BEGIN, BEGIN + 3600), tags()))
    events = detect(frames, follow(frames, load_station("thesis-fit")))
    assert "frozen_pressure_medium" in {event.name for event in events}
    event = next(event for event in events if event.name == "frozen_pressure_medium")
    assert event.found_s <= BEGIN + 90


def test_a_sensor_that_is_off_is_found(near):
    true = _sensor(near.true, "pressure_high", lambda read: read.__setitem__(slice(BEGIN, None), read[BEGIN:] + 20))
    event = next(event for event in _events(true, 8) if event.name == "offset_pressure_high")
    assert BEGIN <= event.found_s <= BEGIN + 90
    assert event.size == pytest.approx(20, abs=3)


def test_a_sensor_that_was_frozen_once_is_still_seen_to_be_off(near):
    true = _sensor(near.true, "pressure_high", lambda read: read.__setitem__(slice(9000, None), read[9000:] + 20))
    table = measured({name: read[:10_800] for name, read in true.items()}, 8)
    frames = frames_of(samples_of(_frozen(table, "pressure_high", 3000, 3200), tags()))
    events = detect(frames, follow(frames, load_station("thesis-fit")))
    named = {event.name: event for event in events if event.name.endswith("pressure_high")}
    assert {"frozen_pressure_high", "offset_pressure_high"} <= set(named)
    assert named["offset_pressure_high"].found_s == pytest.approx(9030, abs=60)


@pytest.mark.parametrize(
    ("sensor", "spread"),
    [("pressure_high", 30.0), ("pressure_low", 4.0), ("temperature_high", 0.75), ("temperature_low", 2.0),
     ("pressure_vehicle", 4.0), ("flow_dispenser", 3.0)],
)  # fmt: skip
def test_a_noisy_sensor_is_told_once_and_is_not_off(near, sensor, spread):
    noise = spread * np.random.default_rng(5).standard_normal(len(near.true["time"]))
    true = _sensor(near.true, sensor, lambda read: read.__setitem__(slice(9000, None), (read + noise)[9000:]))
    events = [event for event in _events(true, 8, until=19_000) if event.name.endswith(sensor)]
    assert [event.name for event in events] == [f"noisy_{sensor}"]
    connected = np.flatnonzero(near.true["vehicle"][9000:] >= 0)[0] if "vehicle" in sensor or "disp" in sensor else 0
    assert 9000 <= events[0].found_s <= 9000 + connected + (60 if spread > 1 else 300)
    assert events[0].size == pytest.approx(spread, rel=0.15)


def test_single_outliers_are_no_noise(near):
    spikes = slice(9000, 12_600, 97)
    true = _sensor(near.true, "pressure_high", lambda read: read.__setitem__(spikes, read[spikes] + 200))
    assert _events(true, 8, until=14_400) == []


@pytest.mark.parametrize("sensor", ["pressure_medium", "temperature_vehicle", "flow_compressor", "inlet_low"])
def test_a_sensor_that_says_nothing_is_absent(near, sensor):
    true = _sensor(near.true, sensor, lambda read: read.__setitem__(slice(9000, 16_000), np.nan))
    (event,) = [each for each in _events(true, 8, until=19_000) if each.name.startswith("absent_")]
    assert event.name == f"absent_{sensor}"
    connected = np.flatnonzero(near.true["vehicle"][9000:] >= 0)[0] if "vehicle" in sensor else 0
    assert 9000 + connected + 119 <= event.found_s <= 9000 + connected + 130


def test_a_sensor_that_reads_seldom_is_not_absent(near):
    kept = np.arange(len(near.true["time"])) % 60 == 0
    true = {**near.true, "temperature_high": np.where(kept, near.true["temperature_high"], np.nan)}
    true["temperature_high"][9000:9500] = np.nan  # eight of its readings in a row
    assert _events(true, 8, until=14_400) == []
    true["temperature_high"][9000:9900] = np.nan
    assert [event.name for event in _events(true, 8, until=14_400)] == ["absent_temperature_high"]


def _ailing(near):
    """Three hours and more in which one thing after another is wrong."""
    until, rng = 12_600, np.random.default_rng(3)
    true = {name: read[:until].copy() for name, read in near.true.items()}
    true["pressure_high"][2000:3200] += 20
    true["temperature_low"][4000:5500] += 3 * rng.standard_normal(1500)
    true["flow_compressor"][6000:6500] = np.nan
    frames = frames_of(samples_of(_frozen(measured(true, 5), "pressure_medium", 7000, 7080), tags()))
    followed = follow(frames, load_station("thesis-fit"))
    leak = followed.states[:, STATES.index("leak_low")]
    leak[8000:8200] += 0.5
    leak[8700:8720] += 0.4  # again, before the size of the first one is told
    followed.states[12_500:, STATES.index("compressor_factor")] -= 0.2  # and one whose size ends with the record
    return frames, followed


NAMES = ["absent_flow_compressor", "compressor_weak", "frozen_pressure_medium", "leak_low", "leak_low",
         "noisy_temperature_low", "offset_pressure_high"]  # fmt: skip


@pytest.mark.parametrize("size", [1, 7, 3601])
def test_events_are_the_same_however_seconds_are_split_and_from_a_snapshot_on(near, size):
    frames, followed = _ailing(near)
    whole = detect(frames, followed)
    assert sorted(event.name for event in whole) == NAMES
    once = Detector(frames.measured)
    wanted = [*once.feed(frames, followed), *once.finish()]
    detector, told = Detector(frames.measured), []
    for k, (a, b) in enumerate(pairwise([*range(0, len(frames), size), len(frames)])):
        told += detector.feed(frames.part(a, b), followed.part(a, b))
        if k % 50 == 0:
            kept = detector.snapshot()
            detector = Detector(frames.measured)
            detector.restore(kept)
    told += detector.finish()
    assert told == wanted
    assert latest(told) == whole
    assert all(event.settled for event in whole)


def test_an_event_is_told_when_it_is_found_and_its_size_later(near):
    frames, followed = _ailing(near)
    detector = Detector(frames.measured)
    told = {}
    for second in range(2000, 3300):
        at = slice(second, second + 1)
        if second == 2000:
            detector.feed(frames.part(0, 2000), followed.part(0, 2000))
        for event in detector.feed(frames.part(at.start, at.stop), followed.part(at.start, at.stop)):
            told.setdefault(event.name, []).append((second, event))
        assert ("offset_pressure_high" in detector.active) == (
            "offset_pressure_high" in told and second <= 3200 + 330
        )  # fmt: skip
    (found, first), (settled, last) = told["offset_pressure_high"]
    assert (found, settled) == (first.found_s, first.found_s + SIZE - 1)
    assert replace(last, size=first.size, size_deviation=first.size_deviation, settled=False) == first
    assert last.size_deviation is not None
    assert last.settled
    assert first.size == pytest.approx(20, abs=3)


def test_nothing_is_said_of_sensors_without_a_tag(near):
    frames, followed = _ailing(near)
    kept = (*VALVES, "vehicle", *(name for name in ANALOG if name != "flow_compressor"))
    names = {event.name for event in detect(replace(frames, measured=kept), followed)}
    assert "absent_flow_compressor" not in names
    assert {"offset_pressure_high", "frozen_pressure_medium"} <= names
    assert set(frames.measured) == set(SENSORS) - {"vehicle_volume", POWER}


@pytest.mark.slow
@pytest.mark.parametrize("skew", [-6, -1, 0, 4, 6])
def test_a_clock_that_is_fast_is_found_though_parameters_are_wrong(near, skew):
    table = measured(near.true, 9, skew=skew)
    samples = samples_of(table, tags())
    assert skew_of(samples, tags(), hidden_station(5, 0.10)) == {"plc": 0.0, "transmitters": float(skew)}
    frames = frames_of(samples, {"transmitters": float(skew)})
    assert np.isfinite(frames["pressure_high"]).mean() > 0.97
