"""A twin's figures by day are the metrics of the record of the same seconds, wherever days and restarts cut it."""

from __future__ import annotations

import math
import sys
import time

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from api.twins.day_bill import BILL
from api.twins.day_schemas import TwinDay
from api.twins.days import DAY_S, FLOATS, UNITS, Days, document
from api.twins.messages import COLUMNS, EventKind
from api.twins.schemas import TwinRequest
from controllers import create_from
from station import Limit, load_scenario, load_station, parse_scenario, simulate
from station.geometry import VALVES
from station.live import AtEnd, LiveRun
from station.metrics import UNITS as METRICS
from station.metrics import Metrics
from tests.station.test_live import _seat

CODES = slice(list(COLUMNS).index(VALVES[0]), list(COLUMNS).index("decision_status") + 1)
"""What a second does and what refuses it: equal as long as nothing changes."""
NOTHING = Metrics(**dict.fromkeys(METRICS, 0.0))
SUMS = {
    "compressor_s": "t_comp", "dispensing_s": "t_dis", "delivered_kg": "delivered", "energy_kwh": "energy_kwh",
    "compressor_starts": "compressor_starts", "refused_valves": "refused_valves",
}  # fmt: skip
"""Figures that add up over days, and what metrics call them."""


def lived(scenario, controller, day_s, restarts=(), replication=0, seed=0):
    """Days of a live run, told by days and restarted from a snapshot after some seconds."""

    def made():
        return LiveRun(scenario, AtEnd.STOP, replication, seed), Days(scenario, day_s)

    (run, days), seat = made(), _seat(create_from(controller), scenario.station)
    ended = []
    while not run.over:
        second = run.step(seat)
        wait = None
        if second.connected >= 0:
            vehicle = second.figures if second.left == second.connected else run.vehicle(second.connected)
            wait = vehicle["connected"] - vehicle["arrival"]
        day = days.add(second, wait)
        ended += [] if day is None else [day]
        if run.seq in restarts:
            snapshot = run.snapshot(**days.memories())
            run, days = made()
            days.resume(run.restore(snapshot), run.seq)
    return list(days.figures()), ended


def by_hand(scenario, controller, first, end, **which):
    """Figures of the seconds from `first` to `end`: metrics of a run to `end`, less those of one to `first`."""

    def until(limit):
        if not limit:
            return NOTHING
        return simulate(scenario.model_copy(update={"time_limit_s": float(limit)}), create_from(controller), **which)

    upto, before = (run if run is NOTHING else run.metrics() for run in (until(end), until(first)))
    record = simulate(scenario, create_from(controller), **which)
    vehicles = record.vehicles
    here = (vehicles["connected"] >= first) & (vehicles["connected"] < end)
    waits = (vehicles["connected"] - vehicles["arrival"])[here]
    found = {name: upto[figure] - before[figure] for name, figure in SUMS.items()}
    codes = np.concatenate([record[name][first:end] for name in record.columns if name.startswith("refused_")])
    found |= {
        "vehicles_arrived": np.count_nonzero((vehicles["arrival"] >= first) & (vehicles["arrival"] < end)),
        "vehicles_served": np.count_nonzero((vehicles["finished"] > first) & (vehicles["finished"] <= end)),
        "vehicles_waiting": record["queue_length"][end - 1],
        "refused": np.bincount(codes, minlength=max(Limit) + 1)[1:].tolist(),
    }
    if waits.size:
        found |= {"wait_mean_s": waits.mean(), "wait_p95_s": np.quantile(waits, 0.95), "wait_max_s": waits.max()}
    return found


@pytest.mark.slow
@settings(deadline=None, max_examples=8, phases=[Phase.explicit, Phase.reuse, Phase.generate])
@given(
    day_s=st.integers(40, 2500),
    restarts=st.sets(st.integers(1, 2200), max_size=4),
    controller=st.sampled_from(["logic", "logic:dispense=cascade", "minlp1"]),
    seed=st.integers(0, 3),
)
def test_days_are_the_metrics_of_their_seconds(day_s, restarts, controller, seed):
    scenario = load_scenario("S2").model_copy(update={"idle_period_s": 1})
    which = {"replication": 2, "seed": seed}
    days, ended = lived(scenario, controller, day_s, restarts, **which)
    end = simulate(scenario, create_from(controller), **which)["time"][-1]
    assert [(day["from_s"], day["to_s"]) for day in days] == [
        (start, min(start + day_s, end)) for start in range(0, int(end), day_s)
    ][-len(days) :]
    assert [day["day"] for day in days] == [day["from_s"] // day_s for day in days]
    past = [document(day) for day in days if day["to_s"] % day_s == 0]
    assert [document(day) for day in ended][len(ended) - len(past) :] == past
    for day in (days[0], days[-1]):
        expected = by_hand(scenario, controller, int(day["from_s"]), int(day["to_s"]), **which)
        refused = expected.pop("refused")
        assert [day[name] for name in UNITS if name.startswith("refused_") and name != "refused_valves"] == refused
        assert {name: day[name] for name in expected} == pytest.approx(expected, rel=1e-9, abs=1e-9)
        assert ("wait_mean_s" in expected) is not math.isnan(day["wait_mean_s"])


def test_energy_is_the_plants_own_where_it_keeps_account():
    arrivals = {"kind": "uniform", "count": 3, "period_s": 1500.0}
    scenario = parse_scenario({"name": "gas", "station": {"preset": "h70-light"}, "arrivals": arrivals})
    days, _ = lived(scenario, "logic", 1000, {700, 1700})
    assert len(days) > 2
    record = simulate(scenario, create_from("logic"))
    for day in days:
        first, end = (
            record["energy_compressor"][at] + record["energy_precooler"][at]
            for at in (int(day["from_s"]), int(day["to_s"]))
        )
        assert day["energy_kwh"] == pytest.approx(end - first, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("controller", ["logic", "minlp1", "switched"])
@pytest.mark.parametrize("scenario", ["S1", "S2"])
def test_a_day_that_holds_a_whole_run_has_its_metrics(scenario, controller):
    chosen = load_scenario(scenario).model_copy(update={"idle_period_s": 1})
    (day,), _ = lived(chosen, controller, DAY_S, {700, 701})
    found = simulate(chosen, create_from(controller)).metrics()
    names = {
        **SUMS, "wait_mean_s": "t_avg", "wait_p95_s": "wait_p95", "wait_max_s": "wait_max",
        "vehicles_served": "vehicles",
    }  # fmt: skip
    assert {name: day[name] for name in names} == pytest.approx({name: found[of] for name, of in names.items()})
    shown = TwinDay.model_validate(document(day)).model_dump()
    assert sum(shown["refused"].values()) == shown["refused_valves"]
    assert {name for name, figure in shown.items() if isinstance(figure, float)} <= set(FLOATS)


def test_a_snapshot_without_days_begins_them_where_it_stands():
    scenario = load_scenario("S1")
    days = Days(scenario)
    days.resume({}, 500)
    run, seat = LiveRun(scenario, AtEnd.IDLE), _seat(create_from("logic"), scenario.station)
    for _ in range(600):
        second = run.step(seat)
        if second.seq >= 500:
            days.add(second)
    (day,) = days.figures()
    assert (day["day"], day["from_s"], day["to_s"]) == (0, 500, 600)


@pytest.mark.parametrize("priced", [False, True])
def test_days_of_a_version_that_priced_none_stay(priced):
    """Where there is a tariff the running day begins anew: what it cost so far is not known."""
    scenario = load_scenario("S1")
    if priced:
        station = scenario.station.model_copy(update={"tariff": load_station("h70-light").tariff})
        scenario = scenario.model_copy(update={"station": station})
    days, run = Days(scenario, 400), LiveRun(scenario, AtEnd.IDLE)
    seat = _seat(create_from("logic"), scenario.station)
    for _ in range(1000):
        days.add(run.step(seat), 0.0)
    told = list(days.figures())
    memories = {name: each for name, each in days.memories().items() if name not in ("day_spent", "day_stock")}
    memories["days"] = np.delete(memories["days"], [list(UNITS).index(name) for name in BILL], axis=1)
    again = Days(scenario, 400)
    again.resume(memories, run.seq)
    past = [{**day, **dict.fromkeys(BILL, np.nan)} for day in told[:2]]
    np.testing.assert_equal(list(again.figures()), past if priced else told)


def test_days_of_a_service_go_on_over_restarts_and_are_told_as_events(opened, monkeypatch):
    monkeypatch.setattr("api.twins.days.DAY_S", 900)
    twins = opened()
    twins.start(TwinRequest(id="long", scenario=load_scenario("S1"), controller="logic", speed="max", at_end="repeat"))
    until = time.monotonic() + 60
    while len(twins.days("long")) < 2:
        assert time.monotonic() < until
        time.sleep(0.05)
    twins.close(10)
    told = [event for event in twins.events("long", -1, 10_000) if event["kind"] == EventKind.DAY_END]
    assert told
    again = opened()
    again.resume_all()
    days = again.days("long")
    assert [event["details"] for event in told] == days[: len(told)]
    assert all(event["time"] == event["details"]["to_s"] for event in told)
    assert days[0]["energy_kwh"] > 1
    again.stop("long")
    last = again.days("long")
    assert last[: len(told)] == days[: len(told)]
    again.close(10)
    assert opened().days("long") == last, "of a twin that has ended, from its last snapshot"


def test_what_a_second_costs():
    """A comparison as long as nothing changes: few calls, counted, since a clock tells the machine's load too."""
    scenario = load_scenario("S1")
    run, seat, days = (
        LiveRun(scenario, AtEnd.REPEAT),
        _seat(create_from("logic"), scenario.station),
        Days(scenario),
    )
    calls: list[str] = []

    def count(_frame, event: str, _function) -> None:
        if event in ("call", "c_call"):
            calls.append(event)

    of_second: dict[bool, set[int]] = {True: set(), False: set()}
    before: tuple[float, ...] = ()
    for _ in range(5_000):
        second = run.step(seat)
        calls.clear()
        sys.setprofile(count)
        days.add(second)
        sys.setprofile(None)
        codes = second.row[CODES]
        of_second[codes == before].add(len(calls))
        before = codes
    assert max(of_second[True]) <= 5, "add, the lock, and what a vehicle that comes or leaves adds"
    assert min(of_second[False]) >= 8
    assert max(of_second[False]) <= 14
