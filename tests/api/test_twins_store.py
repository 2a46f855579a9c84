"""Live twins on a store that is slow, fails or is away: they go on, and what they told is stored in its order."""

from __future__ import annotations

import time

import numpy as np
import pytest

from api.store.database import StoreError
from api.twins import checkpointer
from api.twins.messages import COLUMNS
from controllers import create
from station import load_scenario, simulate
from tests.api.reopened import away, request
from tests.waiting import wait_until


@pytest.mark.slow
def test_an_id_can_be_used_again_while_the_store_is_behind(opened):
    twins = opened()
    twins.start(request(speed=200, at_end="repeat"))
    wait_until(lambda: twins._store.get("t").samples > 20)
    twins._store.trouble = lambda checkpoint: time.sleep(0.5)
    wait_until(lambda: twins._checkpointer.behind > 1)
    twins.stop("t")
    twins.remove("t")
    twins.start(request(speed=200, at_end="repeat", controller="logic", seed=9, replication=4))
    twins._store.trouble = lambda checkpoint: None
    wait_until(lambda: twins._store.get("t").samples > 600)
    twins.close()
    told = {sample.seq: sample.row for sample in twins.observers[0].samples}
    kept = opened().history("t", 0, 100_000)
    assert [sample.seq for sample in kept] == list(range(len(kept)))
    last_start = max(n for n, sample in enumerate(twins.observers[0].samples) if sample.seq == 0)
    told = [sample.row for sample in twins.observers[0].samples[last_start:]]
    assert np.array([sample.row for sample in kept]).tobytes() == np.array(told).tobytes()


def test_a_slow_store_delays_no_tick_and_loses_nothing(opened):
    twins = opened()
    told = twins.observers[0].samples
    went_on = []

    def slow(_):
        """Storing ends when every twin has told 20 seconds more, or, had they waited for it, much later."""
        goal, until = len(told) + 80, time.monotonic() + 20
        while len(told) < goal and time.monotonic() < until:
            time.sleep(0.01)
        went_on.append(len(told) >= goal)

    twins._store.trouble = slow
    for number in range(4):
        twins.start(request(id=f"t{number}", speed=100, at_end="repeat"))
    wait_until(lambda: len(went_on) >= 5)
    assert all(went_on)
    history = twins.history("t0", 0, 10_000)
    assert [sample.seq for sample in history] == list(range(len(history)))
    assert len(history) > 20


@pytest.mark.slow
@pytest.mark.parametrize("error", [StoreError("busy"), RuntimeError("what nobody thought of")])
def test_a_store_that_fails_for_a_while_costs_no_event(opened, error):
    twins = opened()
    failing = iter([False, True, True])

    def trouble(checkpoint):
        if next(failing, False):
            raise error

    twins._store.trouble = trouble
    twins.start(request(speed=100, at_end="repeat"))
    wait_until(lambda: next(failing, None) is None and twins._store.get("t").samples > 300)
    twins.close()
    again = opened()
    kept = again.events("t", -1, 10_000)
    assert [event["seq"] for event in kept] == [event.seq for event in twins.observers[0].events]
    assert [sample.seq for sample in again.history("t", 0, 10_000)] == list(range(again._store.get("t").samples))
    assert again._store.get("t").events == len(kept)


@pytest.mark.slow
def test_a_store_that_is_away_for_long_takes_no_endless_memory(opened):
    twins = opened()
    twins.start(request(speed=50, at_end="repeat"))
    wait_until(lambda: twins._store.get("t").samples > 5)
    twins._store.trouble = away
    time.sleep(3)
    assert twins._checkpointer.behind < 20
    twins._store.trouble = lambda checkpoint: None
    wait_until(lambda: twins._store.get("t").samples > 160)
    kept = opened().history("t", 0, 150)
    record = simulate(load_scenario("S1"), create("minlp1"))
    rows = np.array([record[name] for name in COLUMNS], float).T
    assert np.array([sample.row for sample in kept]).tobytes() == rows[:150].tobytes()


@pytest.mark.slow
def test_a_lost_checkpoint_gives_no_number_twice(opened, monkeypatch):
    monkeypatch.setattr(checkpointer, "RETRY_S", 0.01)
    twins = opened()
    twins.start(request(speed=200, at_end="repeat"))
    wait_until(lambda: twins._store.get("t").samples > 20)
    tries = []

    def trouble(checkpoint):
        if checkpoint.events and len(tries) < checkpointer.TRIES_MAX:
            tries.append(checkpoint)
            raise RuntimeError("what nobody thought of")

    twins._store.trouble = trouble
    wait_until(lambda: len(tries) == checkpointer.TRIES_MAX and twins._store.get("t").samples > 400)
    twins.close()
    told = [event.seq for event in twins.observers[0].events]
    again = opened()
    again.resume_all()
    wait_until(lambda: again._store.get("t").samples > 800)
    again.close()
    told += [event.seq for event in again.observers[0].events]
    assert told == list(range(len(told)))
    kept = [event["seq"] for event in opened().events("t", -1, 10_000)]
    lost = {event["seq"] for event in tries[-1].events}
    assert lost
    assert kept == [number for number in told if number not in lost]
    samples = opened().history("t", 0, 10_000)
    assert [sample.seq for sample in samples] == list(range(len(samples)))
