"""Live twins on both databases: what they store, how they resume, who may disturb them."""

from __future__ import annotations

import time

import numpy as np
import pytest

from api.http.problems import ProblemError
from api.http.timeseries import Fold, Selection
from api.packing import Basis
from api.store.records import CapacityError, Conflict
from api.twins import commands as twin_commands
from api.twins import service as twins_service
from api.twins.messages import COLUMNS
from api.twins.schemas import TwinChange, VehicleRequest
from api.twins.segments import decode, encode, stored_columns
from controllers import create
from controllers.base import BaseController
from station import Decision, InputError, Status, load_scenario, simulate
from station.live import AtEnd
from tests.api.reopened import opening, request, run_through_kills
from tests.waiting import wait_until

S1 = load_scenario("S1")


@pytest.fixture
def opened(database):
    """Opens the twins of a server again and again, on both databases."""
    with opening(database, checkpoint_s=0.2) as make:
        yield make


def _history(twins, twin="t"):
    found, first = [], 0
    while page := twins.history(twin, first, 700):
        found += page
        first = page[-1].seq + 1
    return found


def test_a_twin_at_full_speed_stores_the_simulation(opened):
    twins = opened()
    ear = twins.observers[0]
    twins.start(request(at_end="stop", seed=3, replication=1))
    wait_until(lambda: twins.state("t").state == "finished")
    record = simulate(S1, create("minlp1"), replication=1, seed=3)
    expected = np.array([record[name] for name in COLUMNS], float).T
    told = np.array([sample.row for sample in ear.samples])
    assert told.tobytes() == expected.tobytes()
    again = opened()
    wait_until(lambda: again.state("t").samples == len(record))
    kept = again.columns("t", Selection())
    for place, name in enumerate(COLUMNS):
        assert kept[name].astype(float).tobytes() == expected[:, place].tobytes()
        assert kept[name].dtype == record[name].dtype
    (last,) = again.history("t", len(record) - 1, 5)
    np.testing.assert_array_equal(last.row, ear.samples[-1].row)
    assert [event["seq"] for event in again.events("t", -1, 5000)] == [event.seq for event in ear.events]
    assert ear.lives == ["+t", "-t"]


@pytest.mark.slow
@pytest.mark.parametrize("controller", ["minlp1", "logic:dispense=cascade"])
def test_a_killed_twin_goes_on_from_its_last_checkpoint(opened, controller):
    twins = run_through_kills(opened, request(at_end="stop", controller=controller, speed=400), 3, 100)
    record = simulate(S1, create("minlp1") if controller == "minlp1" else create("logic", dispense="cascade"))
    samples = _history(twins)
    assert [sample.seq for sample in samples] == list(range(len(record)))
    expected = np.array([record[name] for name in COLUMNS], float).T
    assert np.array([sample.row for sample in samples]).tobytes() == expected.tobytes()
    resumed = [event for event in twins.events("t", -1, 5000) if event["kind"] == "resumed"]
    epochs = [event["epoch"] for event in resumed]
    assert epochs == [2, 3, 4]
    assert {event["details"]["memory"] for event in resumed} == {"restored"}
    assert all(twins.epochs("t")[event["epoch"]] == event["details"]["from_seq"] for event in resumed)


def test_an_orderly_stop_costs_no_second(opened):
    twins = opened()
    twins.start(request(speed=50, at_end="repeat"))
    wait_until(lambda: twins.state("t").samples > 20)
    twins.change("t", TwinChange(controller="logic", speed=20))
    twins.close()
    told = twins.observers[0].samples[-1].seq
    again = opened()
    assert again._store.get("t").samples == told + 1
    again.resume_all()
    wait_until(lambda: len(again.observers[0].samples) > 3)
    assert again.observers[0].samples[0].seq == told + 1
    state = again.state("t")
    assert (state.controller, state.speed, state.epoch, state.state) == ("logic", 20, 2, "running")


def test_a_paused_twin_stays_paused_over_a_restart(opened):
    twins = opened()
    twins.start(request(speed=50, at_end="idle"))
    twins.change("t", TwinChange(paused=True))
    twins.close()
    again = opened()
    again.resume_all()
    samples = again.state("t").samples
    time.sleep(0.3)
    assert (again.state("t").state, again.state("t").samples) == ("paused", samples)
    assert again.change("t", TwinChange(paused=False)).state == "running"


def test_a_twin_that_runs_elsewhere_ends_here_and_writes_nothing(opened):
    first = opened()
    first.start(request(speed=50, at_end="repeat"))
    wait_until(lambda: first._store.get("t").samples > 5)
    second = opened()
    second.resume_all()
    wait_until(lambda: first.observers[0].lives == ["+t", "-t"])
    wait_until(lambda: second._store.get("t").samples > second._live["t"].first)
    samples = _history(second)
    assert [sample.seq for sample in samples] == list(range(len(samples)))


class Hangs(BaseController):
    """Answers late, or never."""

    name = "hangs"

    def decide(self, seen):
        time.sleep(0.2 if seen.time % 2 else 0.0)
        return Decision(0)


class Raises(BaseController):
    """Does not answer."""

    name = "raises"

    def decide(self, seen):
        raise RuntimeError("no")


@pytest.mark.timed
@pytest.mark.parametrize("kind", [Hangs, Raises])
def test_a_bad_controller_stops_nobody(opened, monkeypatch, kind):
    monkeypatch.setattr(twins_service, "create_from", lambda _: kind())
    monkeypatch.setattr(twin_commands, "check", lambda *_: None)
    twins = opened()
    twins.start(request(speed=20, at_end="repeat", controller="bad"))
    ear = twins.observers[0]
    wait_until(lambda: len(ear.samples) > 30)
    place = list(COLUMNS).index("decision_status")
    assert Status.FALLBACK in [sample.row[place] for sample in ear.samples]
    assert "deadline_missed" in [str(event.kind) for event in ear.events]
    assert twins.state("t").lateness_max_s < 2


def test_a_wrong_order_changes_nothing(opened):
    twins = opened(twins_max=2)
    twins.start(request(speed=10))
    with pytest.raises(Conflict):
        twins.start(request())
    twins.start(request(id="u", speed=10))
    with pytest.raises(CapacityError):
        twins.start(request(id="v"))
    for change in ({"controller": "nobody"}, {"controller": "minlp1:horizon=11"}):
        with pytest.raises(InputError):
            twins.change("t", TwinChange(**change))
    with pytest.raises(InputError, match="finish pressure"):
        twins.add_vehicle("t", VehicleRequest(start_pressure_bar=800))
    assert twins.state("t").controller == "minlp1"
    with pytest.raises(ProblemError):
        twins.remove("t")
    twins.stop("t")
    for order in (lambda: twins.change("t", TwinChange(speed=2)), lambda: twins.state("nobody")):
        with pytest.raises(ProblemError):
            order()
    assert twins.stop("t").state == "stopped"
    twins.remove("t")
    with pytest.raises(ProblemError):
        twins.state("t")
    twins.start(request(speed=10))


@pytest.mark.timed
@pytest.mark.slow
def test_twenty_twins_at_1x_are_on_time(opened):
    twins = opened()
    for number in range(20):
        twins.start(request(id=f"t{number}", speed=1, at_end="repeat"))
    time.sleep(5)
    states = twins.every()
    assert len(states) == 20
    assert all(state.samples >= 4 for state in states)
    assert max(state.lateness_max_s for state in states) < 1.0


def test_old_samples_are_forgotten_and_the_twin_goes_on(opened):
    twins = opened()
    twins.start(request(at_end="stop"))
    wait_until(lambda: twins.state("t").state == "finished")
    again = opened()
    wait_until(lambda: again._store.get("t").state == "finished")
    assert again._store.prune(time.time() + 60) > 0
    assert again.history("t", 0, 10) == []
    assert again.columns("t", Selection())["time"].shape == (0,)
    assert again.state("t").values is None


def test_rows_survive_their_coding_bit_for_bit():
    record = simulate(S1, create("minlp1"))
    told = [1795253159.0 + second / 8 for second in range(len(record))]
    rows = [tuple(row) for row in np.array([*(record[name] for name in COLUMNS), told], float).T.tolist()]
    content = encode(rows, Basis.of(S1.station), S1.station.plant)
    assert np.array(decode(content, S1.station.plant)).tobytes() == np.array(rows).tobytes()
    assert stored_columns(record.parquet(), ("sent",))["sent"].shape == (len(record),)  # of an older version


@pytest.mark.slow
def test_history_says_when_each_sample_was_told(opened):
    twins = opened()
    began = time.time() - 0.001
    twins.start(request(at_end="stop"))
    wait_until(lambda: twins.state("t").state == "finished")
    wait_until(lambda: twins._store.get("t").state == "finished")
    heard = {sample.seq: sample.sent for sample in twins.observers[0].samples}
    again = opened()
    for source in (twins, again):
        told = {sample.seq: sample.sent for sample in source.history("t", 0, 10_000)}
        assert told == heard
        column = source.columns("t", Selection(columns=("sent",)))["sent"].tolist()
        assert column == list(told.values())
        assert began <= column[0] <= column[-1] <= time.time()


def test_extremes_lose_no_peak(opened):
    twins = opened()
    twins.start(request(at_end="stop"))
    wait_until(lambda: twins.state("t").state == "finished")
    whole = twins.columns("t", Selection(end=1023))
    columns = ("flow_dispenser", "pressure_vehicle", "outlet_low", "time")
    folded = twins.columns("t", Selection(columns, end=1023, step=64, fold=Fold.MIN_MAX))
    assert list(folded) == ["time", "flow_dispenser", "pressure_vehicle", "outlet_low"]
    assert folded["time"].tolist() == [32 * row for row in range(32)]
    for name in columns[:3]:
        steps = whole[name][:1024].reshape(16, 64)
        found = np.sort(folded[name].reshape(16, 2))
        some = ~np.isnan(steps.astype(float)).all(axis=1)
        np.testing.assert_array_equal(found[some, 0], np.nanmin(steps[some], axis=1))
        np.testing.assert_array_equal(found[some, 1], np.nanmax(steps[some], axis=1))
        assert np.isnan(found[~some].astype(float)).all()
        assert folded[name].dtype == whole[name].dtype
    assert twins.columns("t", Selection(columns, start=1e6, step=64, fold=Fold.MIN_MAX))["time"].shape == (0,)
    with pytest.raises(ProblemError, match="1 field is wrong"):
        twins.columns("t", Selection(columns, fold=Fold.MIN_MAX))


def test_a_twin_shows_its_scenario(opened):
    twins = opened()
    station = {"preset": "thesis-fit", "name": "mine", "compressor": {"count": 2}}
    twins.start(request(scenario={**S1.model_dump(mode="json"), "station": station}, paused=True))
    found = twins.scenario("t")
    assert (found.name, found.station.name, found.station.compressor.count) == ("S1", "mine", 2)
    with pytest.raises(ProblemError, match="nobody"):
        twins.scenario("nobody")


def test_at_end_is_what_it_says(opened):
    twins = opened()
    for at_end in AtEnd:
        twins.start(request(id=str(at_end), at_end=at_end))
    wait_until(lambda: all(twins.state(str(at_end)).samples > 1696 or at_end is AtEnd.STOP for at_end in AtEnd))
    wait_until(lambda: twins.state("stop").state == "finished")
    assert twins.state("idle").state == twins.state("repeat").state == "running"
    vehicles = {name: twins.columns(name, Selection(columns=("vehicle",)))["vehicle"] for name in ("idle", "repeat")}
    assert vehicles["idle"].max() == 4
    assert vehicles["repeat"].max() >= 5
