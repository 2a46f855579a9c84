"""How large a leak of the line is: what buffers gave less what the dispenser's meter counted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.measured_forecasts import drawn_station
from station.estimation.detection import Detector, detect
from station.estimation.filter import follow
from station.estimation.line_balance import FOUND, balance_line, line_of_nothing
from station.frames import frames_of
from station.measured_day import measured_day, tags_of_day
from station.measurement import samples_of
from station.sensor_names import SENSORS
from tests.station.estimation.hidden import day
from tests.station.estimation.test_outlet_leaks import BEGIN, followed_day

FLOWS = [SENSORS.index(name) for name in ("flow_compressor", "flow_dispenser")]


def _leak(rate, begin=BEGIN):
    return tuple({"kind": "line_leak", "rate_g_per_s": rate, "begin_s": begin}.items())


def _sizes(name, controller, seed, rate, begin=BEGIN):
    frames, followed, known = followed_day(name, controller, seed, _leak(rate, begin))
    return [event for event in detect(frames, followed, known) if event.name == "leak_line"]


@pytest.mark.parametrize("begin", [BEGIN, 0.0])
@pytest.mark.parametrize(("name", "controller"), [("thesis-fit", "logic"), ("thesis-fit", "switched"),
                                                  ("h70-light", "logic"), ("h70-light", "switched")])  # fmt: skip
def test_a_leak_is_told_with_its_size(name, controller, begin):
    (told,) = _sizes(name, controller, 41, 2.0, begin)
    assert told.size_deviation < 0.6
    assert begin <= told.begin_high_s
    assert told.begin_low_s is None if begin == 0.0 else begin - 5000.0 < told.begin_low_s <= begin
    assert told.size == pytest.approx(2.0, abs=max(0.3, 2.0 * told.size_deviation))


@pytest.mark.parametrize(
    ("seed", "controller"),
    [
        (5, "logic"),
        pytest.param(1, "switched", marks=pytest.mark.slow),
        pytest.param(1, "minlp1", marks=pytest.mark.slow),
    ],
)
def test_at_a_calibrated_station_the_first_buffer_alone_is_told_beside_it(seed, controller):
    """What lags behind in the smoothed estimates was told of each buffer that gave, again and again."""
    station = drawn_station("thesis-fit", seed).model_copy(update={"calibrated": True})
    leak = {"kind": "line_leak", "rate_g_per_s": 2.0, "begin_s": 14_000.0}
    record = day(station, vehicles=20, seconds=43_200, controller=controller, faults=[leak])
    frames = frames_of(samples_of(measured_day(record, seed), tags_of_day()))
    names = [event.name for event in detect(frames, follow(frames, station), station)]
    assert names.count("leak_line") == 1
    assert len(names) == 2


def test_it_is_told_of_two_buffers_where_nobody_knows_the_third():
    frames, followed, known = followed_day("thesis-fit", "logic", 41, _leak(2.0))
    for unknown in ([], ["low"]):
        events = detect(frames, followed, known.model_copy(update={"unknown_buffers": unknown}))
        assert [event.name for event in events] == ["leak_high", "leak_line"]
    assert events[1].size == pytest.approx(2.0, abs=0.3)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["thesis-fit", "h70-light"])
def test_sizes_lie_within_their_deviations(name):
    """Of stations half a percent off, with leaks that begin at any time."""
    off = []
    for seed in range(51, 57):
        for controller in ("logic", "switched"):
            begin = float(np.random.default_rng(seed).integers(6000, 12_000))
            found = _sizes(name, controller, seed, 1.5, begin)
            assert all((told.begin_low_s or 0.0) <= begin <= told.begin_high_s for told in found)
            off.extend((told.size - 1.5) / told.size_deviation for told in found)
    assert len(off) >= 8
    assert np.max(np.abs(off)) < 3.0
    assert np.sqrt(np.mean(np.square(off))) < 1.5


@pytest.mark.parametrize(
    ("name", "rate"), [("thesis-fit", 1.0), pytest.param("h70-light", 2.0, marks=pytest.mark.slow)]
)
def test_one_that_grows_or_shrinks_is_told_again(name, rate):
    """Behind two fills that show it, with its size and between which times it changed."""
    more = {"kind": "line_leak", "rate_g_per_s": rate, "begin_s": 14_000.0, "end_s": 23_000.0}
    frames, followed, known = followed_day(name, "logic", 41, _leak(rate, 5000.0), tuple(more.items()), seconds=34_000)
    told = [event for event in detect(frames, followed, known) if event.name == "leak_line"]
    assert len(told) == 3
    for event, size, begin in zip(told, (rate, 2.0 * rate, rate), (5000.0, 14_000.0, 23_000.0), strict=True):
        assert event.size == pytest.approx(size, abs=max(0.15 * rate, 2.0 * event.size_deviation))
        assert event.begin_low_s <= begin <= event.begin_high_s
        assert event.found_s < begin + 4500.0


def test_without_a_meter_no_size_is_measured():
    frames, followed, known = followed_day("thesis-fit", "switched", 41, _leak(2.0))
    events = Detector([name for name in frames.measured if name != "flow_dispenser"], known).feed(frames, followed)
    told = [event for event in events if event.name == "leak_line"]
    assert told
    assert all(event.size_deviation is None for event in told)


def _stretch(lost, given, seconds=200, *, told=False, ago=np.nan):
    """A fill of which `lost` [g] of the buffers' gas is missed, and a minute behind it."""
    rows = seconds + 60
    values, states, deviations = np.zeros((rows, len(SENSORS))), np.zeros((rows, 14)), np.zeros((rows, 14))
    values[1 : seconds + 1, SENSORS.index("outlet_high")] = 1.0
    values[1 : seconds + 1, FLOWS[1]] = given / seconds
    states[:, 0] = 20_000.0 - np.clip(np.arange(rows) / seconds, 0, 1) * (given + lost)
    since = np.full(rows, np.nan)
    since[seconds // 2] = ago
    return values, states, deviations, np.full(rows, told), since, np.zeros(rows, np.bool_)


def _play(memory, *stretch):
    found = np.full((len(stretch[0]), FOUND), np.nan)
    balance_line(*stretch, memory, found, 0.15)
    return found[-1, :2]


def test_what_meters_always_seem_to_lose_is_taken_off():
    memory = line_of_nothing()
    for _ in range(30):
        assert np.isnan(_play(memory, *_stretch(40.0, 4000.0))).all()
    rate, deviation = _play(memory, *_stretch(440.0, 4000.0, told=True))
    assert rate == pytest.approx(2.0, abs=0.02)
    assert deviation < 0.1
    fresh = _play(line_of_nothing(), *_stretch(440.0, 4000.0, told=True))
    assert fresh[0] == pytest.approx(2.2, abs=0.02)
    assert fresh[1] == pytest.approx(0.2, abs=0.01)


def test_one_that_begins_within_a_fill_counts_from_there():
    rate, deviation = _play(line_of_nothing(), *_stretch(200.0, 4000.0, told=True, ago=0.0))
    assert rate == pytest.approx(2.0, abs=0.05)
    assert deviation > 0.5, "since when is not known well"


def test_one_that_has_ended_is_forgotten():
    memory = line_of_nothing()
    assert _play(memory, *_stretch(400.0, 4000.0, told=True))[0] == pytest.approx(2.0, abs=0.02)
    assert np.isnan(_play(memory, *_stretch(0.0, 4000.0))).all()
    assert _play(memory, *_stretch(200.0, 4000.0, told=True))[0] == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("told", [False, True])
def test_a_stretch_in_which_a_meter_was_silent_tells_nothing(side, told):
    """Neither what the line loses, nor what is usual where it is tight."""
    memory, silent = line_of_nothing(), _stretch(40.0, 4000.0, told=told)
    if side == 0:
        silent[0][:, SENSORS.index("inlet_low")] = 1.0
    silent[0][80:120, FLOWS[side]] = np.nan
    assert np.isnan(_play(memory, *silent)).all()
    assert _play(memory, *_stretch(400.0, 4000.0, told=True))[0] == pytest.approx(2.0, abs=0.02)


def test_single_readings_that_are_lost_and_a_meter_that_rests_are_none():
    memory, stretch = line_of_nothing(), _stretch(400.0, 4000.0, told=True)
    stretch[0][10:200:10, FLOWS[1]] = np.nan
    stretch[0][:, FLOWS[0]] = np.nan
    assert _play(memory, *stretch)[0] == pytest.approx(2.0, abs=0.02)


def test_a_meter_that_was_silent_for_an_hour_spoils_no_size():
    """Before the leak, and what fills seem to lose meanwhile was taken for what they always do."""
    frames, followed, known = followed_day("thesis-fit", "logic", 41, _leak(2.0))
    values = frames.values.copy()
    first = int(BEGIN) - 3600
    values[first : first + 3400, FLOWS[1]] = np.nan
    (told,) = [each for each in detect(replace(frames, values=values), followed, known) if each.name == "leak_line"]
    assert told.size == pytest.approx(2.0, abs=max(0.3, 2.0 * told.size_deviation))
    assert told.size_deviation < 1.5
