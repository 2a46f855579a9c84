"""Twins that cannot start or go on, that are killed and that close: nothing is left behind, nothing is lost."""

from __future__ import annotations

import time

import pytest

from api.http.problems import ProblemError
from api.store.database import StoreError
from api.store.records import Checkpoint
from api.twins import service as twins_service
from api.twins.schemas import TwinChange
from controllers import create
from controllers.base import BaseController
from station import Decision, InputError
from tests.api.reopened import away, request, run_through_kills
from tests.pace import slowness
from tests.waiting import wait_until

TOLD = ("arrival", "fill_start", "fill_end", "valve_change", "shield_refusal")
"""Events that follow from the rows alone."""


def test_a_twin_that_cannot_start_leaves_nothing(opened):
    twins = opened()
    for _ in range(2):
        with pytest.raises(InputError, match="telemetry"):
            twins.start(request(controller="remote"))
    assert twins.ids() == []
    with pytest.raises(ProblemError):
        twins.state("t")
    twins.start(request(speed=10))
    twins.close()


def test_a_snapshot_that_cannot_be_read_stops_no_other_twin(opened):
    twins = opened()
    for name in ("bad", "good"):
        twins.start(request(id=name, speed=50, at_end="repeat"))
        wait_until(lambda name=name: twins._store.get(name).samples > 5)
    twins.close()
    epoch, _ = twins._store.open("bad")
    twins._store.save("bad", epoch, Checkpoint("running", {}, b"torn", 0, 6, None))
    again = opened()
    again.resume_all()
    assert again.ids() == ["good"]
    assert again.state("bad").state == "failed"
    with pytest.raises(ProblemError):
        again.change("bad", TwinChange(paused=True))
    again.close()
    last = opened()
    last.resume_all()
    assert (last.ids(), last.state("bad").state) == (["good"], "failed")


def test_a_start_on_a_store_in_trouble_goes_on_with_its_twins_when_it_is_over(opened, monkeypatch):
    monkeypatch.setattr(twins_service, "RETRY_S", 0.05)
    twins = opened()
    for name in ("t", "u"):
        twins.start(request(id=name, speed=50, at_end="repeat"))
        wait_until(lambda name=name: twins._store.get(name).samples > 5)
    twins.close()
    again = opened()
    tries = []

    def full(name):
        whole = getattr(again._store, name)

        def tried(*given):
            tries.append(name)
            if len(tries) < 6:
                raise StoreError("full")
            return whole(*given)

        monkeypatch.setattr(again._store, name, tried)

    full("all")
    full("open")
    again.resume_all()
    assert again.ids() == []
    wait_until(lambda: sorted(again.ids()) == ["t", "u"])
    assert [again.state(name).epoch for name in ("t", "u")] == [2, 2]


def test_a_twin_that_waits_for_the_store_is_not_said_to_have_stopped(opened, monkeypatch):
    monkeypatch.setattr(twins_service, "RETRY_S", 0.05)
    twins = opened()
    twins.start(request(speed=50, at_end="repeat"))
    wait_until(lambda: twins._store.get("t").samples > 5)
    twins.close()
    again = opened()
    with monkeypatch.context() as broken:
        broken.setattr(again._store, "open", away)
        again.resume_all()
        for ask in (again.stop, lambda twin: again.change(twin, TwinChange(speed=40))):
            with pytest.raises(StoreError, match="'t' waits"):
                ask("t")
    wait_until(lambda: again.ids() == ["t"])
    assert again.stop("t").state == "stopped"
    with pytest.raises(ProblemError, match="is stopped"):
        again.change("t", TwinChange(speed=40))


def test_a_twin_whose_storing_nobody_heard_of_lives(opened, monkeypatch):
    monkeypatch.setattr(twins_service, "RETRY_S", 0.05)
    twins = opened()
    add = twins._store.add

    def unheard(*given):
        add(*given)
        raise StoreError("the connection was lost")

    monkeypatch.setattr(twins._store, "add", unheard)
    with pytest.raises(StoreError):
        twins.start(request(speed=50, at_end="repeat"))
    wait_until(lambda: twins.ids() == ["t"] and twins._store.get("t").samples > 5)
    assert [event["kind"] for event in twins.events("t", -1, 1)] == ["started"]


class Unstartable(BaseController):
    """A plug-in whose license server is away."""

    name = "unstartable"

    def start(self, station):
        raise RuntimeError("no license")

    def decide(self, seen):
        return Decision(0)


def test_a_plug_in_that_no_longer_starts_gives_way_to_logic(opened, monkeypatch):
    twins = opened()
    for name in ("t", "u"):
        twins.start(request(id=name, speed=50, at_end="repeat"))
        wait_until(lambda name=name: twins._store.get(name).samples > 5)
    twins.close()
    monkeypatch.setattr(twins_service, "create_from", lambda text: create(text) if text == "logic" else Unstartable())
    again = opened()
    again.resume_all()
    assert sorted(again.ids()) == ["t", "u"]
    assert again.state("t").controller == "logic"
    resumed = next(event for event in again.observers[0].events if event.kind == "resumed")
    assert "no license" in resumed.details["memory"]


@pytest.mark.slow
def test_events_of_a_killed_twin_are_those_of_one_that_ran_on(opened):
    whole = opened()
    whole.start(request(id="whole", at_end="stop"))
    wait_until(lambda: whole.state("whole").state == "finished")
    twins = run_through_kills(opened, request(speed=400, at_end="stop"), 4, 60)

    def told(service, twin):
        found = service.events(twin, -1, 10_000)
        assert [event["seq"] for event in found] == list(range(len(found)))
        return [(event["time"], event["kind"], event["details"]) for event in found if event["kind"] in TOLD]

    assert told(twins, "t") == told(whole, "whole")


@pytest.mark.timed
def test_fifty_twins_close_soon(opened):
    twins = opened()
    for number in range(50):
        twins.start(request(id=f"t{number}", speed=1, at_end="repeat", controller="logic"))
    wait_until(lambda: all(state.samples for state in twins.every()))
    before = time.monotonic()
    twins.close()
    took = time.monotonic() - before
    told = dict.fromkeys(twins._live, 0)
    for sample in twins.observers[0].samples:
        told[sample.twin] = sample.seq + 1
    assert {stored.id: stored.samples for stored in twins._store.all()} == told
    assert took < 5 * slowness()
