"""Twins that follow measurements: nothing accepted is lost or doubled, whenever they are killed."""

from __future__ import annotations

import random
import threading

import numpy as np
import pytest
from pydantic import ValidationError

from api.http.problems import ProblemError
from api.http.timeseries import Selection
from api.store.database import StoreError
from api.store.records import Conflict, Superseded
from api.twins import measured as measured_twins
from api.twins.checkpointer import Checkpointer
from api.twins.estimates import estimate_of
from api.twins.messages import MEASURED, sample_columns
from api.twins.schemas import TwinChange, VehicleRequest
from api.twins.segments import decode, encode
from station import load_scenario
from station.estimation import filter as filters
from station.estimation import followed as followed_runs
from tests.api.measured import BEGIN, batches, followed, measured
from tests.api.reopened import kill, opening, request
from tests.waiting import wait_until


@pytest.fixture
def opened(database):
    with opening(database, checkpoint_s=0.2) as make:
        yield make


def _send(twins, sent, first=0):
    """Send batches in order, again where the twin is behind, as whoever sends must."""
    stored = []
    for sequence, batch in enumerate(sent, first):
        wait_until(lambda sequence=sequence, batch=batch: stored.append(_try(twins, sequence, batch)) or stored[-1])
    return [each for each in stored if each is not None]


def _try(twins, sequence, batch):
    try:
        return twins.measure("m", "plc", sequence, batch)
    except ProblemError as error:
        if error.retry_after_s is None:
            raise
        return None


def _rows(twins):
    """Rows of the history without their number and when they were told."""
    found = twins.history("m", 0, 100_000)
    assert [sample.seq for sample in found] == list(range(len(found)))
    assert [sample.row[0] for sample in found] == [float(n) for n in range(len(found))]
    return np.array([sample.row[1:] for sample in found])


def _taken(twins):
    return twins.measured("m").taken


@pytest.mark.slow
def test_a_twin_follows_what_it_is_sent_to_the_last_bit(opened):
    twins, sent = opened(), batches(200)
    twins.start(measured())
    stored = _send(twins, sent)
    assert [each.number for each in stored] == list(range(1, 201))
    wait_until(lambda: _taken(twins) == 200)
    twins.stop("m")
    wanted = followed(sent, finish=True)
    assert len(wanted) == 201
    assert _rows(twins).tobytes() == wanted.tobytes()
    assert (twins.state("m").state, twins.state("m").source, twins.state("m").samples) == ("stopped", "measured", 201)
    twins.close()
    assert _rows(opened()).tobytes() == wanted.tobytes()


@pytest.mark.slow
def test_what_is_sent_again_counts_once(opened):
    twins, sent = opened(), batches(80)
    twins.start(measured())
    for n, batch in enumerate(sent):
        _send(twins, [batch], n)
        (again,) = _send(twins, [batch], n)
        assert (again.number, again.repeated) == (n + 1, True)
    with pytest.raises(Conflict, match="other content"):
        twins.measure("m", "plc", 3, sent[4])
    wait_until(lambda: _taken(twins) == 80)
    twins.stop("m")
    assert _rows(twins).tobytes() == followed(sent, finish=True).tobytes()


def _through_kills(opened, kills, seed):
    """Kill the server again and again, at any moment, while a sender sends and repeats what was not answered."""
    chance, sent = random.Random(seed), batches(40 + 30 * (kills + 1))
    twins = opened()
    twins.start(measured())
    place = 0
    for _ in range(kills):
        upto = min(len(sent), place + chance.randrange(10, 50))
        _send(twins, sent[place:upto], place)
        if chance.random() < 0.5:
            wanted = chance.randrange(place, upto + 1)
            wait_until(lambda wanted=wanted, twins=twins: _taken(twins) >= wanted)
        kill(twins)
        place = max(0, upto - chance.randrange(3))  # who got no answer sends again
        twins = opened()
        twins.resume_all()
    _send(twins, sent[place:], place)
    wait_until(lambda: _taken(twins) == len(sent))
    twins.stop("m")
    assert _rows(twins).tobytes() == followed(sent, finish=True).tobytes()
    counts = twins._live["m"].counts
    assert (counts.late, counts.ahead, counts.duplicate) == (0, 0, 0)


@pytest.mark.slow
def test_a_killed_twin_goes_on_as_if_it_never_had_been(opened):
    _through_kills(opened, 3, seed=1)


def test_what_is_forecast_after_a_restart_begins_with_the_last_second_followed(opened):
    """Before, it said that no second had been followed until new ones came."""
    twins, sent = opened(), batches(80)
    twins.start(measured())
    _send(twins, sent)
    wait_until(lambda: _taken(twins) == len(sent))
    before = twins.fork("m")
    twins.close()
    again = opened()
    again.resume_all()
    after = again.fork("m")
    assert after.scenario == before.scenario
    assert after.fork.state.tobytes() == before.fork.state.tobytes()


@pytest.mark.slow
@pytest.mark.parametrize("seed", [*range(6), *(pytest.param(seed, marks=pytest.mark.full) for seed in range(6, 30))])
def test_a_twin_killed_often_goes_on_as_if_it_never_had_been(opened, seed):
    _through_kills(opened, 6, seed)


@pytest.mark.slow
def test_what_was_accepted_is_followed_though_no_checkpoint_came(opened):
    twins, sent = opened(), batches(90)
    twins.start(measured())
    wait_until(lambda: twins._store.snapshot("m") is not None)
    twins._checkpointer._save = lambda draft: None
    _send(twins, sent)
    kill(twins)
    again = opened()
    again.resume_all()
    wait_until(lambda: _taken(again) == 90)
    again.stop("m")
    assert _rows(again).tobytes() == followed(sent, finish=True).tobytes()


@pytest.mark.slow
def test_a_twin_goes_on_behind_an_update_of_the_service(opened, monkeypatch):
    """It was `failed` for good: what the version before estimated cannot be read."""
    twins, sent = opened(), batches(90)
    twins.start(measured())
    _send(twins, sent[:60])
    wait_until(lambda: _taken(twins) == 60)
    twins.close()
    monkeypatch.setattr(followed_runs, "SNAPSHOT_VERSION", followed_runs.SNAPSHOT_VERSION + 1)
    again = opened()
    again.resume_all()
    _send(again, sent[60:], 60)
    wait_until(lambda: _taken(again) == 90)
    again.stop("m")
    assert _rows(again)[:, 0].tolist() == followed(sent, finish=True)[:, 0].tolist()
    resumed = [each for each in again.last_events("m", 1 << 60, 100) if each["kind"] == "resumed"]
    assert [each["details"]["renewed"] for each in resumed] == [True]


def test_who_sends_waits_where_the_store_is_behind_for_long_not_where_many_twins_store_at_once(opened, monkeypatch):
    twins, (first, second) = opened(), batches(2)
    twins.start(measured())
    monkeypatch.setattr(Checkpointer, "behind", 50)
    assert twins.measure("m", "plc", 0, first).number == 1
    monkeypatch.setattr(Checkpointer, "lag", measured_twins.LAG_MAX + 1)
    with pytest.raises(ProblemError, match="the store is 6 s behind") as refused:
        twins.measure("m", "plc", 1, second)
    assert refused.value.retry_after_s == measured_twins.RETRY_AFTER_S
    monkeypatch.undo()
    assert twins.measure("m", "plc", 1, second).number == 2


@pytest.mark.slow
def test_what_the_log_has_and_nobody_told_is_read_from_it(opened, monkeypatch):
    """An answer of the database may be lost behind its commit: whoever sends again, or sends more, repairs it."""
    twins, sent = opened(), batches(80)
    twins.start(measured())
    log = twins._store.measurements
    append = log.append

    def lost(*given):
        append(*given)
        raise StoreError("the connection was lost behind the commit")

    _send(twins, sent[:30])
    monkeypatch.setattr(log, "append", lost)
    with pytest.raises(StoreError):
        twins.measure("m", "plc", 30, sent[30])
    monkeypatch.setattr(log, "append", append)
    assert twins.measure("m", "plc", 31, sent[31]).number == 32
    wait_until(lambda: _taken(twins) == 32)
    assert twins.measure("m", "plc", 30, sent[30]).repeated
    _send(twins, sent[32:], 32)
    wait_until(lambda: _taken(twins) == 80)
    twins.stop("m")
    assert _rows(twins).tobytes() == followed(sent, finish=True).tobytes()


@pytest.mark.slow
def test_the_log_is_read_again_when_it_could_not_be(opened, monkeypatch):
    monkeypatch.setattr(measured_twins, "RETRY_S", 0.05)
    twins, sent = opened(), batches(70)
    twins.start(measured())
    wait_until(lambda: twins._store.snapshot("m") is not None)
    twins._checkpointer._save = lambda draft: None
    _send(twins, sent)
    kill(twins)
    again, fails = opened(), []
    after = again._store.measurements.after

    def away(*given):
        fails.append(given)
        if len(fails) <= 3:
            raise StoreError("away")
        return after(*given)

    monkeypatch.setattr(again._store.measurements, "after", away)
    again.resume_all()
    wait_until(lambda: _taken(again) == 70)
    assert len(fails) > 3


@pytest.mark.slow
def test_payloads_go_when_a_checkpoint_has_them(opened):
    twins = opened()
    twins.start(measured())
    _send(twins, batches(20))
    wait_until(lambda: twins._store.measurements.after("m", 0, 100) == [])
    assert _taken(twins) == 20


def test_who_sends_too_fast_is_told_to_wait(opened, monkeypatch):
    monkeypatch.setattr(measured_twins, "WAITING_MAX", 3)
    twins, sent = opened(), batches(10)
    twins.start(measured())
    twin = twins.measured("m")
    held = threading.Event()
    twin._commands.tell(held.wait)
    _send(twins, sent[:3])
    with pytest.raises(ProblemError) as caught:
        twins.measure("m", "plc", 3, sent[3])
    assert (caught.value.problem.status, caught.value.retry_after_s) == (503, 1)
    assert len(twins._store.measurements.after("m", 0, 9)) == 3, "nothing of it is stored"
    held.set()
    wait_until(lambda: _taken(twins) == 3)
    assert twins.measure("m", "plc", 3, sent[3]).number == 4


def test_measurements_that_do_not_follow_are_told_and_passed(opened):
    twins, sent = opened(), batches(70)
    twins.start(measured())
    _send(twins, sent[:65])
    later = sent[65].part(slice(None))
    far = type(later)(later.tag, later.time + 200_000, later.value, later.quality)
    twins.measure("m", "plc", 65, far)
    _send(twins, sent[65:], 66)
    wait_until(lambda: _taken(twins) == 71)
    (told,) = [event for event in twins.events("m", -1, 100) if event["kind"] == "measurements_refused"]
    assert told["details"]["number"] == 66
    assert "must not go on by more than 86400 s" in told["details"]["problem"]
    twins.stop("m")
    assert _rows(twins).tobytes() == followed(sent, finish=True).tobytes()


def test_a_measured_twin_has_nothing_to_operate(opened):
    twins = opened()
    twins.start(measured())
    for change in (TwinChange(paused=True), TwinChange(speed=2), TwinChange(controller="logic")):
        with pytest.raises(ProblemError, match="follows measurements") as caught:
            twins.change("m", change)
        assert caught.value.problem.status == 409
    with pytest.raises(ProblemError, match="follows measurements"):
        twins.add_vehicle("m", VehicleRequest(start_pressure_bar=50))
    assert twins.days("m") == []
    twins.start(request(speed=1))
    with pytest.raises(ProblemError, match="is simulated: it takes no measurements"):
        twins.measure("t", "plc", 0, batches(1)[0])
    wait_until(lambda: twins.current("t") is not None)
    with pytest.raises(ProblemError, match="is simulated: nothing is estimated"):
        estimate_of(twins, "t")


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"tags": None}, "tags must be given where source is measured"),
        ({"source": "simulated"}, "tags must be left out where source is simulated"),
        ({"speed": 2, "controller": "minlp1"}, "controller, speed must be left out where source is measured"),
    ],
)
def test_an_order_that_makes_no_sense_is_refused(given, message):
    with pytest.raises(ValidationError, match=message):
        measured(**given)


def test_a_station_that_cannot_be_followed_is_refused_before_anything_is_stored(opened, monkeypatch):
    monkeypatch.setattr(filters, "_MODELS", {"thesis": filters.model_of_plant("thesis")})
    twins = opened()
    with pytest.raises(ValueError, match="plant"):
        twins.start(measured(scenario={**load_scenario("S1").model_dump(mode="json"), "station": "h70-light"}))
    assert not twins.known("m")


def test_a_twin_that_runs_elsewhere_takes_nothing_here(opened):
    twins = opened()
    twins.start(measured())
    _send(twins, batches(5))
    twins._store.open("m")
    with pytest.raises(ProblemError, match=r"runs elsewhere|takes no measurements") as caught:
        twins.measure("m", "plc", 5, batches(6)[5])
    assert caught.value.problem.status == 409
    with pytest.raises(Superseded):
        twins._store.measurements.append("m", 1, "plc", 9, "d", 1, b"")


@pytest.mark.slow
def test_estimates_have_their_deviations_innovations_and_units(opened):
    twins, sent = opened(), batches(100)
    twins.start(measured())
    with pytest.raises(ProblemError, match="has followed no second yet"):
        estimate_of(twins, "m")
    _send(twins, sent)
    wait_until(lambda: _taken(twins) == 100)
    wanted, found = followed(sent), estimate_of(twins, "m")
    columns = list(sample_columns(MEASURED))
    last = dict(zip(columns[1:], wanted[-1], strict=True))
    assert (found.seq, found.source_time, found.number) == (len(wanted) - 1, last["source_time"], 100)
    assert found.source_time > BEGIN + 60
    assert found.samples.taken > 1000
    for name, each in found.quantities.items():
        for value, column in ((each.value, f"estimate_{name}"), (each.deviation, f"deviation_{name}")):
            assert (value is None) == bool(np.isnan(last[column]))
            assert value is None or value == last[column]
    assert {"mass_high", "temperature_high"} <= set(found.quantities)
    assert found.quantities["mass_high"].unit == "g"
    assert found.sensors["pressure_high"].unit == "bar"
    assert found.sensors["pressure_high"].innovation is not None
    assert found.sensors["inlet_high"].innovation is None


@pytest.mark.slow
def test_history_has_the_columns_of_what_is_followed(opened):
    twins, sent = opened(), batches(80)
    twins.start(measured())
    _send(twins, sent)
    wait_until(lambda: _taken(twins) == 80)
    table = twins.columns("m", Selection(columns=("estimate_mass_high", "source_time"), start=5.0, end=9.0))
    assert table["time"].tolist() == [5.0, 6.0, 7.0, 8.0, 9.0]
    assert table["source_time"].tolist() == [BEGIN + n for n in range(5, 10)]
    assert twins.units("m")["deviation_temperature_high"] == "K"


def test_rows_of_what_is_followed_are_kept_bit_for_bit():
    rows = [(float(n), *row.tolist(), 1e9 + n) for n, row in enumerate(followed(batches(70)))]
    assert len(rows) > 1
    assert np.array(decode(encode(rows, None, MEASURED), MEASURED)).tobytes() == np.array(rows).tobytes()
