"""Replays: a stretch of what a twin told is told again, the same rows and events, at any speed and across restarts."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from api.http.problems import ProblemError
from api.http.timeseries import Selection
from api.store.database import Database
from api.twins.estimates import estimate_of
from api.twins.replay import OF_THE_TWIN, replay_request
from api.twins.schemas import TwinChange, TwinOrder, VehicleRequest
from station import InputError
from tests.api.measured import batches, measured
from tests.api.reopened import kill, opening, request
from tests.api.test_measured_twins import _send, _taken
from tests.waiting import wait_until


def order(**more):
    return TwinOrder.model_validate({"id": "r", "source": "replay", "of": "t", "speed": "max", **more})


def play(twins, **more):
    return twins.start(replay_request(twins, order(**more)))


def told(twins, twin_id, first, last):
    """What a twin told of some seconds, but for who told it, and when."""
    rows = [(sample.seq, repr(sample.row)) for sample in twins.history(twin_id, first, last + 1 - first)]
    events = [
        (event["time"], event["kind"], event["details"])
        for event in twins.events(twin_id, -1, 10_000)
        if first <= event["time"] <= last and event["kind"] not in OF_THE_TWIN
    ]
    return rows, events


def finished(twins):
    """The server, once its twin `t` has run to its end."""
    twins.start(request(controller="logic", at_end="stop"))
    wait_until(lambda: twins.state("t").state == "finished")
    wait_until(lambda: twins._live["t"].journal.rows_from(0)[0] > 1200)  # what is stored is in memory no more
    return twins


@pytest.fixture(scope="module")
def original(tmp_path_factory):
    """A server whose twin `t` has run to its end."""
    store = Database(f"sqlite:///{tmp_path_factory.mktemp('played') / 'hrs.db'}")
    store.migrate()
    with opening(store, checkpoint_s=0.1) as make:
        yield finished(make())
    store.close()


def test_a_stretch_is_told_again_to_the_last_bit(original):
    state = play(original, from_s=300, to_s=1200)
    assert (state.source, state.of, state.from_s, state.to_s, state.layout) == ("replay", "t", 300, 1200, "thesis")
    wait_until(lambda: original.state("r").state == "finished")
    rows, events = told(original, "r", 300, 1200)
    assert (rows, events) == told(original, "t", 300, 1200)
    assert len(rows) == 901
    assert {"arrival", "fill_start", "fill_end", "valve_change"} <= {kind for _, kind, _ in events}
    found = [original.columns(each, Selection(start=300.0, end=1200.0)) for each in "rt"]
    for name in found[0].keys() - {"sent"}:
        assert found[0][name].tobytes() == found[1][name].tobytes(), name
    kinds = [event["kind"] for event in original.events("r", -1, 10_000)]
    assert (kinds[0], kinds[-1]) == ("started", "finished")
    assert original.days("r") == []
    play(original, id="again", of="r")
    wait_until(lambda: original.state("again").state == "finished")
    assert told(original, "again", 300, 1200) == (rows, events)


@pytest.mark.slow
def test_a_replay_goes_on_behind_a_kill(opened):
    original = finished(opened())
    play(original, from_s=100, speed=1000)
    for wanted in (400, 800):
        store = original._store
        wait_until(lambda wanted=wanted, store=store: store.get("r").samples > wanted)
        kill(original)
        original = opened()
        original.resume_all()
    original.change("r", TwinChange(speed="max"))
    wait_until(lambda: original.state("r").state == "finished")
    last = original.state("t").samples - 1
    rows, events = told(original, "r", 100, last)
    assert (rows, sorted(map(repr, events))) == (
        told(original, "t", 100, last)[0],
        sorted(map(repr, told(original, "t", 100, last)[1])),
    )


def test_a_replay_stands_still_and_is_given_nothing_it_has_not(original):
    play(original, id="held", speed=1, paused=True)
    assert original.state("held").state == "paused"
    original.change("held", TwinChange(speed=50, paused=False))
    wait_until(lambda: original.current("held") is not None)
    original.change("held", TwinChange(paused=True))
    for refused in (
        lambda: original.change("held", TwinChange(controller="logic")),
        lambda: original.add_vehicle("held", VehicleRequest(start_pressure_bar=50)),
        lambda: original.command("held", {"command": "controller", "controller": "logic"}),
    ):
        with pytest.raises(ProblemError, match="'held' is a replay of 't': it has no controller or vehicles"):
            refused()
    with pytest.raises(ProblemError, match="'held' is a replay: it takes no measurements"):
        original.measure("held", "plc", 0, batches(1)[0])
    with pytest.raises(ProblemError, match="'t' is played by 'held'; stop that first"):
        original.remove("t")
    original.stop("held")
    original.remove("held")


def test_what_was_measured_is_played_with_its_estimates(opened):
    twins, sent = opened(), batches(150)
    twins.start(measured())
    with pytest.raises(ProblemError, match="has told no second yet"):
        play(twins, of="m")
    _send(twins, sent)
    wait_until(lambda: _taken(twins) == 150)
    state = play(twins, of="m", from_s=50)
    assert state.layout == "measured"
    wait_until(lambda: twins.state("r").state == "finished")
    last = state.to_s
    for each in zip(twins.history("r", 50, 1000), twins.history("m", 50, last - 49), strict=True):
        assert np.array(each[0].row).tobytes() == np.array(each[1].row).tobytes()
    played, live = estimate_of(twins, "r"), estimate_of(twins, "m")
    assert (played.seq, played.quantities) == (live.seq, live.quantities)


@pytest.mark.parametrize(
    ("stretch", "message"),
    [
        ({"to_s": 10**6}, "to_s: must be at most"),
        ({"from_s": 9, "to_s": 8}, "from_s: must not lie behind second 8; given 9"),
        ({"of": "nobody"}, "of: no twin is called 'nobody'"),
    ],
)
def test_a_stretch_that_was_not_told_is_named(original, stretch, message):
    with pytest.raises(InputError, match=message):
        play(original, **stretch)


def test_seconds_that_are_kept_as_minutes_are_not_played(original, monkeypatch):
    monkeypatch.setattr(original._store, "first_kept", lambda twin_id, seq: 600)
    with pytest.raises(InputError, match=r"from_s: must be at least 600: of older seconds minutes are left"):
        play(original, from_s=599)
    assert replay_request(original, order()).from_s == 600


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"of": None}, "of must be given where source is replay"),
        ({"scenario": "S1"}, "must be left out where source is replay"),
        ({"controller": "minlp1", "seed": 3}, "controller, seed must be left out where source is replay"),
        ({"source": "simulated", "scenario": "S1"}, "must be left out where of is given"),
        ({"source": "simulated", "of": None}, "must be given: the name of a scenario, or a whole one"),
    ],
)
def test_an_order_that_makes_no_sense_is_refused(given, message):
    with pytest.raises(ValidationError, match=message):
        order(**given)
