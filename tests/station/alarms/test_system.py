"""The life of alarms: conditions against a plain reference, states, people, and going on from a snapshot."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from station import InputError, Station, load_station
from station.alarm_signals import INPUTS, WINDOW
from station.alarms.figures import DAY
from station.alarms.states import AlarmState
from station.alarms.system import SHELVE_MAX_S, AlarmSystem

STATION = load_station("thesis-fit")
TEXTS = {"title": "t", "consequence": "c", "action": "a"}


def rule(name, signal="wait", above=10.0, priority="low", **more):
    return {"name": name, "signal": signal, "above": above, "priority": priority, **TEXTS, **more}


def system(*rules):
    document = {**STATION.model_dump(mode="json"), "alarms": list(rules)}
    return AlarmSystem(Station.model_validate(document))


def seconds(first=0, **columns):
    """Times and inputs of seconds; a column's values are given one a second."""
    count = len(next(iter(columns.values())))
    inputs = np.full((count, len(INPUTS)), np.nan)
    for name, values in columns.items():
        inputs[:, INPUTS.index(name)] = values
    return np.arange(first, first + count, dtype=float), inputs


def told(transitions):
    return [(each.time, each.details["alarm"], each.details["state"]) for each in transitions]


def by_hand(values, above, deadband, on_delay, off_delay):
    """Seconds in which a condition begins or ends, worked out from the whole history each time."""
    changes, active, since = [], False, None
    for time, value in enumerate(values):
        if np.isnan(value):
            continue
        other = value <= above - deadband if active else value > above
        if not other:
            since = None
            continue
        since = time if since is None else since
        if time - since >= (off_delay if active else on_delay):
            active, since = not active, None
            changes.append((float(time), active))
    return changes


VALUE = st.one_of(st.floats(0, 20), st.just(float("nan")), st.sampled_from([10.0, 9.0, 11.0]))


@settings(max_examples=60, deadline=None)
@given(
    st.lists(VALUE, min_size=1, max_size=80), st.integers(0, 3), st.integers(0, 4), st.integers(0, 4),
    st.integers(1, 80),
)  # fmt: skip
def test_conditions_begin_and_end_as_by_hand_however_the_seconds_come(values, deadband, on_delay, off_delay, cut):
    given = rule("a", deadband=float(deadband), on_delay_s=float(on_delay), off_delay_s=float(off_delay))
    times, inputs = seconds(wait=values)
    whole = system(given).advance(times, inputs)
    parts, alarms = [], system(given)
    for begin in range(0, len(values), cut):
        parts += alarms.advance(times[begin : begin + cut], inputs[begin : begin + cut])
        again = system(given)
        again.resume(alarms.memories())
        alarms = again
    assert told(parts) == told(whole)
    found = [(each.time, each.details["state"] == "unacknowledged") for each in whole]
    assert found == by_hand(values, 10.0, float(deadband), on_delay, off_delay)


def test_an_alarm_lives_as_isa_18_2_says():
    alarms = system(rule("a"))
    alarm = alarms.alarms["a"]
    assert told(alarms.advance(*seconds(wait=[1.0, 11.0]))) == [(1.0, "a", "unacknowledged")]
    assert told(alarms.acknowledge("a", "ann")) == [(1.0, "a", "acknowledged")]
    assert alarms.acknowledge("a", "bob") == []
    assert alarm.by == "ann"
    assert told(alarms.advance(*seconds(2, wait=[1.0]))) == [(2.0, "a", "normal")]
    assert told(alarms.advance(*seconds(3, wait=[11.0, 1.0]))) == [
        (3.0, "a", "unacknowledged"), (4.0, "a", "returned_unacknowledged"),
    ]  # fmt: skip
    assert told(alarms.advance(*seconds(5, wait=[11.0]))) == [(5.0, "a", "unacknowledged")]
    with pytest.raises(InputError, match="began at 5 s; given 3"):
        alarms.acknowledge("a", "ann", raised=3.0)
    alarms.advance(*seconds(6, wait=[1.0]))
    assert told(alarms.acknowledge("a", "ann", raised=5.0)) == [(6.0, "a", "normal")]


def test_put_aside_it_is_told_to_nobody_until_its_end():
    alarms = system(rule("a"))
    alarms.advance(*seconds(wait=[11.0]))
    (shelved,) = alarms.shelve("a", 10.0, "ann", "being mended")
    assert (shelved.details["state"], shelved.details["by"], shelved.details["reason"]) == (
        "shelved", "ann", "being mended",
    )  # fmt: skip
    assert shelved.details["shelved_until_s"] == 10.0
    assert alarms.advance(*seconds(1, wait=[1.0, 11.0, 11.0])) == []
    assert told(alarms.advance(*seconds(4, wait=[11.0] * 8))) == [(10.0, "a", "unacknowledged")]
    alarms.shelve("a", 10.0, "ann", "again")
    assert told(alarms.unshelve("a", "bob")) == [(11.0, "a", "unacknowledged")]
    assert alarms.unshelve("a", "bob") == []
    assert told(alarms.take_out("a", "ann", "gone")) == [(11.0, "a", "out_of_service")]
    assert alarms.take_out("a", "ann", "gone") == []
    with pytest.raises(InputError, match="out of service"):
        alarms.shelve("a", 10.0, "ann", "no")
    assert alarms.advance(*seconds(12, wait=[1.0])) == []
    assert told(alarms.put_back("a", "bob")) == [(12.0, "a", "normal")]
    assert alarms.put_back("a", "bob") == []
    with pytest.raises(InputError, match=f"at most {SHELVE_MAX_S:g} s"):
        alarms.shelve("a", SHELVE_MAX_S + 1, "ann", "long")
    with pytest.raises(InputError, match="no alarm of this station is called 'b'"):
        alarms.acknowledge("b", "ann")


def test_consequences_are_silent_while_their_cause_lasts():
    alarms = system(rule("cause", "queue_length"), rule("effect", suppressed_by=["cause"]))
    assert told(alarms.advance(*seconds(wait=[11.0], queue_length=[11.0]))) == [
        (0.0, "cause", "unacknowledged"), (0.0, "effect", "suppressed_by_design"),
    ]  # fmt: skip
    assert told(alarms.advance(*seconds(1, wait=[11.0], queue_length=[1.0]))) == [
        (1.0, "cause", "returned_unacknowledged"), (1.0, "effect", "unacknowledged"),
    ]  # fmt: skip
    assert told(alarms.advance(*seconds(2, wait=[11.0], queue_length=[11.0]))) == [
        (2.0, "cause", "unacknowledged"), (2.0, "effect", "suppressed_by_design"),
    ]  # fmt: skip
    assert told(alarms.advance(*seconds(3, wait=[1.0], queue_length=[11.0]))) == [(3.0, "effect", "normal")]
    assert alarms.figures().begun == 3


def test_margins_and_the_time_to_reach_them():
    limit = STATION.thermal.buffer_temperature_max_c
    alarms = system(
        {**rule("close", "margin_temperature_low"), "above": None, "below": 1.0},
        {**rule("soon", "time_to_temperature_low"), "above": None, "below": 100.0},
    )
    heating = limit - 30.0 + 0.05 * np.arange(600)  # reaches its limit after 600 s
    found = told(alarms.advance(*seconds(temperature_low=heating, vehicle=np.full(600, -1.0))))
    assert found == [(501.0, "soon", "unacknowledged"), (581.0, "close", "unacknowledged")]
    assert WINDOW < 500


def test_a_vehicle_that_has_left_has_no_temperature_and_a_fill_is_watched():
    alarms = system(
        {**rule("hot", "margin_temperature_vehicle"), "above": None, "below": 0.0},
        rule("still", "given_nothing", 3.0),
        rule("long", "fill_duration", 5.0),
    )
    hot = STATION.vehicle.temperature_max_c + 1.0
    found = alarms.advance(
        *seconds(
            temperature_vehicle=[hot] * 4 + [np.nan] * 6, vehicle=[1.0] * 4 + [-1.0] + [2.0] * 5,
            flow_dispenser=[5.0] * 4 + [0.0] * 6,
        )
    )  # fmt: skip
    assert told(found) == [
        (0.0, "hot", "unacknowledged"), (4.0, "hot", "returned_unacknowledged"), (8.0, "still", "unacknowledged"),
    ]  # fmt: skip


def test_measurements_that_stay_away_are_told_by_the_wall_clock():
    alarms = system(rule("silent", "data_age", 60.0, on_delay_s=5.0))
    alarms.advance(*seconds(data_age=[0.0]))
    assert alarms.silence(60.0) == alarms.silence(64.0) == []
    assert told(alarms.silence(66.0)) == [(0.0, "silent", "unacknowledged")]
    assert alarms.silence(70.0) == []
    assert told(alarms.advance(*seconds(1, data_age=[0.0]))) == [(1.0, "silent", "returned_unacknowledged")]


def test_the_alarm_systems_own_figures():
    alarms = system(rule("a"), rule("b", "queue_length"))
    wait = np.zeros(600)
    wait[[100, 110, 120]] = 11.0
    queue = np.full(600, 11.0)
    alarms.advance(*seconds(wait=wait, queue_length=queue))
    alarms.acknowledge("b", "ann")
    figures = alarms.figures()
    assert (figures.begun, figures.most_in_ten_minutes, figures.flooded) == (4, 4, False)
    assert figures.chattering == ("a",)
    assert figures.frequent == (("a", 3), ("b", 1))
    assert (figures.announced, figures.unacknowledged, figures.standing) == (2, 1, ())
    assert figures.acknowledged_in == 599.0
    assert figures.per_hour == pytest.approx(4 * 3600 / 599)
    alarms.advance(np.array([DAY + 121.0]), seconds(queue_length=[11.0])[1])
    figures = alarms.figures()
    assert (figures.standing, figures.begun) == (("b",), 0)


def test_a_table_that_has_changed_keeps_what_people_did():
    alarms = system(rule("a"), rule("b", "queue_length"))
    alarms.advance(*seconds(wait=[11.0], queue_length=[11.0]))
    alarms.take_out("a", "ann", "mended")
    alarms.acknowledge("b", "ann")
    again = system(rule("c", "lateness"), rule("b", "queue_length"), rule("a", above=12.0))
    again.resume(alarms.memories())
    assert again.alarms["a"].state is AlarmState.OUT_OF_SERVICE
    assert again.alarms["b"].state is AlarmState.ACKNOWLEDGED
    assert told(again.advance(*seconds(1, wait=[13.0], queue_length=[1.0]))) == [(1.0, "b", "normal")]


def test_a_snapshot_that_is_none_is_refused():
    alarms = system(rule("a"))
    memories = alarms.memories()
    for wrong in (b"no", b"[]", json.dumps({"alarms": {"a": {}}}).encode()):
        with pytest.raises(InputError, match="alarms: cannot be read"):
            system(rule("a")).resume({**memories, "alarms": np.frombuffer(wrong, np.uint8)})
    with pytest.raises(InputError, match="active"):
        system(rule("a")).resume({**memories, "alarm_kernel_active": np.zeros(3)})
    system(rule("a")).resume({})
