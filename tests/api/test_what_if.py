"""What-if twins: they begin with another's state, exactly, the same vehicles come, and another may decide."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from api.http.problems import ProblemError
from api.settings import Settings
from api.store.database import Database
from api.twins.messages import EventKind
from api.twins.replay import OF_THE_TWIN, replay_request
from api.twins.schemas import TwinChange, TwinOrder, VehicleRequest
from api.twins.what_if import what_if
from station import InputError, parse_scenario
from station.faults.plant import Leak
from tests.api.measured import measured
from tests.api.reopened import kill, opening, request
from tests.waiting import wait_until

AT = 1200
"""Second at which twins begin with the state of another."""


def branch(twins, **more):
    """Start a twin that begins with the state of `t`."""
    order = TwinOrder.model_validate({"id": "w", "of": "t", "speed": "max", **more})
    asked, snapshot = what_if(twins, order, Settings())
    return twins.start(asked, snapshot=snapshot)


def finished(twins, twin):
    wait_until(lambda: twins.state(twin).state == "finished")


def rows(twins, twin, first=AT):
    found = twins.history(twin, first, 100_000)
    assert [sample.seq for sample in found] == list(range(first, first + len(found)))
    return np.array([sample.row for sample in found])


def told(twins, twin, first=AT):
    return [
        (event["time"], event["kind"], event["details"])
        for event in twins.events(twin, -1, 10_000)
        if event["time"] > first and event["kind"] not in (*OF_THE_TWIN, EventKind.ALARM, EventKind.DAY_END)
    ]


def lived(twins, station="thesis-fit"):
    """A twin `t` that has run to its end, with a vehicle, another controller and a drill on either side of AT."""
    arrivals = {"kind": "uniform", "count": 7, "period_s": 2700.0}
    scenario = parse_scenario({"name": "seven", "station": station, "arrivals": arrivals})
    twins.start(request(scenario=scenario, controller="logic", at_end="stop", speed=150))
    for second in (200, AT + 300):
        wait_until(lambda second=second: twins.samples("t") > second)
        twins.change("t", TwinChange(paused=True))
        assert twins.samples("t") < AT or second > AT
        twins.add_vehicle("t", VehicleRequest(start_pressure_bar=200.0))
        now = float(twins.samples("t"))
        twins.drill("t", Leak(kind="leak", buffer="high", begin_s=now + 5, end_s=now + 50, rate_g_per_s=1.0))
        if second < AT:
            twins.change("t", TwinChange(controller="minlp1"))
        twins.change("t", TwinChange(paused=False, speed=1000 if second < AT else "max"))
    finished(twins, "t")
    return twins


@pytest.fixture(scope="module", params=["thesis-fit", pytest.param("h70-light", marks=pytest.mark.slow)])
def original(tmp_path_factory, request):
    """A server whose twin `t` has run to its end, at a station of each plant."""
    store = Database(f"sqlite:///{tmp_path_factory.mktemp('lived') / 'hrs.db'}")
    store.migrate()
    with opening(store, checkpoint_s=0.1) as make:
        yield lived(make(), request.param)
    store.close()


def test_with_the_same_controller_it_is_the_other_twin_to_the_last_bit(original):
    state = branch(original, at_s=AT)
    assert (state.source, state.of, state.at_s, state.controller) == ("simulated", "t", AT, "minlp1")
    finished(original, "w")
    assert rows(original, "w").tobytes() == rows(original, "t").tobytes()
    added = [event for event in told(original, "t") if event[1] == EventKind.VEHICLE_ADDED]
    assert len(added) == 1
    drilled = [event for event in told(original, "t") if event[1] == EventKind.DRILL]
    assert told(original, "w") == [event for event in told(original, "t") if event not in drilled]
    first = original.events("w", -1, 1)[0]
    assert (first["kind"], first["details"]["of"], first["details"]["at_s"]) == ("started", "t", AT)
    branch(original, id="again", of="w", at_s=AT + 200)
    finished(original, "again")
    assert rows(original, "again", AT + 200).tobytes() == rows(original, "t", AT + 200).tobytes()


def test_another_controller_begins_where_the_first_stood_and_meets_the_same_vehicles(original):
    branch(original, id="other", at_s=AT, controller="reserve")
    finished(original, "other")
    mine, its = rows(original, "other"), rows(original, "t")
    measured_columns = [0, 1, 2, 3, 5, 6, 7, 9, 10, 11]  # time and the buffers
    assert mine[0, measured_columns].tobytes() == its[0, measured_columns].tobytes()
    assert len(mine) != len(its) or mine.tobytes() != its.tobytes()
    arrivals = [[event for event in told(original, twin) if event[1] == EventKind.ARRIVAL] for twin in ("other", "t")]
    assert arrivals[0] == arrivals[1]
    assert len(arrivals[0]) > 1


@pytest.mark.slow
def test_it_goes_on_behind_kills_even_before_its_first_checkpoint(opened):
    twins = lived(opened())
    twins._checkpointer._save = lambda draft: None
    branch(twins, at_s=AT, controller="minlp1", speed=1, paused=True)
    kill(twins)
    twins = opened()
    twins.resume_all()
    assert twins.samples("w") == AT
    twins.change("w", TwinChange(paused=False, speed=1000))
    wait_until(lambda: twins._store.get("w").samples > AT + 50)
    kill(twins)
    twins = opened()
    twins.resume_all()
    twins.change("w", TwinChange(speed="max"))
    finished(twins, "w")
    assert rows(twins, "w").tobytes() == rows(twins, "t").tobytes()


@pytest.mark.slow
def test_a_live_twin_is_left_where_it_stands_and_a_replay_means_the_twin_it_plays(opened):
    twins = opened()
    twins.start(request(controller="minlp1", at_end="repeat", speed=1000))
    wait_until(lambda: twins.samples("t") > 300)
    twins.change("t", TwinChange(paused=True))
    now = twins.samples("t")
    assert branch(twins, speed=1, paused=True).at_s == now
    twins.start(replay_request(twins, TwinOrder.model_validate({"id": "r", "source": "replay", "of": "t"})))
    assert branch(twins, id="r2", of="r", at_s=200, speed=1, paused=True).of == "t"
    twins.change("t", TwinChange(paused=False))
    wait_until(lambda: twins.samples("t") > now + 2000)
    for name in ("w", "r2"):
        twins.change(name, TwinChange(paused=False, speed="max"))
        wait_until(lambda name=name: twins.samples(name) > now + 2000)
        twins.stop(name)
    own = rows(twins, "t", 200)
    for name, first in (("w", now), ("r2", 200)):
        count = now + 2000 - first
        assert rows(twins, name, first)[:count].tobytes() == own[first - 200 :][:count].tobytes()
    twins.stop("r")
    twins.stop("t")
    twins.remove("t")
    with pytest.raises(InputError, match="began as 't', which is gone"):
        branch(twins, id="x", of="w", at_s=now + 5)


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"of": "nobody"}, "no twin is called 'nobody'"),
        ({"at_s": 1_000_000}, "must be at most"),
        ({}, "must be given: twin 't' is finished"),
        ({"at_s": AT, "controller": "nobody"}, "nobody"),
    ],
)
def test_what_cannot_be_had_is_said(original, more, said):
    with pytest.raises(InputError, match=said):
        branch(original, **{"id": "x", **more})


def test_the_end_of_a_twin_is_no_beginning(original):
    with pytest.raises(InputError, match="had ended by then"):
        branch(original, id="x", at_s=original.samples("t"))


def test_a_state_that_is_not_known_exactly_is_refused(opened, monkeypatch):
    twins = opened()
    twins.start(measured())
    with pytest.raises(ProblemError, match="follows measurements: its state is estimated"):
        branch(twins, of="m")
    twins.start(request(controller="logic", at_end="stop"))
    finished(twins, "t")
    history = twins.history

    def other(twin_id, first, limit):
        found = history(twin_id, first, limit)
        return [sample for sample in found if sample.seq != 300]

    monkeypatch.setattr(twins, "history", other)
    with pytest.raises(InputError, match="second 300 of 't' is not kept whole"):
        branch(twins, at_s=301)

    def late(twin_id, first, limit):
        found = history(twin_id, first, limit)
        if not found or found[0].seq > 250:
            return found
        row = list(found[250 - found[0].seq].row)
        row[1] += 1e-9
        return [*found[: 250 - found[0].seq], type(found[0])("t", 1, 250, None, tuple(row)), *found[251:]]

    monkeypatch.setattr(twins, "history", late)
    with pytest.raises(InputError, match="second 250 of 't' cannot be had again"):
        branch(twins, at_s=400)


def test_what_takes_too_long_is_given_up(opened, monkeypatch):
    twins = opened()
    twins.start(request(controller="logic", at_end="stop"))
    finished(twins, "t")
    monkeypatch.setattr("api.twins.what_if.CHAIN_MAX", 1)
    for twin, of in (("a", "t"), ("b", "a")):
        branch(twins, id=twin, of=of, at_s=50, paused=True, speed=1)
    with pytest.raises(InputError, match="began as another, and so on more than 1 times"):
        branch(twins, id="c", of="b", at_s=50)
    monkeypatch.setattr("api.twins.what_if.PATIENCE_S", -1.0)
    with pytest.raises(InputError, match="logic decides too slowly"):
        branch(twins, id="c", at_s=60)


@pytest.mark.parametrize(
    ("order", "said"),
    [
        ({"of": "t", "scenario": "S1"}, "must be left out where of is given"),
        ({"of": "t", "seed": 3}, "seed must be left out where of is given"),
        ({"of": "t", "from_s": 3}, "from_s must be left out where source is simulated"),
        ({"scenario": "S1", "at_s": 3}, "at_s must be left out where of is left out"),
        ({"source": "replay", "of": "t", "at_s": 3}, "at_s must be left out where source is replay"),
    ],
)
def test_an_order_that_says_two_things_is_refused(order, said):
    with pytest.raises(ValidationError, match=said):
        TwinOrder.model_validate(order)
