"""Thermometers that follow a gas late, as those in wells do, are no wrong model and no fault."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from station.estimation.clock import skew_of
from station.estimation.slowness import CANDIDATES, frames_and_skew
from station.geometry import TANKS
from station.measurement import Tag, samples_of
from station.preset_files import load_station
from tests.station.estimation.hidden import day, measured, tags, truth
from tests.station.estimation.sensors import CARS, LEAKS, PARTS, SECONDS, STATIONS, told


def _slow(record, seconds, skew=0):
    """What is measured with thermometers of such a time constant; a vehicle's begins with its gas."""
    true = truth(record, SECONDS)
    left = np.exp(-1.0 / seconds) if seconds else 0.0
    for name in PARTS["thermometers"]:
        values = true[name].copy()
        for k in range(1, len(values)):
            if np.isfinite(values[k - 1]):
                values[k] = left * values[k - 1] + (1.0 - left) * true[name][k]
        true[name] = values
    return measured(true, 3, skew=skew)


def _known(seconds):
    """The usual map, whose thermometers are told to have it."""
    given = tags()
    late = {"time_constant_s": seconds}
    thermometers = PARTS["thermometers"]
    return given.model_copy(
        update={"tags": [each.model_copy(update=late) if each.sensor in thermometers else each for each in given.tags]}
    )


@pytest.mark.parametrize("name", STATIONS)
@pytest.mark.parametrize("seconds", [3.0, 10.0, 30.0])
@pytest.mark.parametrize("leaks", [False, True])
def test_their_time_constant_explains_them(name, seconds, leaks, records):
    """Of 30 s, taken for none, there were dozens of leaks and offsets a day, or the model was refused."""
    table, known = _slow(records[name, leaks], seconds), _known(seconds)
    events, why, followed = told(name, table, known)
    assert [event.name for event in events] == (["leak_medium"] if leaks else [])
    assert all(LEAKS <= event.found_s <= LEAKS + 150 for event in events)
    assert why == []
    true = records[name, leaks]["temperature_high"][: len(followed.states)]
    assert np.sqrt(np.mean((followed.states[600:, 3] - true[600:]) ** 2)) < 0.3


@pytest.mark.parametrize("name", ["thesis-fit", pytest.param("h70-light", marks=pytest.mark.slow)])
@pytest.mark.parametrize("spread", [pytest.param(0.005, marks=pytest.mark.slow), 0.15])
@pytest.mark.parametrize(
    ("seconds", "skew"), [(0.0, 0), pytest.param(0.0, -5, marks=pytest.mark.slow), (5.0, 3), (10.0, -2), (30.0, 6)]
)
def test_a_record_tells_time_constants_and_clocks(name, spread, seconds, skew):
    """With parameters 15 % off, too."""
    record = day(STATIONS[name](4, spread=spread), CARS, SECONDS)
    table = _slow(record, seconds, skew)
    frames, found = frames_and_skew(samples_of(table, tags()), tags(), load_station(name))
    assert found == {"plc": 0.0, "transmitters": float(skew)}
    used = [np.isfinite(frames[f"temperature_{tank}"]).any() and tank != "low" for tank in TANKS]
    places = [CANDIDATES.index(found) for found in frames.time_constants[used]]
    assert np.abs(np.array(places) - CANDIDATES.index(seconds)).max() <= (1 if seconds else 0)


def test_what_a_tag_tells_of_a_thermometer_is_believed(records):
    known = _known(7.0)
    frames, _ = frames_and_skew(
        samples_of(_slow(records["thesis-fit", False], 10.0), known), known, load_station("thesis-fit")
    )
    assert frames.time_constants.tolist() == [7.0] * 4


@pytest.mark.parametrize("name", ["thesis-fit", pytest.param("h70-light", marks=pytest.mark.slow)])
def test_they_make_no_clock_wrong(name, records):
    known = _known(10.0)
    found = skew_of(samples_of(_slow(records[name, False], 10.0), known), known, load_station(name))
    assert found == {"plc": 0.0, "transmitters": 0.0}


@pytest.mark.parametrize("given", [{"sensor": "pressure_high"}, {"time_constant_s": -1.0}, {"time_constant_s": 500.0}])
def test_other_ones_are_refused(given):
    with pytest.raises(ValidationError, match="time_constant_s"):
        Tag.model_validate({"tag": "T", "column": "T", "sensor": "temperature_high", "time_constant_s": 5.0, **given})
