"""Commands to live twins: what was answered is stored, what is not stored is not acknowledged."""

from __future__ import annotations

import time

import pytest

from api.store.database import StoreError
from api.store.records import NotDurableYet
from api.twins import durable
from api.twins.schemas import TwinChange, VehicleRequest
from station import InputError
from tests.api.reopened import away, kill, request
from tests.waiting import wait_until


def _stored_kinds(twins):
    return [event["kind"] for event in twins._store.events("t", -1, 10_000)]


def test_a_twin_that_is_said_to_have_ended_is_stored_so(opened, monkeypatch):
    """Or a service that is killed right behind its answer would go on with it."""
    monkeypatch.setattr(durable, "STORED_S", 0.2)
    twins = opened()
    twins.start(request(speed=50, at_end="repeat"))
    wait_until(lambda: twins._store.get("t").samples > 5)
    twins._store.trouble = away
    with pytest.raises(NotDurableYet):
        twins.stop("t")
    assert twins._store.get("t").state == "running"
    twins._store.trouble = lambda checkpoint: time.sleep(0.3)
    monkeypatch.setattr(durable, "STORED_S", 30.0)
    assert twins.stop("t").state == "stopped"
    assert twins._store.get("t").state == "stopped"


def test_a_twin_that_could_not_be_forgotten_has_still_ended(opened, monkeypatch):
    monkeypatch.setattr(durable, "STORED_S", 0.2)
    twins = opened()
    twins.start(request(speed=50, at_end="repeat"))
    with monkeypatch.context() as broken:
        broken.setattr(twins._store, "trouble", away)
        broken.setattr(twins._store, "remove", away)
        with pytest.raises(NotDurableYet):
            twins.stop("t")
        with pytest.raises(StoreError):
            twins.remove("t")
        assert twins.state("t").state == "stopped"
    wait_until(lambda: twins._store.get("t").state == "stopped")
    twins.remove("t")
    assert not twins.known("t")


def test_a_command_that_was_answered_survives_a_kill(opened):
    twins = opened(checkpoint_s=60)
    twins.start(request(speed=50, at_end="repeat"))
    twins.change("t", TwinChange(speed=40, controller="logic"))
    twins.add_vehicle("t", VehicleRequest(start_pressure_bar=123))
    twins.change("t", TwinChange(paused=True))
    kill(twins)
    again = opened()
    again.resume_all()
    state = again.state("t")
    assert (state.speed, state.controller, state.state) == (40, "logic", "paused")
    added = [event for event in again.events("t", -1, 1000) if event["kind"] == "vehicle_added"]
    assert [event["details"]["start_pressure"] for event in added] == [123]


@pytest.mark.parametrize(
    ("command", "kind"),
    [({"command": "pause"}, "paused"), ({"command": "vehicle", "start_pressure_bar": 123}, "vehicle_added")],
)
def test_a_command_that_is_not_stored_is_obeyed_and_not_acknowledged(opened, monkeypatch, command, kind):
    monkeypatch.setattr(durable, "STORED_S", 0.2)
    twins = opened()
    twins.start(request(speed=50, at_end="repeat"))
    wait_until(lambda: twins._store.get("t").samples > 5)
    twins._store.trouble = away
    with pytest.raises(NotDurableYet) as late:
        twins.command("t", command)
    assert kind not in _stored_kinds(twins)
    twins._store.trouble = lambda checkpoint: None
    late.value.stored.result(30)
    assert _stored_kinds(twins).count(kind) == 1


@pytest.mark.timed
def test_commands_that_come_too_late_are_answered(opened):
    twins = opened()
    twins.start(request(speed=10))
    twin = twins.live("t")
    twins.stop("t")
    before = time.monotonic()
    with pytest.raises(InputError, match="has ended"):
        twin.ask(twin.pause, 5.0)
    assert time.monotonic() - before < 3
