"""Valves that stick and report what they are told are told apart, and taken for what they are."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from benchmarks.following import HALF_DAY, day_of, played
from benchmarks.measured_forecasts import drawn_station
from controllers import create_from
from station import load_station, parse_scenario, simulate
from station.estimation.detection import detect
from station.estimation.filter import follow, model_of
from station.estimation.online import OnlineFilter
from station.estimation.valves.memory import DISTRUSTED, MANY, SEAT
from station.estimation.valves.watch import ValveWatch
from station.estimation.verdict import judged
from station.frames import frames_of
from station.geometry import VALVES
from station.measured_day import measured_day, tags_of_day
from station.measurement import samples_of
from tests.station.estimation.hidden import day, measured, tags, truth
from tests.station.estimation.sensors import STATIONS

SECONDS, CARS, BEGIN, END = 32_000, 15, 10_000, 20_000


@cache
def frames_of_day(name, controller="switched", valve="", position="", skew=0.0):
    """A day of a station half a percent off, on which a valve sticks."""
    station = STATIONS[name](41, spread=0.005, ambient=3.0)
    fault = {"kind": "valve_stuck", "valve": valve, "position": position, "begin_s": BEGIN, "end_s": END}
    record = day(station, CARS, SECONDS, controller, [fault] if valve else [])
    return frames_of(samples_of(measured(truth(record, SECONDS), 41, skew=skew), tags()))


def found(name, *day_of):
    frames, known = frames_of_day(name, *day_of), load_station(name)
    followed = follow(frames, known)
    events = detect(frames, followed, known)
    return events, judged(followed, frames.start, events)[1], followed


SEEN = [
    *(
        (name, f"outlet_{bank}", position)
        for name in STATIONS
        for bank in ("high", "medium")
        for position in ("closed", "open")
    ),
    ("thesis-fit", "outlet_low", "closed"),
    ("thesis-fit", "outlet_low", "open"),
    ("thesis-fit", "inlet_low", "closed"),
    ("h70-light", "outlet_low", "closed"),
    ("h70-light", "inlet_medium", "closed"),
    ("h70-light", "inlet_medium", "open"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "valve", "position"), SEEN)
def test_a_valve_that_sticks_is_told(name, valve, position):
    events, _, followed = found(name, "switched", valve, position)
    mine = [event for event in events if event.name == f"stuck_{valve}"]
    assert [event.size for event in mine] == [float(position == "open")]
    assert BEGIN < mine[0].found_s < END
    assert {event.name for event in events if event.name.startswith("stuck_")} == {f"stuck_{valve}"}
    assert not followed.stuck[-1, : len(VALVES)].any(), "it works again"


@pytest.mark.parametrize("position", ["closed", "open"])
@pytest.mark.parametrize("name", STATIONS)
def test_masses_stay_known_behind_an_outlet_that_sticks(name, position):
    events, refused, followed = found(name, "switched", "outlet_medium", position)
    assert [event.name for event in events] == ["stuck_outlet_medium"]
    assert refused == []
    frames = frames_of_day(name, "switched", "outlet_medium", position)
    off = followed.errors[: END - 100, 1]
    there = np.isfinite(frames["pressure_medium"][: END - 100])
    assert np.nanmedian(np.abs(off[there])) < 1.0  # bar, of a noise of 1 bar


@pytest.mark.parametrize("controller", ["logic", "switched"])
@pytest.mark.parametrize("name", STATIONS)
def test_of_healthy_valves_none_is_told(name, controller):
    events, refused, followed = found(name, controller)
    assert (events, refused) == ([], [])
    assert not followed.stuck[:, : len(VALVES)].any()


def test_a_compressor_that_trips_is_no_valve():
    station = STATIONS["thesis-fit"](41, spread=0.005, ambient=3.0)
    trip = {"kind": "compressor_tripped", "begin_s": 10_011.0, "end_s": 13_000.0}
    frames = frames_of(
        samples_of(measured(truth(day(station, CARS, SECONDS, "switched", [trip]), SECONDS), 41), tags())
    )
    known = load_station("thesis-fit")
    assert {event.name for event in detect(frames, follow(frames, known), known)} == {"compressor_weak"}


def test_valves_nobody_told_do_not_stick():
    frames, known = frames_of_day("thesis-fit", "switched", "outlet_medium", "open"), load_station("thesis-fit")
    values = frames.values.copy()
    values[:, -len(VALVES) - 2 : -2] = np.nan
    kept = type(frames)(
        frames.start, values, frames.noise, frames.relative, frames.measured, frames.time_constants
    )  # fmt: skip
    _, judged_valves = ValveWatch(known, model_of(known)).advance(kept)
    assert not judged_valves[:, : len(VALVES)].any()


def test_where_a_clock_is_wrong_no_valve_is_blamed_for_long():
    frames, known = frames_of_day("thesis-fit", "switched", skew=-5.0), load_station("thesis-fit")
    _, judged_valves = ValveWatch(known, model_of(known)).advance(frames)
    told = np.flatnonzero(np.isfinite(judged_valves[:, len(VALVES) : SEAT]).any(1))
    assert len(told) <= 3 * MANY * (1 + SECONDS // DISTRUSTED)


def test_seconds_one_by_one_are_those_of_the_whole():
    frames, known = frames_of_day("thesis-fit", "switched", "outlet_medium", "open"), load_station("thesis-fit")
    whole, found_at_once = ValveWatch(known, model_of(known)).advance(frames)
    watch, parts = ValveWatch(known, model_of(known)), []
    for first in range(0, len(frames), 997):
        fresh = ValveWatch(known, model_of(known))
        fresh.restore(watch.snapshot())
        watch = fresh
        parts.append(watch.advance(frames.part(first, min(first + 997, len(frames)))))
    assert np.concatenate([found for _, found in parts]).tobytes() == found_at_once.tobytes()
    assert np.concatenate([each.values for each, _ in parts]).tobytes() == whole.values.tobytes()


@pytest.mark.parametrize("controller", ["logic", "switched"])
@pytest.mark.parametrize("name", STATIONS)
def test_a_line_that_leaks_is_told(name, controller):
    """One bank's leak is told before: only that of two says that it is the line."""
    station = STATIONS[name](41, spread=0.005, ambient=3.0)
    fault = {"kind": "line_leak", "rate_g_per_s": 2.0, "begin_s": BEGIN, "end_s": END}
    record = day(station, CARS, SECONDS, controller, [fault])
    known = load_station(name)
    frames = frames_of(samples_of(measured(truth(record, SECONDS), 41), tags()))
    followed = follow(frames, known)
    events = detect(frames, followed, known)
    assert [event.name for event in events][1:] == ["leak_line"]
    assert events[0].name.startswith("leak_")
    assert BEGIN < events[1].found_s < BEGIN + 3600
    assert judged(followed, frames.start, events)[1] == []


def test_a_filter_that_begins_anew_finds_no_valve():
    """Those of the seconds it holds are judged by nobody; each was told, second after second."""
    frames, known = frames_of_day("thesis-fit"), load_station("thesis-fit")
    before = OnlineFilter(known)
    before.push(frames.part(0, 200))
    again = OnlineFilter(known)
    again.begin_anew(before.snapshot())
    held = again.held
    assert held is not None
    first = int(held.start - frames.start) + len(held)
    parts = [again.push(frames.part(first, 400)), again.close()]
    assert not np.isfinite(np.concatenate([part.stuck[:, len(VALVES) : SEAT] for part in parts])).any()


@pytest.mark.slow
@pytest.mark.parametrize("controller", ["logic", "switched"])
@pytest.mark.parametrize("name", ["thesis-fit-cascade", "h35-bus"])
def test_gas_that_cools_or_warms_moves_through_no_valve(name, controller):
    """A bank that was filled cools while another one gives, and its pressure falls as if it gave as well."""
    given = load_station(name)
    for count in (1, 2):
        known = given.model_copy(update={"compressor": given.compressor.model_copy(update={"count": count})})
        arrivals = {"kind": "poisson", "rate_per_h": 5.0, "period_s": 12_000.0}
        station = {"station": known.model_dump(), "arrivals": arrivals, "time_limit_s": 12_000.0}
        for replication in (5, 6, 7):
            scenario = parse_scenario({"name": "healthy", **station})
            record = simulate(scenario, create_from(controller), replication=replication)
            frames = frames_of(samples_of(measured_day(record, replication), tags_of_day(), "day"))
            assert detect(frames, follow(frames, known), known) == [], (count, replication)


def test_an_inlet_through_which_little_flows_is_not_closed():
    """A compressor against nearly its own pressure gave a tenth of what it gives another bank, a second at a time.

    Its inlet was taken for one that lets nothing through: the bank's temperature was off, and the meter noisy.
    """
    station = drawn_station("thesis-fit", 4).model_copy(update={"calibrated": True})
    record = played(day_of(station, HALF_DAY), "logic", 10_400)
    flow = np.asarray(record["flow_compressor"])
    assert np.count_nonzero((flow > 0.02 * flow.max()) & (flow < 0.2 * flow.max())) > 100
    frames = frames_of(samples_of(measured_day(record, 10_400), tags_of_day()))
    followed = follow(frames, station)
    assert np.array_equal(followed.stuck[:, : len(VALVES)], np.zeros((len(frames), len(VALVES))))
    events = detect(frames, followed, station)
    assert (events, judged(followed, frames.start, events)[1]) == ([], [])
