"""The compressor's power in place of its flow, and seconds that are kept as they were measured."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from controllers import create_from
from station import load_station, simulate
from station.archives import pack, unpack
from station.batches import Batch
from station.estimation.detection import detect
from station.estimation.filter import follow, model_of
from station.estimation.followed import FollowedRun
from station.estimation.online import OnlineFilter
from station.estimation.power import with_flow_of_power
from station.frames import Frames, frames_of
from station.measured_day import measured_day, tags_of_day
from station.measurement import TagMap, samples_of
from station.record import Record
from station.scenario import parse_scenario
from station.sensor_names import ANALOG, POWER, SENSORS

LOST, BEGIN = 20.0, 4000.0
"""What the compressor gives less [%], and since when [s]."""

VEHICLES = [60.0 + 800 * k for k in range(14)]
"""When they come [s]."""


@cache
def day(name: str) -> Record:
    """A day whose compressor gets weak and whose outlet sticks later, with a vehicle each 800 s."""
    scenario = {
        "name": "ailing", "station": load_station(name).model_dump(),
        "faults": [
            {"kind": "compressor_weak", "begin_s": BEGIN, "loss_percent": LOST},
            {"kind": "valve_stuck", "valve": "outlet_high", "position": "closed", "begin_s": 9000.0},
        ],
        "arrivals": {"kind": "trace", "vehicles": [{"time_s": t, "start_pressure_bar": 100.0} for t in VEHICLES]},
        "time_limit_s": 12_000.0,
    }  # fmt: skip
    return simulate(parse_scenario(scenario), create_from("logic"))


def tags_without(*sensors: str) -> TagMap:
    return TagMap(tags=[tag for tag in tags_of_day().tags if tag.sensor not in sensors])


def frames_without(name: str, *sensors: str) -> Frames:
    tags = tags_without(*sensors)
    return frames_of(samples_of(measured_day(day(name), seed=7), tags, "day"))


def test_power_tells_the_flow_that_no_meter_tells():
    """Within what the meter of power is off, of a healthy compressor and of a weak one."""
    known = load_station("h70-light")
    frames = frames_without("h70-light", "flow_compressor")
    assert not np.isfinite(frames["flow_compressor"]).any()
    told = with_flow_of_power(frames, model_of(known).power_of(known))["flow_compressor"]
    true = day("h70-light")["flow_compressor"][: len(frames)]
    filling = np.isfinite(told) & (true > 0.0)
    assert filling.sum() > 3000
    assert np.isfinite(told[true > 0.0]).mean() > 0.8
    ratio = told[filling] / true[filling]
    assert abs(np.median(ratio) - 1.0) < 0.01
    assert np.std(ratio) < 0.03


def test_a_weak_compressor_is_told_by_its_power():
    known = load_station("h70-light")
    frames = frames_without("h70-light", "flow_compressor")
    told = next(event for event in detect(frames, follow(frames, known), known) if event.name == "compressor_weak")
    assert BEGIN < told.found_s < BEGIN + 200
    assert told.size == pytest.approx(LOST, abs=5.0)


def test_a_meter_goes_before_power():
    known = load_station("h70-light")
    frames = frames_without("h70-light")
    ready = with_flow_of_power(frames, model_of(known).power_of(known))
    metered = np.isfinite(frames["flow_compressor"])
    assert np.array_equal(ready["flow_compressor"][metered], frames["flow_compressor"][metered])


@pytest.mark.parametrize("lacking", ["inlet_high", "pressures"])
def test_what_is_not_told_is_not_guessed(lacking):
    known = load_station("h70-light")
    frames = frames_without("h70-light", "flow_compressor")
    for name in SENSORS if lacking == "pressures" else [lacking]:
        if name == lacking or (lacking == "pressures" and name.startswith("pressure_")):
            frames[name][:] = np.nan
    ready = with_flow_of_power(frames, model_of(known).power_of(known))
    inlets = np.stack([frames[f"inlet_{bank}"] for bank in ("high", "medium", "low")])
    assert not np.isfinite(ready["flow_compressor"][np.nansum(inlets, axis=0) > 0.5]).any()


def test_the_power_of_the_thesis_compressor_says_nothing_of_its_flow():
    known = load_station("thesis-fit")
    frames = frames_without("thesis-fit", "flow_compressor")
    assert with_flow_of_power(frames, model_of(known).power_of(known)) is frames


@pytest.mark.parametrize("name", ["thesis-fit", "h70-light"])
@pytest.mark.parametrize("many", [1, 7, 400])
def test_what_is_kept_is_what_was_measured_however_it_comes(name, many):
    """A valve that sticks, and a flow that was reckoned, change what the filter reads, not what is told of the day."""
    tags = tags_without("flow_compressor")
    first, count = 8900, 600
    table = measured_day(day(name), seed=7)
    names = [tag.column for tag in tags.tags]
    cells = np.array([table[column].to_numpy(zero_copy_only=False) for column in names]).T[first : first + count]
    run, parts = FollowedRun(load_station(name), tags), []
    for begin in range(0, count, many):
        rows = cells[begin : begin + many]
        second, tag = np.nonzero(np.isfinite(rows))
        parts.append(run.push(Batch(tag, 1e9 + begin + second, rows[second, tag], np.full(tag.size, 2))))
        run = FollowedRun.restore(load_station(name), tags, run.snapshot()) if begin == 7 * 20 else run
    parts.append(run.finish())
    measured = np.concatenate([part.measured for part in parts])
    there = [SENSORS.index(tag.sensor) for tag in tags.tags]
    assert np.array_equal(measured[:, there], cells, equal_nan=True)
    assert np.isnan(measured[:, ANALOG.index("flow_compressor")]).all()


def test_seconds_that_an_older_version_held_are_read_without_its_missing_sensor():
    known = load_station("h70-light")
    frames = frames_without("h70-light", "flow_compressor", POWER)
    before = OnlineFilter(known)
    before.push(frames.part(0, 300))
    left = unpack(before.snapshot())
    older = pack({**{name: each for name, each in left.items() if not name.startswith("ready_")},
                  "values": left["values"][:, : SENSORS.index(POWER)]})  # fmt: skip
    again = OnlineFilter(known)
    again.begin_anew(older)
    held = again.held
    assert held is not None
    assert held.values.shape == (len(left["values"]), len(SENSORS))
    again.push(replace(frames.part(int(held.start - frames.start) + len(held), 400)))
    assert len(again.close().states)
