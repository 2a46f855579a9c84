"""Old history thinned to minutes: means, least and most, told apart from what is kept whole."""

from __future__ import annotations

import time

import numpy as np
import pytest

from api.http.pagination import FAR
from api.http.timeseries import Fold, Selection
from api.store.records import NotDurableYet, Superseded
from api.twins import journal
from api.twins import minutes as twin_minutes
from api.twins.minutes import FREQUENT, thin, thin_events
from tests.api.reopened import away, opening, request
from tests.waiting import wait_until

NAMES = ("pressure_high", "pressure_vehicle", "outlet_low", "queue_length")


@pytest.fixture
def opened(long_database, monkeypatch):
    """Opens the twins of a server again and again, on both databases; segments are short."""
    monkeypatch.setattr(journal, "SEGMENT_ROWS", 100)
    monkeypatch.setattr(journal, "SEGMENT_ROWS_MAX", 100)
    monkeypatch.setattr(twin_minutes, "SEGMENTS", 6)
    with opening(long_database, checkpoint_s=0.2) as make:
        yield make


@pytest.fixture
def twins(opened):
    """A server with a twin `t` that has ended, all of it stored."""
    first = opened()
    first.start(request(at_end="stop"))
    wait_until(lambda: first.state("t").state == "finished")
    wait_until(lambda: first._store.get("t").state == "finished")
    first.close()
    return opened()


def test_minutes_hold_mean_least_and_most(twins):
    whole = twins.columns("t", Selection())
    assert set(whole["resolution"]) == {1.0}
    assert thin(twins._store, 0.0) == 0
    count = thin(twins._store, time.time() + 60)
    rows = len(whole["time"])
    assert rows - 200 < count < rows  # the last segment may still grow
    assert thin(twins._store, time.time() + 60) == 0
    assert twins.thinned_to("t") == count
    found = twins.columns("t", Selection())
    assert list(found) == list(whole)
    thinned = found["resolution"] == 60.0
    assert thinned.sum() < count / 60 + 6
    assert (np.diff(found["time"]) > 0).all()
    for name in ("time", "sent", *NAMES):
        np.testing.assert_array_equal(found[name][~thinned], whole[name][count:])
    extremes = twins.columns("t", Selection(NAMES, end=count - 1, step=60, fold=Fold.MIN_MAX))
    expected = {name: whole[name][:count].astype(float) for name in NAMES}
    for name, figures in expected.items():
        for number, begin in enumerate(found["time"][thinned][:5]):
            part = figures[int(begin) : int(begin) + 60]
            some = part[~np.isnan(part)]
            mean = found[name][thinned][number]
            assert np.isnan(mean) if len(some) == 0 else mean == pytest.approx(some.mean(), rel=1e-12)
        assert np.nanmin(extremes[name]) == np.nanmin(figures)
        assert np.nanmax(extremes[name]) == np.nanmax(figures)


@pytest.mark.slow
def test_what_else_is_told_of_a_twin_stays(twins):
    state, epochs, events = twins.state("t"), twins.epochs("t"), twins.events("t", -1, 10_000)
    count = thin(twins._store, time.time() + 60)
    assert (twins.state("t"), twins.epochs("t"), twins.events("t", -1, 10_000)) == (state, epochs, events)
    assert twins.history("t", 0, 10)[0].seq == count
    assert twins._store.prune(time.time() + 60) > 0
    assert len(twins.columns("t", Selection())["time"]) == 0


@pytest.mark.slow
def test_frequent_events_go_and_reading_goes_on_behind_the_gap(twins, monkeypatch):
    monkeypatch.setattr(twin_minutes, "EVENTS", 7)
    store, whole = twins._store, twins.events("t", -1, 10_000)
    state, epochs, since = twins.state("t"), twins.epochs("t"), twins.told_since("t", 0)
    assert thin_events(store, 0.0) == 0
    assert twins.events("t", -1, 10_000) == whole
    rare = [event for event in whole if event["kind"] not in ("valve_change", "shield_refusal")]
    assert {"started", "arrival", "fill_start", "fill_end", "finished", "alarm"} == {event["kind"] for event in rare}
    assert len(rare) < len(whole) / 3
    assert thin_events(store, time.time() + 60) == len(whole) - len(rare)
    assert thin_events(store, time.time() + 60) == 0
    assert twins.events("t", -1, 10_000) == rare
    assert (twins.state("t"), twins.epochs("t"), twins.told_since("t", 0)) == (state, epochs, since)
    read, last = [], -1
    while page := twins.events("t", last, 4):
        read, last = [*read, *page], page[-1]["seq"]
    assert read == rare
    back, first = [], state.events
    while page := twins.last_events("t", first, 4):
        assert len(page) == min(4, len(rare) - len(back))
        back, first = [*page, *back], page[0]["seq"]
    assert back == rare


@pytest.mark.slow
def test_events_of_a_twin_that_lives_are_read_across_the_gap(opened):
    """From the store, thinned, and from memory, where the newest are not stored yet."""
    service = opened(checkpoint_s=60.0)
    ear = service.observers[-1]
    service.start(request(speed=100, at_end="repeat"))
    wait_until(lambda: len(ear.events) > 20)
    service.command("t", {"command": "pause"})  # stores what was told
    wait_until(lambda: service._store.last_events("t", FAR, 1)[0]["kind"] == "paused")
    forgotten = thin_events(service._store, time.time() + 60)
    assert forgotten > 5
    service._store.trouble = away
    with pytest.raises(NotDurableYet):
        service.command("t", {"command": "continue"})
    wait_until(lambda: len(ear.events) > 60)
    found = [event["seq"] for event in service.events("t", -1, 10_000)]
    kept = [event.seq for event in list(ear.events) if event.kind not in FREQUENT]
    assert found == sorted(set(found))
    assert set(kept[:5]) <= set(found)
    assert [event["seq"] for event in service.last_events("t", found[-1] + 1, 10_000)] == found
    assert [event["seq"] for event in service.last_events("t", found[-1] + 1, 3)] == found[-3:]


def test_segments_that_changed_meanwhile_are_left_alone(twins):
    twin, epoch, first, rows, stored, _ = twins._store.to_thin(time.time() + 60, 1)[0]
    with pytest.raises(Superseded):
        twins._store.thin(twin, epoch, first, rows + 1, stored, b"")
    with pytest.raises(Superseded):
        twins._store.thin(twin, epoch + 1, first, rows, stored, b"")
    assert twins.thinned_to("t") == 0
