"""Liveness belongs to the slot: no vehicle waits for ever for a controller that gives it nothing."""

from __future__ import annotations

import io
import math

import numpy as np
import pytest
from hypothesis import strategies as st

from controllers import create
from controllers.registry import controllers
from station import Decision, Status, Valve, load_scenario, load_station, parse_scenario, simulate
from station.archives import unpack
from station.geometry import BUFFERS, VALVES
from station.live import AtEnd, LiveRun, SlotState
from station.metrics import incomplete, state_of_charge
from station.plants.thesis import gas_mass
from station.valves import limits_at
from tests.samples import samples

OURS = ("adaptive", "guarded", "reserve", "scenario", "switched")


class Idle:
    """Opens the valves of `command` in the seconds that `wanted` says, else nothing."""

    name, obeys_hold = "idle", True

    def __init__(self, liveness_s=60.0, command=0, wanted=lambda _time: True, fallback=None):
        self.liveness_s, self.command, self.wanted = liveness_s, command, wanted
        if fallback is not None:
            self.fallback = fallback

    def start(self, station):
        pass

    def decide(self, observation):
        return Decision(self.command if self.wanted(observation.time) else 0)


def day(*vehicles, station="thesis-fit", **options):
    names = ("time_s", "start_pressure_bar", "volume_m3", "finish_pressure_bar")
    arrivals = {"kind": "trace", "vehicles": [dict(zip(names, vehicle, strict=False)) for vehicle in vehicles]}
    return parse_scenario({"name": "day", "station": station, "arrivals": arrivals, **options})


def stood_in(record):
    return record["decision_status"] == Status.LIVENESS


@pytest.mark.parametrize("fallback", [None, create("logic")])
def test_logic_stands_in_when_nothing_has_been_given_for_so_long(fallback):
    record = simulate(load_scenario("S1"), Idle(60.0, fallback=fallback))
    assert not np.isnan(record.vehicles["finished"]).any()
    rows = np.flatnonzero(stood_in(record))
    assert rows[0] == 60
    assert record.metrics().t_liveness == len(rows)
    given = sum(record[name].astype(int) for name in VALVES[3:])
    assert not given[:60].any()
    assert given[60] == 1


def test_zero_means_never_and_the_station_says_the_default():
    alone = simulate(load_scenario("S1"), Idle(0.0))
    assert np.isnan(alone.vehicles["finished"]).all()
    assert not stood_in(alone).any()
    as_said = simulate(load_scenario("S1"), Idle(None))
    assert np.flatnonzero(stood_in(as_said))[0] == load_station("thesis-fit").slot.liveness_s
    other = parse_scenario({"name": "o", "arrivals": {"kind": "uniform", "count": 1, "period_s": 1.0}, "station": {
        "preset": "thesis-fit", "slot": {"liveness_s": 7.0}}})  # fmt: skip
    assert np.flatnonzero(stood_in(simulate(other, Idle(None))))[0] == 7


def test_the_thesis_controllers_are_reproduced_as_printed_and_others_are_live():
    """MINLP 1 is live at `thesis-fit-a` as well: with some fleets it would stand still for good there."""
    for name in controllers():
        actor = create(name)
        for preset in ("thesis-fit", "thesis-fit-a", "thesis-fit-b", "thesis-fit-cascade"):
            actor.start(load_station(preset))
            live = name in OURS or (preset, name) == ("thesis-fit-a", "minlp1")
            assert (actor.liveness_s is None or actor.liveness_s > 0) is live, (name, preset)
        actor.start(load_station("light-duty-700"))
        assert actor.liveness_s is None


@pytest.mark.parametrize("scenario", ["S1", "S2", "S3", "S4"])
@pytest.mark.parametrize("replication", [0, 1])
def test_liveness_changes_nothing_that_is_printed(scenario, replication):
    """Of MINLP 1 at `thesis-fit-a`, where it is on: the thesis's days are the same runs with it and without."""
    day = load_scenario(scenario).model_copy(update={"station": load_station("thesis-fit-a")})
    record, printed = (
        simulate(day, create("minlp1", **off), replication=replication) for off in ({}, {"liveness_s": 0})
    )
    assert all(np.array_equal(record[column], printed[column], equal_nan=True) for column in record.columns)


def test_the_side_that_acts_is_the_controllers_own():
    """A controller that compresses keeps its compressor while logic gives from another buffer."""
    inlet = int(Valve.INLET_LOW)
    record = simulate(load_scenario("S1"), Idle(60.0, command=inlet, fallback=create("logic")))
    beside = record["outlet_high"] | record["outlet_medium"]
    rows = stood_in(record) & (record["refused_inlet_low"] == 0) & (beside != 0)
    assert rows.any()
    assert record["inlet_low"][rows].all()
    assert not record["inlet_high"][rows].any()


def test_a_controller_that_gives_now_and_then_decides():
    record = simulate(load_scenario("S1"), Idle(60.0, int(Valve.OUTLET_HIGH), lambda time: time % 50 < 10))
    assert not stood_in(record)[:1000].any()


def test_a_fill_that_can_go_no_further_ends_incomplete_and_the_next_vehicle_connects():
    """Surroundings as warm as a tank may become: the first vehicle never cools below its limit again."""
    hot = {
        "preset": "thesis-fit", "thermal": {"ambient_temperature_c": 81.0, "buffer_temperature_max_c": 120.0},
        "slot": {"liveness_s": 60.0, "incomplete_s": 300.0},
    }  # fmt: skip
    scenario = day((0, 100, 0.14), (100, 600, 0.14), station=hot)
    record = simulate(scenario, create("switched"))
    left = incomplete(record)
    assert left[0]
    gone = np.flatnonzero(record["vehicle"] != 0)[0]
    assert record["time"][gone] > 300
    assert record.vehicles["connected"][1] == record["time"][gone]
    found = record.metrics()
    assert found.vehicles_incomplete == left.sum()
    assert found.vehicles_not_finished >= found.vehicles_incomplete
    charge = state_of_charge(record.vehicles, record.scenario.station.plant)
    full = gas_mass(record.vehicles["finish_pressure"], 15.0, record.vehicles["volume"])
    held = gas_mass(100.0, 25.0, 0.14) + record.vehicles["delivered"][0]
    assert charge[0] == pytest.approx(held / full[0], rel=1e-12)
    assert 0 < charge[0] < 1


def test_banks_just_below_their_least_pressure_are_filled_until_they_may_give():
    """Logic refills a bank when it has fallen by its hysteresis: before, all stood still for good."""
    least = {"high": 940.0, "medium": 745.0, "low": 495.0}
    station = {"preset": "h70-light", "real_gas": {"bank_pressure_min_bar": least}}
    arrivals = {"kind": "uniform", "count": 3, "period_s": 7200.0}
    record = simulate(parse_scenario({"name": "least", "station": station, "arrivals": arrivals}), create("logic"))
    assert np.isfinite(record.vehicles["finished"]).all()
    assert record.metrics().t_liveness > 0


@pytest.mark.parametrize("name", ["logic", "minlp1", *OURS])
@pytest.mark.parametrize(
    "vehicle", [(0, 50, 0.5, 350), (0, 50, 0.4, 698), (0, 5, 0.3, 600), (0, 2, 2.0, 350), (0, 100, 0.14, 800)]
)
def test_a_bus_is_served(name, vehicle):
    """What starved at every planner before: tanks beyond the usual one, starts below it, finishes above it."""
    record = simulate(day(vehicle, (600, 120, 0.14)), create(name, liveness_s=600))
    assert not np.isnan(record.vehicles["finished"]).any()


@pytest.mark.parametrize("name", ["logic", "minlp1", "minlp3", "reserve", "switched", "guarded"])
@pytest.mark.parametrize("volume", [0.1, 0.3, 0.6])
def test_an_unusual_tank_without_communication_does_not_hang_the_station(name, volume):
    record = simulate(day((0, 100, volume), (900, 100), communication=False), create(name, liveness_s=600))
    assert not np.isnan(record.vehicles["finished"]).any()


@samples(4, 60, data=st.data())
def test_whatever_a_controller_does_no_limit_breaks_and_nobody_waits_for_ever(data):
    """Random commands in random seconds: every vehicle leaves, filled or told, and the valves keep to the limits."""
    preset = data.draw(st.sampled_from(["thesis-fit", "thesis-fit-b", "light-duty-700"]))
    count = data.draw(st.integers(1, 3))
    usual = load_station(preset).vehicle.finish_pressure_bar
    fleet = {
        "name": "any", "volume_m3": [0.08, 1.0], "start_pressure_bar": [2.0, 250.0],
        "finish_pressure_bar": [300.0, usual],
    }  # fmt: skip
    arrivals = {"kind": "uniform", "count": 4, "period_s": 1500.0, "fleet": [fleet]}
    station = {"preset": preset, "compressor": {"count": count}, "slot": {"liveness_s": 40.0, "incomplete_s": 200.0}}
    scenario = parse_scenario(
        {"name": "any", "station": station, "arrivals": arrivals, "communication": data.draw(st.booleans()),
         "time_limit_s": 90_000.0}
    )  # fmt: skip
    span, valve = data.draw(st.integers(1, 90)), data.draw(st.integers(0, 63))
    record = simulate(
        scenario,
        Idle(None, valve, lambda time: time % 97 < span, create("logic")),
        replication=1 + data.draw(st.integers(0, 50)),
    )
    assert np.isnan(record.vehicles["finished"]).sum() == incomplete(record).sum()
    plant = scenario.plant()
    command = sum(record[name].astype(int) << bit for bit, name in enumerate(VALVES))
    for row in np.flatnonzero(stood_in(record))[::37]:
        limits = limits_at(
            tuple(float(record[f"pressure_{tank}"][row]) for tank in (*BUFFERS, "vehicle")),
            tuple(float(record[f"temperature_{tank}"][row]) for tank in (*BUFFERS, "vehicle")),
            True, int(command[row - 1]), False, plant, 1.0,
        )  # fmt: skip
        inlets, outlets = int(command[row]) & 7, int(command[row]) >> 3
        assert inlets & outlets == 0
        assert inlets.bit_count() <= count
        assert outlets.bit_count() <= 1
        assert not any(limits.outlet[buffer] for buffer in range(3) if outlets >> buffer & 1)
        assert not any(limits.inlet[buffer] for buffer in range(3) if inlets >> buffer & 1)


def test_a_live_run_stands_in_in_the_same_seconds_also_from_a_snapshot():
    scenario = load_scenario("S1")
    record = simulate(scenario, Idle(60.0))
    seat = SlotState(Idle(60.0).decide, liveness=60.0)
    run = LiveRun(scenario, AtEnd.STOP)
    for _ in range(45):
        run.step(seat)
    after = LiveRun(scenario, AtEnd.STOP)
    after.restore(run.snapshot())
    rows = []
    while not after.over:
        rows.append(after.step(seat).row)
    expected = np.array([record[name] for name in record.columns], float).T[45:]
    assert np.array(rows).tobytes() == expected.tobytes()


def test_a_snapshot_of_the_version_before_is_read():
    run = LiveRun(load_scenario("S1"), AtEnd.STOP)
    actor = create("logic")
    actor.start(run.scenario.station)
    seat = SlotState(actor.decide, actor.obeys_hold)
    for _ in range(100):
        run.step(seat)
    arrays = unpack(run.snapshot())
    arrays["numbers"][0] = 1
    arrays["state"] = arrays["state"][:15]
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    after = LiveRun(load_scenario("S1"), AtEnd.STOP)
    after.restore(stream.getvalue())
    assert np.array_equal(after.step(seat).row, run.step(seat).row, equal_nan=True)


def test_one_that_leaves_incomplete_is_told_by_a_live_run():
    station = {
        "preset": "thesis-fit", "thermal": {"ambient_temperature_c": 81.0, "buffer_temperature_max_c": 120.0},
        "slot": {"incomplete_s": 50.0},
    }  # fmt: skip
    run = LiveRun(day((0, 100, 0.14), station=station), AtEnd.STOP)
    seat = SlotState(Idle().decide, liveness=20.0)
    while (second := run.step(seat)).left < 0:
        assert not run.over
    assert second.left == 0
    assert math.isnan(second.figures["finished"])
    assert second.figures["delivered"] > 0
