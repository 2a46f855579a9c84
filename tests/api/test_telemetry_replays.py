"""A replay over zenoh: samples, events and history under keys of its own, and the commands that it has."""

from __future__ import annotations

import json

import pytest

from api.telemetry.session import connect
from tests.waiting import wait_until

WORKERS = 0


@pytest.fixture(scope="module")
def session(service):
    with connect(service.zenoh) as opened:
        yield opened


def _ask(session, selector, **document):
    payload = json.dumps(document) if document else None
    (reply,) = session.get(f"hrs/v1/{selector}", payload=payload, timeout=20)
    return json.loads((reply.ok or reply.err).payload.to_bytes())


def _told(session, twin):
    """Samples of a twin from second 100 on, but for who told them, and when."""
    found = _ask(session, f"{twin}/history?from=100;limit=200")
    return [(sample["seq"], sample["values"]) for sample in found["samples"] if sample["seq"] < 250]


def test_a_replay_tells_under_its_own_keys_and_takes_what_it_can(http, session):
    order = {"id": "first", "scenario": "S1", "controller": "logic", "speed": "max"}
    assert http.post("/v1/twins", json=order).status_code == 201
    wait_until(lambda: http.get("/v1/twins/first").json()["samples"] > 300)
    replay = {"id": "second", "source": "replay", "of": "first", "from_s": 100, "to_s": 300, "paused": True}
    assert http.post("/v1/twins", json=replay).status_code == 201
    heard = []
    with session.declare_subscriber("hrs/v1/second/event", lambda sample: heard.append(sample.payload.to_string())):
        assert _ask(session, "second/command", command="speed", speed=200)["speed"] == 200
        refused = _ask(session, "second/command", command="controller", controller="logic")
        assert (refused["status"], "is a replay of 'first'" in refused["detail"]) == (409, True)
        assert _ask(session, "second/command", command="continue")["state"] == "running"
        wait_until(lambda: any('"finished"' in event for event in heard))
    assert any('"valve_change"' in event for event in heard)
    assert _told(session, "second") == _told(session, "first")
    assert len(_told(session, "second")) == 150
