"""Calibration finds a hidden station, says what it cannot know, and refuses a model of another form."""

from __future__ import annotations

from time import process_time

import numpy as np
import pytest

from benchmarks.following import DAY, day_of, played
from benchmarks.measured_forecasts import calibrated, drawn_station
from station import InputError, load_station, presets
from station.estimation.calibration import calibrate
from station.estimation.detection import detect
from station.estimation.filter import STIFF, follow
from station.estimation.followed import deviations_of
from station.frames import frames_of
from station.geometry import BUFFERS
from station.measured_day import measured_day, tags_of_day
from station.measurement import samples_of
from station.parameters import Station
from tests.pace import slowness
from tests.station.estimation.hidden import day, hidden_real_station, measured, tags, truth


def _true(station, name):
    value = station
    for part in name.split("."):
        value = getattr(value, part)
    return value


@pytest.fixture(scope="module")
def frames(hidden):
    return frames_of(samples_of(measured(hidden.true, 1), tags()))


@pytest.fixture(scope="module")
def found(frames):
    return calibrate(frames, load_station("thesis-fit"))


@pytest.mark.slow
def test_what_is_excited_is_found_and_the_rest_is_left(hidden, found):
    assert found.refused == []
    known = {name for name, each in found.parameters.items() if each.known}
    assert {"buffers.high.volume_m3", "compressor.pressure_bar", "thermal.ambient_temperature_c"} <= known
    for name in known:
        each, true = found.parameters[name], _true(hidden.station, name)
        if "cooling" not in name:  # their intervals are wide: outlets cool little
            assert abs(each.value / true - 1) < 0.005, name
    covered = [each.low <= _true(hidden.station, name) <= each.high for name, each in found.parameters.items()]
    assert np.mean(covered) >= 0.8
    for name in ("buffers.high.volume_m3", "dispenser.outlet_coefficient_g_per_s_bar"):  # as the meters scale them
        each = found.parameters[name]
        assert (each.high - each.low) / 2 / each.value == pytest.approx(0.005, rel=0.1), name
    top = found.parameters["compressor.pressure_bar"]
    assert (top.high - top.low) / 2 / top.value < 1e-4
    left = found.parameters["buffers.low.volume_m3"]  # logic never draws from it on this day
    assert not left.known
    assert left.value == load_station("thesis-fit").buffers.low.volume_m3
    deviations = found.station.volume_deviations_percent
    assert all(0.005 < deviations[name] < 0.15 for name in ("high", "medium"))


@pytest.mark.slow
def test_no_leak_is_told_of_a_buffer_whose_volume_the_day_did_not_tell(hidden, found):
    """`logic` never draws from low on that day; by `switched`, which does, leaks of it were told by the dozen."""
    known = Station.model_validate(found.station.model_copy(update={"calibrated": True}).model_dump(mode="json"))
    assert known.unknown_buffers == ["low"]
    record = day(hidden.station, vehicles=20, seconds=43_200, controller="switched")
    frames = frames_of(samples_of(measured_day(record, 5), tags_of_day()))
    assert record["outlet_low"].any()
    assert detect(frames, follow(frames, known), known) == []
    unsaid = known.model_copy(update={"unknown_buffers": []})
    assert "leak_low" in {event.name for event in detect(frames, follow(frames, unsaid), unsaid)}
    again = calibrate(frames, known)  # a day that tells low, and nothing is forgotten of the others
    assert again.station.unknown_buffers == []


@pytest.mark.slow
def test_masses_after_calibration(hidden, found, frames):
    followed = follow(frames, found.station, STIFF)
    for place, name in enumerate(BUFFERS):
        if found.parameters[f"buffers.{name}.volume_m3"].known:
            true = hidden.record[f"mass_{name}"][600 : len(frames)]
            error = followed.states[600:, place] - true
            assert np.sqrt(np.mean(error**2)) < 0.001 * true.mean() + 2.0
            within = np.abs(error) <= 1.96 * deviations_of(followed, found.station)[600:, place]
            assert within.mean() >= 0.95  # a filter that takes the volumes for true says so of a third of the seconds


@pytest.mark.slow
def test_a_gas_of_another_form_is_refused(hidden):
    """Pressures of a gas whose molecules have a volume (Abel-Noble), with everything else the same."""
    true = {name: values.copy() for name, values in hidden.true.items()}
    for name in ("high", "medium", "low", "vehicle"):
        true[f"pressure_{name}"] = true[f"pressure_{name}"] / (1 - 1.9e-4 * true[f"pressure_{name}"])
    frames = frames_of(samples_of(measured(true, 2), tags()))
    refused = calibrate(frames, load_station("thesis-fit")).refused
    assert any(reason.startswith("pressure_") for reason in refused)


@pytest.mark.slow
def test_air_that_waves_over_the_day_is_the_airs():
    """By 5 K, as no station's file can say: before the air was a state such a day was refused."""
    hidden = drawn_station("thesis-fit", 2)
    record = played(day_of(hidden, DAY), "logic", 2)
    calibration = calibrate(frames_of(samples_of(measured_day(record, 2), tags_of_day())), load_station("thesis-fit"))
    assert calibration.refused == []
    sharp = [name for name in calibration.parameters if "volume" in name or "coefficient" in name]
    known = [name for name in sharp if calibration.parameters[name].known]
    assert {"buffers.high.volume_m3", "dispenser.outlet_coefficient_g_per_s_bar"} <= set(known)
    for name in known:
        assert abs(calibration.parameters[name].value / _true(hidden, name) - 1) < 0.005, name
    air = "thermal.ambient_temperature_c"  # a whole wave but for the quarter that is held out
    assert calibration.parameters[air].value == pytest.approx(_true(hidden, air), abs=2.0)
    assert calibration.station.thermal.ambient_temperature_c == calibration.parameters[air].value


def test_a_short_record_is_refused(frames):
    with pytest.raises(InputError, match="must span at least 21600 s; given 3600"):
        calibrate(frames.part(0, 3600), load_station("thesis-fit"))


@pytest.mark.slow
def test_an_ideal_gas_that_follows_real_gas_is_refused():
    real = next(each for each in map(load_station, presets()) if each.plant == "real-gas")
    given = real.model_dump()
    given.pop("real_gas")
    ideal = Station.model_validate({**given, "plant": "thesis", "control_model": None})
    record = day(real)
    frames = frames_of(samples_of(measured(truth(record, 86_400), 1), tags()))
    refused = calibrate(frames, ideal).refused
    assert any(reason.startswith("pressure_") for reason in refused)


def _calibrated_real(valve: float, seed: int):
    """A station of real gas whose outlets have a part of the preset's area, and what is found of it."""
    given, known = hidden_real_station(seed).model_dump(), load_station("h70-light").model_dump()
    for file in (given, known):
        file["real_gas"]["dispensing"]["valve_mm2"] *= valve
    station = Station.model_validate(given)
    frames = frames_of(samples_of(measured(truth(day(station), 86_400), seed), tags()))
    return station, calibrate(frames, Station.model_validate(known))


@pytest.mark.parametrize(
    ("valve", "seed", "excited"),
    [pytest.param(0.5, 2, True, marks=pytest.mark.slow), pytest.param(1.0, 1, False, marks=pytest.mark.full)],
)
def test_a_station_of_real_gas_is_found(valve, seed, excited):
    """At the preset's own area nothing limits the flow but ramps: `logic` changes banks long before."""
    began = process_time()
    station, found = _calibrated_real(valve, seed)
    assert process_time() - began < 120 * slowness()
    assert found.refused == []
    area = "real_gas.dispensing.valve_mm2"
    assert found.parameters[area].known == excited
    sharp = [name for name in found.parameters if "volume" in name or "displacement" in name]
    for name in [*sharp, *([area] if excited else [])]:
        each = found.parameters[name]
        assert each.known
        assert abs(each.value / _true(station, name) - 1) < 0.0025, name
    covered = [each.low <= _true(station, name) <= each.high for name, each in found.parameters.items()]
    assert np.mean(covered) >= 0.8
    assert found.station is not None
    assert found.station.real_gas is not None


@pytest.mark.slow
@pytest.mark.parametrize("seed", [3, pytest.param(5, marks=pytest.mark.full)])
def test_a_station_whose_vehicles_wait_for_one_another_is_found(seed):
    """Outlets then open for single seconds, and vehicles come behind one another: readings of some are missing."""
    began = process_time()
    station = drawn_station("h70-light", seed)
    found = calibrated("h70-light", 4.0, seed)
    assert process_time() - began < 120 * slowness()
    assert found.refused == []
    for name in found.parameters:
        each = found.parameters[name]
        assert each.known
        if "volume" in name or "displacement" in name:
            assert abs(each.value / _true(station, name) - 1) < 0.0025, name
    covered = [each.low <= _true(station, name) <= each.high for name, each in found.parameters.items()]
    assert np.mean(covered) >= 0.8
    assert found.station is not None
