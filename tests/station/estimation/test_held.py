"""Sources that tell a reading again until there is another one: nothing is told of it, and nothing is hidden."""

from __future__ import annotations

import pytest

from station import load_station
from station.estimation.clock import skew_of
from station.estimation.resting import held_for
from station.measurement import samples_of
from tests.station.estimation.hidden import measured, tags, truth
from tests.station.estimation.sensors import LEAKS, PARTS, SECONDS, STATIONS, held, replaced, told

STICKS = 9000


@pytest.mark.parametrize("name", STATIONS)
@pytest.mark.parametrize("every", [2, 5, 20])
@pytest.mark.parametrize("part", PARTS)
def test_readings_told_again_say_nothing(name, every, part, records):
    """Held for 5 s they refused every model, and a day had dozens of clogged dispensers, weak compressors and leaks."""
    healthy = measured(truth(records[name, False], SECONDS), 3)
    assert told(name, held(healthy, PARTS[part], every))[:2] == ([], [])


@pytest.mark.parametrize("name", STATIONS)
@pytest.mark.parametrize(("every", "within"), [(2, 200), (5, 200), (20, 900)])
def test_a_leak_is_found_by_them(name, every, within, records):
    events, why, _ = told(name, held(measured(truth(records[name, True], SECONDS), 3), PARTS["all"], every))
    assert {event.name for event in events} == {"leak_medium"}
    assert LEAKS <= events[0].found_s <= LEAKS + within
    assert why == []


@pytest.mark.parametrize("name", STATIONS)
@pytest.mark.parametrize("step", [0.1, 0.5, 1.0])
@pytest.mark.parametrize("every", [5, 20])
def test_held_readings_in_steps_come_as_far_apart_as_they_mostly_do(name, every, step, records):
    """Of two that follow each other many are equal."""
    healthy = measured(truth(records[name, False], SECONDS), 3)
    table = held(held(healthy, PARTS["pressures"], every, step), PARTS["thermometers"], every, step / 2)
    assert told(name, table)[:2] == ([], [])


@pytest.mark.parametrize("name", STATIONS)
@pytest.mark.parametrize("every", [5, 20])
def test_a_sensor_that_sticks_is_told_behind_them(name, every, records):
    table = held(measured(truth(records[name, False], SECONDS), 3), PARTS["all"], every)

    def stuck(values):
        values[STICKS:] = values[STICKS]
        return values

    events, why, _ = told(name, replaced(table, "pressure_medium", stuck))
    assert [event.name for event in events] == ["frozen_pressure_medium"]
    assert events[0].found_s <= STICKS + max(60, 11 * every)
    assert why == []


@pytest.mark.parametrize("name", STATIONS)
def test_they_tell_no_second_of_a_clock(name, records):
    table = measured(truth(records[name, False], SECONDS), 3)
    for every, seconds in ((1, 1.0), (2, 2.0), (5, 5.0)):
        samples = samples_of(held(table, PARTS["all"], every), tags())
        found = [held_for(each.value) for each in samples if each.tag.sensor == "pressure_high"]
        assert found == [seconds]
        if every > 1:
            assert skew_of(samples, tags(), load_station(name)) == {"plc": 0.0, "transmitters": 0.0}
