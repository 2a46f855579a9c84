"""Alarms of live twins: REST, zenoh, the command line, and through a service that is killed."""

from __future__ import annotations

import json

import orjson
import pytest

from api.http.problems import ProblemError
from api.twins.alarm_schemas import ALARM_ACTION
from api.twins.messages import EventKind
from station import load_scenario
from tests.api.measured import batches, measured
from tests.api.reopened import kill, opening, request
from tests.api.test_measured_twins import _send, _taken
from tests.waiting import wait_until

TEXTS = {"title": "It is so", "consequence": "Something", "action": "Look"}
RULES = [
    {"name": "early", "signal": "fill_duration", "above": 60.0, "priority": "high", **TEXTS},
    {"name": "queue", "signal": "queue_length", "above": 0.5, "priority": "low", **TEXTS},
    {"name": "never", "signal": "wait", "above": 1e8, "priority": "medium", **TEXTS},
]
SHELVE = {"action": "shelve", "for_s": 3600.0, "reason": "being mended"}


def with_rules(rules=RULES, scenario="S1"):
    document = load_scenario(scenario).model_dump(mode="json")
    return {**document, "station": {**document["station"], "alarms": rules}}


def changes(twins, twin_id="t"):
    """The changes of state that a twin has told, without their details."""
    return [
        (event["time"], event["details"]["alarm"], event["details"]["state"])
        for event in twins.events(twin_id, -1, 10_000)
        if event["kind"] == EventKind.ALARM
    ]


@pytest.fixture
def twin(http):
    """A live twin with alarms, which stands still while its first vehicle, of some five minutes, is filled."""
    order = {"id": "alarmed", "scenario": with_rules(), "speed": 50, "at_end": "idle"}
    http.post("/v1/twins", json=order).raise_for_status()
    wait_until(lambda: http.get("/v1/twins/alarmed").json()["samples"] > 80)
    http.patch("/v1/twins/alarmed", json={"paused": True}).raise_for_status()
    yield "/v1/twins/alarmed"
    http.post("/v1/twins/alarmed/stop")
    http.delete("/v1/twins/alarmed")


@pytest.mark.slow
def test_an_alarm_is_shown_acknowledged_and_put_aside(http, twin):
    shown = http.get(f"{twin}/alarms").json()
    first = shown["items"][0]
    assert (first["name"], first["state"], first["priority"]) == ("early", "unacknowledged", "high")
    assert (first["value"], first["limit"], first["side"], first["unit"]) == (61.0, 60.0, "above", "s")
    assert shown["figures"]["unacknowledged"] == len(shown["items"])
    assert http.get(twin).json()["alarms"]["highest"] == "high"
    every = {each["name"]: each["state"] for each in http.get(f"{twin}/alarms?all=true").json()["items"]}
    assert every == {"early": "unacknowledged", "queue": every["queue"], "never": "normal"}
    stale = http.post(f"{twin}/alarms/early", json={"action": "acknowledge", "raised_s": 1.0})
    assert (stale.status_code, "began at" in stale.json()["detail"]) == (409, True)
    seen = http.post(f"{twin}/alarms/early", json={"action": "acknowledge", "raised_s": first["raised_s"]}).json()
    assert (seen["state"], seen["by"]) == ("acknowledged", "local")
    aside = http.post(f"{twin}/alarms/early", json=SHELVE).json()
    assert (aside["state"], aside["reason"]) == ("shelved", "being mended")
    assert aside["shelved_until_s"] == http.get(twin).json()["samples"] - 1 + 3600.0
    told = http.get(f"{twin}/events?before=100000&limit=50").json()["items"]
    states = [each["details"]["state"] for each in told if each["details"].get("alarm") == "early"]
    assert states[-2:] == ["acknowledged", "shelved"]
    out = http.post(f"{twin}/alarms/never", json={"action": "out_of_service", "reason": "no sensor"}).json()
    assert out["state"] == "out_of_service"
    assert http.post(f"{twin}/alarms/never", json={"action": "in_service"}).json()["state"] == "normal"
    assert http.post(f"{twin}/alarms/early", json={"action": "unshelve"}).json()["state"] == "unacknowledged"


@pytest.mark.parametrize(
    ("path", "body", "status", "said"),
    [
        ("nothing", {"action": "acknowledge"}, 404, "no alarm is called 'nothing'"),
        ("early", {"action": "ignore"}, 422, "action"),
        ("early", {"action": "shelve", "for_s": 60.0}, 422, "reason"),
        ("early", {**SHELVE, "for_s": 1e9}, 422, "for_s"),
        ("early", {**SHELVE, "for_s": 0.0}, 422, "for_s"),
        ("early", {**SHELVE, "reason": "x" * 201}, 422, "reason"),
        ("early", {"action": "acknowledge", "raised_s": "now"}, 422, "raised_s"),
        ("early", {"action": "acknowledge", "by": "me"}, 422, "by"),
    ],
)
def test_what_cannot_be_done_is_named(http, twin, path, body, status, said):
    answer = http.post(f"{twin}/alarms/{path}", json=body)
    assert answer.status_code == status
    assert said in answer.text


@pytest.mark.slow
def test_a_replay_and_a_twin_that_has_ended_have_none(http, twin):
    http.post("/v1/twins", json={"id": "again", "source": "replay", "of": "alarmed", "speed": 1}).raise_for_status()
    none = {"items": [], "figures": None}
    assert http.get("/v1/twins/again/alarms").json() == {"twin": "again", **none}
    acted = http.post("/v1/twins/again/alarms/early", json={"action": "acknowledge"})
    assert acted.status_code == 409
    assert http.get("/v1/twins/again").json()["alarms"] is None
    http.post("/v1/twins/again/stop").raise_for_status()
    http.delete("/v1/twins/again").raise_for_status()
    http.post(f"{twin}/stop").raise_for_status()
    assert http.get(f"{twin}/alarms").json() == {"twin": "alarmed", **none}
    assert http.get("/v1/twins/nobody/alarms").status_code == 404


def test_a_table_that_is_wrong_starts_no_twin(http):
    order = {"id": "wrong", "scenario": with_rules([{**RULES[0], "signal": "weight"}])}
    answer = http.post("/v1/twins", json=order)
    assert answer.status_code == 422
    assert "signal must be one of docs/alarms.md; given 'weight'" in answer.text


@pytest.mark.slow
def test_through_kills_none_is_lost_none_is_told_twice_and_what_was_acknowledged_stays(database):
    asked = request(scenario=with_rules(), controller="logic", at_end="stop")
    with opening(database, checkpoint_s=0.1) as make:
        whole = make("whole")
        whole.start(asked.model_copy(update={"id": "whole"}))
        wait_until(lambda: whole.state("whole").state == "finished")
        twins, acknowledged = make(), []
        twins.start(asked.model_copy(update={"speed": 1000.0}))
        for _ in range(6):
            begun = twins._store.get("t").samples
            wait_until(lambda begun=begun, twins=twins: twins._store.get("t").samples >= min(begun + 100, 1000))
            live = twins.live("t")
            if live is not None and live.alarms.alarms["queue"].pending:
                done = twins.alarm("t", "queue", ALARM_ACTION.validate_python({"action": "acknowledge"}), "ann")
                acknowledged.append((done.raised_s, done.state))
            kill(twins)
            twins = make()
            twins.resume_all()
            if acknowledged:
                alarm = twins.live("t").alarms.alarms["queue"]
                assert alarm.raised > acknowledged[-1][0] or not alarm.pending
        wait_until(lambda: twins.state("t").state == "finished")
        begins = [each for each in changes(twins) if each[2] == "unacknowledged"]
        assert begins == [each for each in changes(whole, "whole") if each[2] == "unacknowledged"]
        assert len(set(begins)) == len(begins) > 2
        assert acknowledged


@pytest.mark.slow
def test_a_measured_twin_says_that_nothing_comes(database):
    silent = {"name": "silent", "signal": "data_age", "above": 1.0, "priority": "high", **TEXTS}
    with opening(database, checkpoint_s=0.1) as make:
        twins = make()
        twins.start(measured(scenario=with_rules([silent])))
        _send(twins, batches(120, 60))
        wait_until(lambda: _taken(twins) == 2)
        wait_until(lambda: twins.alarms("m").figures.unacknowledged == 1)
        (alarm,) = twins.alarms("m").items
        assert alarm.value > 1
        twins.alarm("m", "silent", ALARM_ACTION.validate_python({"action": "acknowledge"}), "ann")
        kill(twins)
        twins = make()
        twins.resume_all()
        assert [each.state for each in twins.alarms("m").items] == ["acknowledged"]
        _send(twins, batches(180, 60)[2:], 2)
        wait_until(lambda: not twins.alarms("m").items)
        states = [each["details"]["state"] for each in twins.events("m", -1, 100) if each["kind"] == EventKind.ALARM]
        assert states == ["unacknowledged", "acknowledged", "normal"]


@pytest.mark.slow
def test_a_command_that_names_an_alarm(database):
    with opening(database) as make:
        twins = make()
        twins.start(request(scenario=with_rules(), controller="logic", at_end="idle"))
        wait_until(lambda: twins.live("t").alarms.alarms["early"].pending)
        document = orjson.loads(json.dumps({"command": "alarm", "alarm": "early", "do": {"action": "acknowledge"}}))
        assert twins.command("t", document).id == "t"
        assert twins.live("t").alarms.alarms["early"].by == "zenoh"
        with pytest.raises(ProblemError, match="nothing"):
            twins.command("t", {**document, "alarm": "nothing"})
