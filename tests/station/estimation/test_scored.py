"""Every fault of sensors that a scenario may list, but for drift, is found in its measured day, and nothing else is."""

from __future__ import annotations

from controllers import create_from
from station import load_station, simulate
from station.estimation.detection import detect
from station.estimation.filter import follow
from station.estimation.score import score
from station.frames import frames_of
from station.measured_day import measured_day, tags_of_day
from station.measurement import samples_of
from station.scenario import parse_scenario

FAULTS = [
    {"kind": "sensor_noisy", "sensor": "temperature_low", "begin_s": 3000, "end_s": 5000, "noise_k": 1.5},
    {"kind": "sensor_absent", "sensor": "flow_compressor", "begin_s": 6000, "end_s": 7000},
    {"kind": "sensor_offset", "sensor": "pressure_high", "begin_s": 8000, "end_s": 9000, "offset_bar": -15.0},
    {"kind": "sensor_noisy", "sensor": "pressure_vehicle", "begin_s": 10_000, "end_s": 13_000, "noise_bar": 3.0},
    {"kind": "sensor_frozen", "sensor": "temperature_medium", "begin_s": 14_000, "end_s": 14_090},
    {"kind": "sensor_absent", "sensor": "pressure_vehicle", "begin_s": 15_000, "end_s": 19_000},
]


def test_faults_of_sensors_are_found_and_nothing_else_is():
    station = load_station("thesis-fit")
    arriving = [{"time_s": 600.0 + 1500 * k, "start_pressure_bar": 120.0 + 5 * k} for k in range(13)]
    record = simulate(
        parse_scenario(
            {
                "name": "ailing",
                "station": station.model_dump(),
                "arrivals": {"kind": "trace", "vehicles": arriving},
                "time_limit_s": 20_000.0,
                "faults": FAULTS,
            }
        ),
        create_from("logic"),
    )
    frames = frames_of(samples_of(measured_day(record, seed=3), tags_of_day()))
    events = detect(frames, follow(frames, station))
    scored = score(events, list(record.scenario.faults), tags_of_day(), station)
    assert (scored["missed"], scored["false_events"]) == (0, [])
    assert {fault["untold"] for fault in scored["faults"]} == {None}
    assert [fault["found"] for fault in scored["faults"]] == [True] * len(FAULTS)
    for fault, wanted in zip(scored["faults"], (1.5, None, 15.0, 3.0, None, None), strict=True):
        assert (fault["size_error"] is None) == (wanted is None)
        assert wanted is None or abs(fault["size_error"]) < 0.2 * wanted
