"""Live twins when something goes wrong: a store that is slow or refuses, a start that fails, readers in between."""

from __future__ import annotations

import asyncio
import threading
import time
from dataclasses import replace

import numpy as np
import pytest

from api.problems import ProblemError
from api.settings import Settings
from api.store.database import Database, StoreError
from api.store.records import Checkpoint
from api.store.twins import TwinRepository
from api.twins import commands as twins_commands
from api.twins import keeper
from api.twins import service as twins_service
from api.twins.broadcast import Broadcast
from api.twins.feed import COLUMNS
from api.twins.schemas import TwinChange, TwinRequest
from api.twins.service import Twins
from api.twins.stream import begin, stream
from controllers import create
from controllers.base import BaseController
from station import Decision, InputError, load_scenario, simulate
from tests.api.ear import Ear

TOLD = ("arrival", "fill_start", "fill_end", "valve_change", "shield_refusal")
"""Events that follow from the rows alone."""


class Troubled(TwinRepository):
    """A store whose `save` first does what a test wants: wait, or raise."""

    trouble = staticmethod(lambda checkpoint: None)

    def save(self, twin_id, epoch, checkpoint):
        self.trouble(checkpoint)
        super().save(twin_id, epoch, checkpoint)


@pytest.fixture
def opened(tmp_path):
    """Opens the twins of one server again and again, and closes them."""
    database = Database(f"sqlite:///{tmp_path / 'hrs.db'}")
    database.migrate()
    made = []

    def make(**settings):
        twins = Twins(Troubled(database, "one"), Settings(**{"checkpoint_s": 0.1, **settings}))
        twins.listeners.append(Ear())
        made.append(twins)
        return twins

    yield make
    for twins in made:
        twins._store.trouble = lambda checkpoint: None
        twins.close()
    database.close()


def _request(**more):
    return TwinRequest.model_validate({"id": "t", "scenario": "S1", "controller": "minlp1", "speed": "max", **more})


def _until(condition, seconds=30.0):
    until = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < until
        time.sleep(0.01)


def _rows(record):
    return np.array([record[name] for name in COLUMNS], float).T


def _kill(twins):
    """As if the process had been killed: nothing is stored any more."""
    for twin in twins._live.values():
        twin._gone = True
        twin._stopping = True
    twins._keeper._save = lambda draft: None
    for twin in twins._live.values():
        twin.join(5)
    twins._live.clear()


def test_a_twin_that_cannot_start_leaves_nothing(opened):
    twins = opened()
    for _ in range(2):
        with pytest.raises(InputError, match="telemetry"):
            twins.start(_request(controller="remote"))
    assert twins.ids() == []
    with pytest.raises(ProblemError):
        twins.state("t")
    twins.start(_request(speed=10))
    twins.close()


def test_a_snapshot_that_cannot_be_read_stops_no_other_twin(opened):
    twins = opened()
    for name in ("bad", "good"):
        twins.start(_request(id=name, speed=50, at_end="repeat"))
        _until(lambda name=name: twins._store.get(name).samples > 5)
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


class Unstartable(BaseController):
    """A plug-in whose license server is away."""

    name = "unstartable"

    def start(self, station):
        raise RuntimeError("no license")

    def decide(self, seen):
        return Decision(0)


def test_a_start_on_a_store_in_trouble_goes_on_with_its_twins_when_it_is_over(opened, monkeypatch):
    monkeypatch.setattr(twins_service, "RETRY_S", 0.05)
    twins = opened()
    for name in ("t", "u"):
        twins.start(_request(id=name, speed=50, at_end="repeat"))
        _until(lambda name=name: twins._store.get(name).samples > 5)
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
    _until(lambda: sorted(again.ids()) == ["t", "u"])
    assert [again.state(name).epoch for name in ("t", "u")] == [2, 2]


def test_a_twin_whose_storing_nobody_heard_of_lives(opened, monkeypatch):
    monkeypatch.setattr(twins_service, "RETRY_S", 0.05)
    twins = opened()
    add = twins._store.add

    def unheard(*given):
        add(*given)
        raise StoreError("the connection was lost")

    monkeypatch.setattr(twins._store, "add", unheard)
    with pytest.raises(StoreError):
        twins.start(_request(speed=50, at_end="repeat"))
    _until(lambda: twins.ids() == ["t"] and twins._store.get("t").samples > 5)
    assert [event["kind"] for event in twins.events("t", -1, 1)] == ["started"]


def test_a_plug_in_that_no_longer_starts_gives_way_to_logic(opened, monkeypatch):
    twins = opened()
    for name in ("t", "u"):
        twins.start(_request(id=name, speed=50, at_end="repeat"))
        _until(lambda name=name: twins._store.get(name).samples > 5)
    twins.close()
    monkeypatch.setattr(twins_service, "create_from", lambda text: create(text) if text == "logic" else Unstartable())
    again = opened()
    again.resume_all()
    assert sorted(again.ids()) == ["t", "u"]
    assert again.state("t").controller == "logic"
    resumed = next(event for event in again.listeners[0].events if event.kind == "resumed")
    assert "no license" in resumed.details["memory"]


def test_an_id_can_be_used_again_while_the_store_is_behind(opened):
    twins = opened()
    twins.start(_request(speed=200, at_end="repeat"))
    _until(lambda: twins._store.get("t").samples > 20)
    twins._store.trouble = lambda checkpoint: time.sleep(0.5)
    _until(lambda: twins._keeper.behind > 1)
    twins.stop("t")
    twins.remove("t")
    twins.start(_request(speed=200, at_end="repeat", controller="logic", seed=9, replication=4))
    twins._store.trouble = lambda checkpoint: None
    _until(lambda: twins._store.get("t").samples > 600)
    twins.close()
    told = {sample.seq: sample.row for sample in twins.listeners[0].samples}
    kept = opened().history("t", 0, 100_000)
    assert [sample.seq for sample in kept] == list(range(len(kept)))
    last_start = max(n for n, sample in enumerate(twins.listeners[0].samples) if sample.seq == 0)
    told = [sample.row for sample in twins.listeners[0].samples[last_start:]]
    assert np.array([sample.row for sample in kept]).tobytes() == np.array(told).tobytes()


def test_a_slow_store_delays_no_tick_and_loses_nothing(opened):
    twins = opened()
    told = twins.listeners[0].samples
    went_on = []

    def slow(_):
        """Storing ends when every twin has told 20 seconds more, or, had they waited for it, much later."""
        goal, until = len(told) + 80, time.monotonic() + 20
        while len(told) < goal and time.monotonic() < until:
            time.sleep(0.01)
        went_on.append(len(told) >= goal)

    twins._store.trouble = slow
    for number in range(4):
        twins.start(_request(id=f"t{number}", speed=100, at_end="repeat"))
    _until(lambda: len(went_on) >= 5)
    assert all(went_on)
    history = twins.history("t0", 0, 10_000)
    assert [sample.seq for sample in history] == list(range(len(history)))
    assert len(history) > 20


def test_events_of_a_killed_twin_are_those_of_one_that_ran_on(opened):
    whole = opened()
    whole.start(_request(id="whole", at_end="stop"))
    _until(lambda: whole.state("whole").state == "finished")
    twins = opened()
    twins.start(_request(speed=400, at_end="stop"))
    for _ in range(4):
        wanted = twins._store.get("t").samples + 60
        _until(lambda wanted=wanted, twins=twins: twins._store.get("t").samples >= wanted)
        _kill(twins)
        twins = opened()
        twins.resume_all()
    _until(lambda: twins.state("t").state == "finished")

    def told(service, twin):
        found = service.events(twin, -1, 10_000)
        assert [event["seq"] for event in found] == list(range(len(found)))
        return [(event["time"], event["kind"], event["details"]) for event in found if event["kind"] in TOLD]

    assert told(twins, "t") == told(whole, "whole")


def test_a_stream_goes_on_behind_the_last_event_it_told(opened):
    twins = opened(checkpoint_s=60)
    twins.start(_request(speed="max", at_end="repeat"))
    _until(lambda: twins._store.get("t").events > 200)
    _until(lambda: twins.listeners[0].events[-1].seq > twins._store.get("t").events)
    _kill(twins)
    told = twins.listeners[0].events
    again = opened()
    again.resume_all()
    _until(lambda: again.state("t").events > told[-1].seq + 20)
    again.close()
    kept = again.events("t", -1, 100_000)
    for last in (told[0], told[100], told[-60], told[-1]):  # the last of them were lost, and their numbers given anew
        place = begin(again, "t", replace(begin(again, "t", None), epoch=1, event=last.seq))
        behind = [event for event in kept if event["seq"] > place.event]
        assert behind == [event for event in kept if event["epoch"] > 1 or event["seq"] > last.seq]
    assert begin(again, "t", None).event == len(kept) - 51


def test_samples_go_on_while_events_wait_for_the_store(opened, monkeypatch):
    twins = opened()
    twins.start(_request(speed=50, at_end="repeat"))
    _until(lambda: twins._store.get("t").events > 3)

    def away(*_):
        raise StoreError("away")

    async def heard():
        broadcast = Broadcast()
        twins.live("t")._listeners += (broadcast,)
        news = stream(twins, "t", replace(begin(twins, "t", None), event=-1), broadcast, threading.Event())
        with monkeypatch.context() as broken:
            broken.setattr(twins._store, "events", away)
            before = b"".join([await anext(news) for _ in range(3)])
        return before, await anext(news)

    before, after = asyncio.run(heard())
    assert before.count(b"event: sample") >= 3
    assert b"event: event" not in before
    assert b'"kind":"started"' in after


@pytest.mark.parametrize("error", [StoreError("busy"), RuntimeError("what nobody thought of")])
def test_a_store_that_fails_for_a_while_costs_no_event(opened, error):
    twins = opened()
    failing = iter([False, True, True])

    def trouble(checkpoint):
        if next(failing, False):
            raise error

    twins._store.trouble = trouble
    twins.start(_request(speed=100, at_end="repeat"))
    _until(lambda: next(failing, None) is None and twins._store.get("t").samples > 300)
    twins.close()
    again = opened()
    kept = again.events("t", -1, 10_000)
    assert [event["seq"] for event in kept] == [event.seq for event in twins.listeners[0].events]
    assert [sample.seq for sample in again.history("t", 0, 10_000)] == list(range(again._store.get("t").samples))
    assert again._store.get("t").events == len(kept)


def test_history_has_no_hole_and_no_double_while_it_is_written(opened):
    twins = opened()
    twins.start(_request(at_end="repeat"))
    wrong, ending = [], threading.Event()

    def read():
        while not ending.is_set():
            end = twins.samples("t")
            found = [sample.seq for sample in twins.history("t", max(0, end - 900), 900)]
            if found and found != list(range(found[0], found[0] + len(found))):
                wrong.append(found)
            numbers = [event["seq"] for event in twins.events("t", max(-1, twins.state("t").events - 300), 200)]
            if numbers and numbers != list(range(numbers[0], numbers[0] + len(numbers))):
                wrong.append(numbers)

    readers = [threading.Thread(target=read) for _ in range(2)]
    for reader in readers:
        reader.start()
    time.sleep(3)
    _until(lambda: twins.samples("t") > 1000)
    ending.set()
    for reader in readers:
        reader.join(30)
    assert wrong == []


def test_a_twin_that_is_said_to_have_ended_is_stored_so(opened, monkeypatch):
    """Or a service that is killed right behind its answer would go on with it."""
    monkeypatch.setattr(twins_commands, "STORED_S", 0.2)
    twins = opened()
    twins.start(_request(speed=50, at_end="repeat"))
    _until(lambda: twins._store.get("t").samples > 5)

    def away(checkpoint):
        raise StoreError("away")

    twins._store.trouble = away
    with pytest.raises(StoreError, match="not stored yet"):
        twins.stop("t")
    assert twins._store.get("t").state == "running"
    twins._store.trouble = lambda checkpoint: time.sleep(0.3)
    monkeypatch.setattr(twins_commands, "STORED_S", 30.0)
    assert twins.stop("t").state == "stopped"
    assert twins._store.get("t").state == "stopped"


def test_commands_that_come_too_late_are_answered(opened):
    twins = opened()
    twins.start(_request(speed=10))
    twin = twins.live("t")
    twins.stop("t")
    before = time.monotonic()
    with pytest.raises(InputError, match="has ended"):
        twin.ask(twin.pause, 5.0)
    assert time.monotonic() - before < 3


def test_fifty_twins_close_soon(opened):
    twins = opened()
    for number in range(50):
        twins.start(_request(id=f"t{number}", speed=1, at_end="repeat", controller="logic"))
    _until(lambda: all(state.samples for state in twins.list()))
    before = time.monotonic()
    twins.close()
    took = time.monotonic() - before
    told = dict.fromkeys(twins._live, 0)
    for sample in twins.listeners[0].samples:
        told[sample.twin] = sample.seq + 1
    assert {stored.id: stored.samples for stored in twins._store.all()} == told
    assert took < 5


def test_a_store_that_is_away_for_long_takes_no_endless_memory(opened):
    twins = opened()
    twins.start(_request(speed=50, at_end="repeat"))
    _until(lambda: twins._store.get("t").samples > 5)

    def away(checkpoint):
        raise StoreError("away")

    twins._store.trouble = away
    time.sleep(3)
    assert twins._keeper.behind < 20
    twins._store.trouble = lambda checkpoint: None
    _until(lambda: twins._store.get("t").samples > 160)
    kept = opened().history("t", 0, 150)
    record = simulate(load_scenario("S1"), create("minlp1"))
    assert np.array([sample.row for sample in kept]).tobytes() == _rows(record)[:150].tobytes()


class FailingOnce:
    """A store that fails the first checkpoint, when it is told to."""

    def __init__(self):
        self.asked, self.failing, self.saved = threading.Event(), threading.Event(), []

    def save(self, twin_id, epoch, checkpoint):
        if not self.asked.is_set():
            self.asked.set()
            self.failing.wait(30)
            raise StoreError("full")
        self.saved.append([event["seq"] for event in checkpoint.events])


def test_checkpoints_behind_one_that_failed_are_stored_in_their_order(monkeypatch):
    monkeypatch.setattr(keeper, "RETRY_S", 0.5)
    store, segment = FailingOnce(), keeper.Segment(0)
    kept = keeper.Keeper(store)

    def keep(seq):
        checkpoint = Checkpoint("running", {}, b"", 0, 0, None, ({"seq": seq},))
        kept.keep(keeper.Draft("t", 1, checkpoint, segment, lambda _: None, lambda: None))

    keep(0)
    store.asked.wait(30)
    keep(1)  # behind the one that is being stored
    store.failing.set()
    _until(lambda: kept._saving is None)
    keep(2)  # while that waits to be tried again
    _until(lambda: not kept.behind)
    kept.close()
    assert store.saved == [[0], [1, 2]]


def test_a_lost_checkpoint_gives_no_number_twice(opened, monkeypatch):
    monkeypatch.setattr(keeper, "RETRY_S", 0.01)
    twins = opened()
    twins.start(_request(speed=200, at_end="repeat"))
    _until(lambda: twins._store.get("t").samples > 20)
    tries = []

    def trouble(checkpoint):
        if checkpoint.events and len(tries) < keeper.TRIES_MAX:
            tries.append(checkpoint)
            raise RuntimeError("what nobody thought of")

    twins._store.trouble = trouble
    _until(lambda: len(tries) == keeper.TRIES_MAX and twins._store.get("t").samples > 400)
    twins.close()
    told = [event.seq for event in twins.listeners[0].events]
    again = opened()
    again.resume_all()
    _until(lambda: again._store.get("t").samples > 800)
    again.close()
    told += [event.seq for event in again.listeners[0].events]
    assert told == list(range(len(told)))
    kept = [event["seq"] for event in opened().events("t", -1, 10_000)]
    lost = {event["seq"] for event in tries[-1].events}
    assert lost
    assert kept == [number for number in told if number not in lost]
    samples = opened().history("t", 0, 10_000)
    assert [sample.seq for sample in samples] == list(range(len(samples)))
