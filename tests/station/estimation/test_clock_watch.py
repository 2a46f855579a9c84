"""Clocks of sources while a station is followed: found, put right, and nothing else taken for one."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np
import pytest

from controllers import create_from
from station import load_station, parse_scenario, simulate
from station.batches import Batch, batches_of
from station.estimation import followed as followed_runs
from station.estimation.detection import Event, latest
from station.estimation.followed import FollowedRun, FollowedSeconds
from station.measured_day import measured_day, tags_of_day
from station.measurement import TagMap
from tests.station.estimation.hidden import hidden_real_station, hidden_station

BEGIN, END, SECONDS = 6000.0, 12_000.0, 15_000
NAME = "clock_skew_transmitters"


@cache
def table(name: str, kind: str, controller: str = "switched", **fault):
    """A measured day at a station half a percent off."""
    station = hidden_station(3, 0.005, 0.0) if name == "thesis-fit" else hidden_real_station(3, 0.005, 0.0)
    rate = 6.0 if name == "thesis-fit" else 4.0
    faults = [{"kind": kind, "begin_s": BEGIN, "end_s": END, **fault}] if kind else []
    scenario = parse_scenario(
        {
            "name": "clocks", "station": station.model_dump(), "time_limit_s": float(SECONDS), "faults": faults,
            "arrivals": {"kind": "poisson", "rate_per_h": rate, "period_s": float(SECONDS)},
        }
    )  # fmt: skip
    return measured_day(simulate(scenario, create_from(controller), replication=3), seed=3)


def without(*sensors: str) -> TagMap:
    tags = tags_of_day()
    return tags.model_copy(update={"tags": [tag for tag in tags.tags if tag.sensor not in sensors]})


def followed(name: str, batches: Iterator[Batch], tags: TagMap, again_at: int = -1) -> FollowedSeconds:
    """All seconds of a run, which is taken up from a snapshot once."""
    known = load_station(name)
    run, parts = FollowedRun(known, tags), []
    for number, batch in enumerate(batches):
        if number == again_at:
            run = FollowedRun.restore(known, tags, run.snapshot())
        parts.append(run.push(batch))
    return FollowedSeconds.joined([*parts, run.finish()])


def clocks_in(found: FollowedSeconds) -> list[Event]:
    return [event for event in latest(found.events) if event.name.startswith("clock_skew")]


@pytest.mark.parametrize(
    ("name", "skew"),
    [("thesis-fit", 3), ("thesis-fit", -1), *(pytest.param("h70-light", k, marks=pytest.mark.slow) for k in (6, -4))],
)
def test_a_clock_that_jumps_is_found_put_right_and_put_back(name, skew):
    tags = tags_of_day()
    found = followed(name, batches_of(table(name, "clock_skew", skew_s=skew), tags, 600.0), tags)
    (event,) = clocks_in(found)
    assert (event.name, event.size, event.unit) == (NAME, float(skew), "s")
    assert event.begin_s >= BEGIN - 150.0
    assert event.begin_low_s <= BEGIN <= event.begin_high_s
    changes = np.flatnonzero(np.diff(found.skew))
    assert found.skew[changes + 1].tolist() == [skew, 0.0]
    right, back = found.time[changes + 1]
    assert BEGIN < right < BEGIN + 3000.0
    assert END < back < END + 3000.0
    assert np.array_equal(np.diff(found.time), np.ones(len(found) - 1))
    told = [event for event in latest(found.events) if right + 1.0 < event.found_s < END]
    assert not told
    wanted = followed(name, batches_of(table(name, ""), tags, 600.0), tags)
    settled = slice(int(right) + 900, int(END))
    banks = slice(0, 6)  # masses and temperatures
    off = (found.states[settled] - wanted.states[settled])[:, banks] / wanted.deviations[settled][:, banks]
    assert np.abs(off.mean(axis=0)).max() < 0.2


@pytest.mark.parametrize(
    ("each", "at"), [pytest.param(1.0, 6290.0, marks=pytest.mark.slow), (7.0, 6100.0), (400.0, 7000.0)]
)
def test_what_is_found_does_not_depend_on_batches_or_restarts(each, at):
    tags, day = tags_of_day(), table("thesis-fit", "clock_skew", skew_s=3).slice(0, 8000)
    wanted = followed("thesis-fit", batches_of(day, tags, 600.0), tags)
    assert {event.name for event in clocks_in(wanted)} == {NAME}
    found = followed("thesis-fit", batches_of(day, tags, each), tags, again_at=int(at / each))
    assert found.table().tobytes() == wanted.table().tobytes()
    assert found.skew.tobytes() == wanted.skew.tobytes()
    assert found.events == wanted.events


@pytest.mark.parametrize("skew", [6, pytest.param(-6, marks=pytest.mark.slow)])
def test_a_source_whose_clock_is_wrong_from_the_start_loses_no_sample(skew):
    """Six seconds are more than samples are waited for: those of the other source would all be late."""
    tags = tags_of_day()
    day = table("thesis-fit", "clock_skew", skew_s=skew).slice(int(BEGIN) + 10, 4000)
    run = FollowedRun(load_station("thesis-fit"), tags)
    parts = [run.push(batch) for batch in batches_of(day, tags, 1.0)]
    assert run.counts.late == 0
    assert run.active == (NAME,)
    assert FollowedSeconds.joined(parts).skew[-1] == skew


def test_a_source_that_falls_silent_holds_nobody_up():
    tags = tags_of_day()
    day = table("thesis-fit", "").slice(0, 400)
    run = FollowedRun(load_station("thesis-fit"), tags)
    transmitters = [number for number, tag in enumerate(tags.tags) if tag.source == "transmitters"]
    for batch in batches_of(day, tags, 1.0):
        here = ~np.isin(batch.tag, transmitters) | (batch.time < 300.0)
        run.push(Batch(batch.tag[here], batch.time[here], batch.value[here], batch.quality[here]))
    assert run.next_second is not None
    assert run.next_second > 390.0


OTHERS = [
    ("", {}),
    ("leak", {"buffer": "high", "rate_g_per_s": 1.0}),
    ("line_leak", {"rate_g_per_s": 2.0}),
    ("compressor_weak", {"loss_percent": 30.0}),
    ("compressor_tripped", {}),
    ("dispenser_clogged", {"loss_percent": 50.0}),
    ("valve_stuck", {"valve": "outlet_high", "position": "closed"}),
    ("valve_stuck", {"valve": "outlet_medium", "position": "open"}),
    ("valve_stuck", {"valve": "inlet_medium", "position": "closed"}),
    ("sensor_frozen", {"sensor": "pressure_high"}),
    ("sensor_offset", {"sensor": "pressure_medium", "offset_bar": 8.0}),
    ("sensor_noisy", {"sensor": "flow_dispenser", "noise_g_per_s": 8.0}),
    ("sensor_absent", {"sensor": "flow_compressor"}),
]


@pytest.mark.parametrize(
    ("name", "controller", "lacking"),
    [
        ("thesis-fit", "logic", ()),
        ("h70-light", "logic", ()),
        ("h70-light", "switched", ("flow_compressor", "flow_dispenser")),
        ("thesis-fit", "switched", ("power_compressor", "pressure_vehicle")),
    ],
)
@pytest.mark.slow
def test_nothing_else_is_taken_for_a_clock(name, controller, lacking):
    tags = without(*lacking)
    for kind, fault in OTHERS:
        found = followed(name, batches_of(table(name, kind, controller, **fault), tags, 600.0), tags)
        assert not found.skew.any(), (kind, fault)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["h35-bus", "h70-truck"])
def test_commands_that_change_every_third_second_are_no_clock(name):
    """By as many seconds earlier or later they fit nearly as well."""
    given = load_station(name)
    known = given.model_copy(update={"compressor": given.compressor.model_copy(update={"count": 2})})
    arrivals = {"kind": "poisson", "rate_per_h": 4.0, "period_s": 12_000.0}
    day = {"name": "day", "station": known.model_dump(), "arrivals": arrivals, "time_limit_s": 12_000.0}
    record = simulate(parse_scenario(day), create_from("minlp1"), replication=5)
    run = FollowedRun(known, tags_of_day())
    for batch in batches_of(measured_day(record, 5), tags_of_day(), 600.0):
        assert not run.push(batch).skew.any()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["thesis-fit", "h70-light"])
def test_each_of_three_clocks_is_found(name):
    """Two of them twelve seconds apart."""
    tags = tags_of_day()
    apart = [
        tag.model_copy(update={"source": "meters"}) if tag.sensor.startswith(("flow", "power")) else tag
        for tag in tags.tags
    ]
    skew, tags = {"plc": 0, "transmitters": 6, "meters": -6}, tags.model_copy(update={"tags": apart})
    shift = np.array([skew[tag.source] for tag in tags.tags], float)
    run = FollowedRun(load_station(name), tags)
    for batch in batches_of(table(name, ""), tags, 600.0):
        run.push(Batch(batch.tag, batch.time + shift[batch.tag], batch.value, batch.quality))
    assert run.active == ("clock_skew_meters", NAME)
    assert run.counts.late < 20
    assert {source: round(by) for source, by in run.skew.items()} == {"transmitters": 6, "meters": -6}


@pytest.mark.parametrize("skew", [3, -3])
def test_a_clock_that_was_found_is_known_behind_an_update_of_the_service(skew, monkeypatch):
    """Seconds that wait for later readings are not lost, and go on by the same clocks; estimates begin anew."""
    tags, known = tags_of_day(), load_station("thesis-fit")
    day = table("thesis-fit", "clock_skew", skew_s=skew).slice(0, 9000)
    run, told = FollowedRun(known, tags), []
    for number, batch in enumerate(batches_of(day, tags, 100.0)):
        if number == 80:
            assert run.active == (NAME,)
            left = run.snapshot()
            monkeypatch.setattr(followed_runs, "SNAPSHOT_VERSION", followed_runs.SNAPSHOT_VERSION + 1)
            run = FollowedRun.restore(known, tags, left)
            assert run.renewed
        told.append(run.push(batch))
    found = FollowedSeconds.joined([*told, run.finish()])
    assert run.active == (NAME,)
    assert np.array_equal(np.diff(found.time), np.ones(len(found) - 1))
