"""A measured twin that is moved to another station while it runs: from the next second on, and across every restart."""

from __future__ import annotations

import numpy as np
import pytest

from api.http.problems import ProblemError
from api.store.records import NotDurableYet
from api.twins import durable
from api.twins.estimates import estimate_of
from station import InputError, load_scenario, load_station
from station.estimation.followed import FollowedRun
from tests.api.measured import TAG_MAP, batches, followed, measured
from tests.api.reopened import kill, opening, request
from tests.api.test_measured_twins import _rows, _send, _taken
from tests.waiting import wait_until

KNOWN = load_scenario("S1").station
SENT, MOVED = 260, 130
"""Seconds that are sent, and those of them before the move."""


def moved_station(factor=1.02):
    """The station of S1 with other volumes, as a calibration may find them."""
    given = KNOWN.model_dump()
    for tank in ("high", "medium", "low"):
        given["buffers"][tank]["volume_m3"] *= factor
    return KNOWN.model_validate({**given, "name": "thesis-fit-calibrated"})


def wanted(sent, at, station):
    """The rows of a run that is moved behind so many batches, and is never killed."""
    run = FollowedRun(KNOWN, TAG_MAP)
    parts = [run.push(batch) for batch in sent[:at]]
    run, _ = run.moved(station)
    parts += [*(run.push(batch) for batch in sent[at:]), run.finish()]
    return np.concatenate([np.column_stack((part.time, part.table())) for part in parts])


@pytest.fixture
def opened(long_database):
    with opening(long_database, checkpoint_s=0.2) as make:
        yield make


@pytest.mark.slow
def test_a_twin_follows_with_the_station_it_was_moved_to_whenever_it_is_killed(opened):
    twins, sent, station = opened(), batches(SENT), moved_station()
    twins.start(measured())
    _send(twins, sent[:MOVED])
    wait_until(lambda: _taken(twins) == MOVED)
    state = twins.move("m", station, "calibration-1")
    assert (state.station, state.calibration) == (station.name, "calibration-1")
    kill(twins)  # what was answered is stored
    twins = opened()
    twins.resume_all()
    assert twins.state("m").calibration == "calibration-1"
    _send(twins, sent[MOVED : MOVED + 80], MOVED)
    kill(twins)  # what was accepted behind the move is followed again with the same station
    twins = opened()
    twins.resume_all()
    _send(twins, sent[MOVED + 80 :], MOVED + 80)
    wait_until(lambda: _taken(twins) == SENT)
    assert twins.scenario("m").station == station
    (told,) = [event for event in twins.events("m", -1, 100) if event["kind"] == "station_changed"]
    first = told["details"].pop("from_seq")
    assert told["details"] == {"station": station.name, "calibration": "calibration-1"}
    assert estimate_of(twins, "m").health["leak_high"] == "unknown", "the filter learns anew"
    twins.stop("m")
    found = _rows(twins)
    assert found.tobytes() == wanted(sent, MOVED, station).tobytes()
    unmoved = FollowedRun(KNOWN, TAG_MAP)
    before = np.concatenate([unmoved.push(batch).table() for batch in sent])
    assert found[:first, 1:].tobytes() == before[:first].tobytes()
    assert not np.array_equal(found[first : len(before), 1:], before[first:], equal_nan=True)
    assert twins.scenario("m").station == station, "of a twin that has ended, too"


@pytest.mark.slow
def test_a_move_that_was_not_stored_has_not_been(opened, monkeypatch):
    twins, sent = opened(), batches(120)
    twins.start(measured())
    wait_until(lambda: twins._store.snapshot("m") is not None)
    twins._checkpointer._save = lambda draft: None
    _send(twins, sent[:70])
    with monkeypatch.context() as impatient:
        impatient.setattr(durable, "STORED_S", 0.2)
        with pytest.raises(NotDurableYet):
            twins.move("m", moved_station(), "calibration-1")
    _send(twins, sent[70:], 70)
    kill(twins)
    again = opened()
    again.resume_all()
    assert again.state("m").calibration is None
    wait_until(lambda: _taken(again) == 120)
    again.stop("m")
    assert _rows(again).tobytes() == followed(sent, finish=True).tobytes()


def test_a_twin_is_moved_once_and_back(opened):
    twins = opened()
    twins.start(measured())
    twins.move("m", moved_station(), "calibration-1")
    twins.move("m", moved_station(), "calibration-1")
    twins.move("m", moved_station(0.99), "calibration-2")
    events = [event for event in twins.events("m", -1, 100) if event["kind"] == "station_changed"]
    assert [event["details"]["calibration"] for event in events] == ["calibration-1", "calibration-2"]
    assert twins.station_seq("m") == 0


def test_what_cannot_be_moved_is_refused_and_stays(opened):
    twins = opened()
    twins.start(measured())
    twins.start(request(speed=1))
    with pytest.raises(ProblemError, match="is simulated"):
        twins.move("t", moved_station(), "calibration-1")
    with pytest.raises(InputError, match="plant"):
        twins.move("m", load_station("h70-light"), "calibration-1")

    def no(state):
        raise ProblemError(412, "changed", "Changed", state.id)

    with pytest.raises(ProblemError, match="m"):
        twins.move("m", moved_station(), "calibration-1", no)
    assert twins.state("m").calibration is None
    twins.stop("m")
    with pytest.raises(ProblemError, match="is stopped"):
        twins.move("m", moved_station(), "calibration-1")
