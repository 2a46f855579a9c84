"""Gauges of live twins: their alarms by priority and state, which are named, and how old their data are."""

from __future__ import annotations

import time

import pytest

from api.server.twin_gauges import ALARMS_SHOWN, INFO, twin_gauges
from station.alarm_rules import Priority
from station.alarms.states import AlarmState
from tests.api.measured import batches, measured
from tests.api.reopened import request
from tests.api.test_alarms import TEXTS, with_rules
from tests.waiting import wait_until

WORKERS = 0
"""Of the service: it runs no jobs."""

AT_ONCE = [
    {"name": f"filled_{k}", "signal": "fill_duration", "above": 5.0, "priority": "advisory", **TEXTS} for k in range(30)
]
RULES = [{"name": "urgent", "signal": "fill_duration", "above": 6.0, "priority": "high", **TEXTS}, *AT_ONCE]


def _shown(twins):
    return {gauge.name: gauge for gauge in twin_gauges(twins)}


def _paused_with_alarms(twins):
    """A twin with 31 alarms, which stands still."""
    twins.start(request(scenario=with_rules(RULES), controller="logic", at_end="idle", speed=1000))
    wait_until(lambda: twins.live("t").alarms.alarms["urgent"].active)
    twin = twins.live("t")
    twin.ask(twin.pause)
    return twin


def test_alarms_are_counted_and_the_most_urgent_named(opened):
    twins = opened()
    twin = _paused_with_alarms(twins)
    shown = _shown(twins)
    counts = shown["hrs_twin_alarms"].values
    assert len(counts) == len(Priority) * (len(AlarmState) - 1)
    assert counts["t", "high", "unacknowledged"] == 1
    assert counts["t", "advisory", "unacknowledged"] == len(AT_ONCE)
    assert sum(counts.values()) == len(RULES)
    named = shown["hrs_twin_alarm_announced"].values
    assert next(iter(named)) == ("t", "urgent", "high", "unacknowledged")
    assert len(named) == ALARMS_SHOWN < len(RULES)
    twin.ask(lambda: twin._tell_alarms(twin.alarms.acknowledge("urgent", "ann")))
    twin.ask(lambda: twin._tell_alarms(twin.alarms.take_out("filled_0", "ann", "no sensor")))
    shown = _shown(twins)
    assert ("t", "urgent", "high", "acknowledged") in shown["hrs_twin_alarm_announced"].values
    assert shown["hrs_twin_alarms"].values["t", "advisory", "out_of_service"] == 1
    twin.ask(twin.stop)
    assert [len(gauge.values) for gauge in twin_gauges(twins)] == [0, 0, 0, 0]


def test_data_of_a_twin_that_runs_have_an_age(opened):
    twins = opened()
    twins.start(request(controller="logic", at_end="idle", speed=100))
    wait_until(lambda: twins.samples("t") > 5)
    twin = twins.live("t")
    assert twin.data_age < 2.0
    info = dict(zip(INFO, *_shown(twins)["hrs_twin_info"].values, strict=True))
    assert (info["source"], info["state"], info["scenario"], info["controller"]) == (
        "simulated", "running", "S1", "logic",
    )  # fmt: skip
    twin.ask(twin.pause)
    assert _shown(twins)["hrs_twin_data_age_seconds"].values == {}
    time.sleep(0.3)
    assert twin.ask(lambda: (twin.continue_(), twin.data_age)[1]) < 0.3
    assert [*_shown(twins)["hrs_twin_data_age_seconds"].values] == [("t", "simulated")]


def test_data_of_a_measured_twin_are_as_old_as_its_measurements(opened):
    twins = opened()
    twins.start(measured())
    sent, *_ = batches(1)
    time.sleep(0.3)
    (age,) = _shown(twins)["hrs_twin_data_age_seconds"].values.values()
    assert age >= 0.3
    twin, sent_at = twins.live("m"), time.monotonic()
    twin.measure("gateway", 1, sent)
    wait_until(lambda: twin.taken == 1)
    age = twin.data_age
    assert age <= time.monotonic() - sent_at
    assert twins.samples("m") == 0  # they make no whole second yet


@pytest.mark.parametrize("more", [{"from_s": 1}, {"to_s": 5}])
def test_the_newest_seconds_of_a_history(http, more):
    http.post("/v1/twins", json={"id": "t", "scenario": "S1", "controller": "logic", "speed": "max"}).raise_for_status()
    wait_until(lambda: http.get("/v1/twins/t").json()["samples"] > 100)
    http.patch("/v1/twins/t", json={"paused": True})
    samples = http.get("/v1/twins/t").json()["samples"]
    path = "/v1/twins/t/history"
    whole = http.get(path, params={"columns": "pressure_high"}).json()["columns"]
    newest = http.get(path, params={"columns": "pressure_high", "last_s": 60}).json()["columns"]
    assert newest == {name: values[-60:] for name, values in whole.items()}
    assert newest["time"][-1] == samples - 1
    assert http.get(path, params={"columns": "pressure_high", "last_s": 10**9}).json()["columns"] == whole
    both = http.get(path, params={"last_s": 60, **more})
    assert (both.status_code, both.json()["errors"][0]["field"]) == (422, "last_s")
    assert http.get(path, params={"last_s": 0}).status_code == 422
    http.post("/v1/twins/t/stop")
    http.delete("/v1/twins/t")


def test_the_newest_seconds_of_a_replay_and_of_a_twin_that_has_ended(http):
    http.post("/v1/twins", json={"id": "e", "scenario": "S1", "controller": "logic", "speed": "max"}).raise_for_status()
    wait_until(lambda: http.get("/v1/twins/e").json()["samples"] > 100)
    http.post("/v1/twins/e/stop").raise_for_status()
    samples = http.get("/v1/twins/e").json()["samples"]
    replay = {"id": "r", "source": "replay", "of": "e", "from_s": 50, "to_s": 90, "speed": "max"}
    http.post("/v1/twins", json=replay).raise_for_status()
    wait_until(lambda: http.get("/v1/twins/r").json()["state"] == "finished")
    for twin, end in (("e", samples), ("r", 91)):
        newest = http.get(f"/v1/twins/{twin}/history", params={"columns": "pressure_high", "last_s": 5}).json()
        assert newest["columns"]["time"] == [*range(end - 5, end)]
    for twin in "re":
        http.delete(f"/v1/twins/{twin}")
