"""A fault is told, however large, at a station whose model fits; one whose model does not is refused all the same."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from controllers import create
from station import load_station, parse_scenario, simulate
from station.estimation.detection import detect
from station.estimation.filter import follow
from station.estimation.interface import Followed
from station.estimation.verdict import fits_of, judged, reasons, without_events, without_faint_flows
from station.frames import frames_of
from station.measured_day import measured_day, tags_of_day
from station.measurement import samples_of
from station.sensor_names import ANALOG
from tests.samples import first_quick

STATION = load_station("thesis-fit")
BEGIN = 3000.0

FAULTS = {
    "leak_high": {"kind": "leak", "buffer": "high", "rate_g_per_s": 2.0},
    "leak_low": {"kind": "leak", "buffer": "low", "rate_g_per_s": 0.8},
    "compressor_weak": {"kind": "compressor_weak", "loss_percent": 60.0},
    "dispenser_clogged": {"kind": "dispenser_clogged", "loss_percent": 15.0},
}


@cache
def _frames(fault=None, seed=3, skew=0):
    """Seconds of a day at the station, with a fault that begins at BEGIN."""
    faults = [{**FAULTS[fault], "begin_s": BEGIN}] if fault else []
    if skew:
        faults.append({"kind": "clock_skew", "skew_s": skew, "begin_s": 0.0})
    vehicles = [{"time_s": 300.0 * k, "start_pressure_bar": 120.0} for k in range(20)]
    arrivals = {"kind": "trace", "vehicles": vehicles}
    day = {"name": "x", "about": "x", "arrivals": arrivals, "time_limit_s": 9000.0, "faults": faults}
    record = simulate(parse_scenario(day), create("logic"))
    return frames_of(samples_of(measured_day(record, seed), tags_of_day()))


def _judged(frames, station):
    followed = follow(frames, station)
    found = detect(frames, followed)
    return found, judged(followed, frames.start, found)[1]


@pytest.mark.parametrize("name", first_quick(FAULTS))
def test_a_fault_is_told_and_no_reason_against_the_model(name):
    frames = _frames(name)
    found, why = _judged(frames, STATION)
    assert name in [event.name for event in found]
    assert why == []


@pytest.mark.parametrize("wrong", [0.9, 0.95, 1.05, 1.1])
def test_volumes_that_are_wrong_are_refused(wrong):
    tanks = {
        name: tank.model_copy(update={"volume_m3": wrong * tank.volume_m3})
        for name, tank in STATION.buffers
        if hasattr(tank, "volume_m3")
    }
    assert len(tanks) == 3
    other = STATION.model_copy(update={"buffers": STATION.buffers.model_copy(update=tanks)})
    assert _judged(_frames(), other)[1]


def test_a_model_that_needs_an_event_at_every_turn_is_judged_by_all_seconds():
    frames = _frames("leak_high")
    followed = follow(frames, STATION)
    event, *_ = detect(frames, followed)
    often = [replace(event, begin_s=900.0 * k, found_s=900.0 * k + 60) for k in range(9)]
    assert without_events(followed, frames.start, often) is followed
    assert without_events(followed, frames.start, often[:3]) is not followed


@pytest.mark.parametrize("skew", [-1, 1, 4])
@pytest.mark.parametrize("fault", [None, "leak_high"])
def test_a_clock_that_nobody_put_right_is_no_noise_and_no_leak(skew, fault):
    """Valves and readings that are a second apart spoil most of the readings: the model is refused."""
    frames = _frames(fault, skew=skew)
    assert _judged(frames, STATION)[1]


def _innovations(values):
    """Seconds with these innovations (seconds, channels), and no states."""
    return Followed(np.zeros((len(values), 0)), np.zeros((len(values), 0)), values, values, 6.0)


@pytest.mark.parametrize("seconds", [1300, 2500, 20_000])
def test_white_innovations_are_hardly_ever_refused_by_chance(seconds):
    """With the limit of many readings one in ten models that fit would be refused for ten fills that are held out."""
    random = np.random.default_rng(seconds)
    fits = [
        fit for _ in range(100) for fit in fits_of(_innovations(random.normal(size=(seconds, len(ANALOG))))).values()
    ]
    assert len(fits) == 100 * len(ANALOG)
    assert sum(fit.block_rms > fit.block_limit for fit in fits) <= 5
    assert np.sqrt(np.mean([fit.block_rms**2 for fit in fits])) == pytest.approx(1.0, abs=0.05)
    assert {fit.block_limit for fit in fits} == {max(1.3, 1 + 3.1 * np.sqrt(120 / (3 * seconds)))}


@pytest.mark.parametrize("seconds", [1300, 20_000])
def test_an_error_that_is_hidden_in_each_second_shows_in_blocks(seconds):
    """Off by a quarter of the noise, one way for an hour and the other way for the next."""
    random = np.random.default_rng(seconds)
    hours = np.where(np.arange(seconds) // 3600 % 2, -0.25, 0.25)[:, None]
    fits = fits_of(_innovations(random.normal(size=(seconds, len(ANALOG))) + hours))
    assert len(reasons(fits)) == len(ANALOG)
    assert all(fit.innovation_rms < 1.1 for fit in fits.values())


def test_flows_that_are_nearly_nothing_say_nothing_of_a_meters_noise():
    frames = _frames()
    followed = follow(frames, STATION)
    kept = without_faint_flows(followed, frames)
    meters = [ANALOG.index(name) for name in ("flow_compressor", "flow_dispenser")]
    others = [k for k in range(len(ANALOG)) if k not in meters]
    assert np.array_equal(kept.innovations[:, others], followed.innovations[:, others], equal_nan=True)
    for k in meters:
        faint = 0.02 * frames.values[:, k] < frames.noise[:, k]
        assert np.isnan(kept.innovations[faint, k]).all()
        assert np.array_equal(kept.innovations[~faint, k], followed.innovations[~faint, k], equal_nan=True)
        assert 100 < np.isfinite(kept.innovations[:, k]).sum() <= np.isfinite(followed.innovations[:, k]).sum()


def test_a_flow_that_power_tells_is_judged_though_no_meter_read_it():
    frames = _frames()
    values = frames.values.copy()
    values[:, ANALOG.index("flow_compressor")] = np.nan
    followed = _innovations(np.ones((len(values), len(ANALOG))))
    kept = without_faint_flows(followed, replace(frames, values=values)).innovations
    assert (kept[:, ANALOG.index("flow_compressor")] == 1.0).all()
    assert np.isnan(kept[:, ANALOG.index("flow_dispenser")]).any()


def test_a_sensor_that_was_put_right_is_no_reason_against_the_model():
    """Where it was found to be off before the seconds that are judged, and is right within them."""
    frames = _frames()
    values = frames.values.copy()
    values[3000:6500, ANALOG.index("pressure_high")] += 10.0
    frames = replace(frames, values=values)
    followed = follow(frames, STATION)
    (event,) = detect(frames, followed)
    assert event.name == "offset_pressure_high"
    last = followed.part(5400, len(values))
    assert judged(last, frames.start + 5400, [], (), [event])[1] == []
    (why,) = judged(last, frames.start + 5400, [])[1]
    assert why.startswith("pressure_high")
