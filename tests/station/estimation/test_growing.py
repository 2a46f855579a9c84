"""Faults that grow or shrink while they last are told again, with the size that they have then."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.ailing_forecasts import ailing_day
from station import load_station
from station.estimation.detection import Detector, detect, latest
from station.estimation.filter import follow
from station.estimation.verdict import judged
from station.frames import frames_of
from station.geometry import BUFFERS
from station.measured_day import measured_day
from station.measurement import samples_of
from station.sensor_names import DETECTABLE
from tests.station.estimation.hidden import day, tags
from tests.station.estimation.sensors import STATIONS


@pytest.mark.parametrize("name", ["thesis-fit", pytest.param("h70-light", marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("faults", "event", "sizes"),
    [
        (
            [{"kind": "leak", "buffer": "medium", "rate_g_per_s": 1.0, "begin_s": 4000.0},
             {"kind": "leak", "buffer": "medium", "rate_g_per_s": 1.0, "begin_s": 9000.0, "end_s": 14_000.0}],
            "leak_medium", (1.0, 2.0, 1.0),
        ),
        (
            [{"kind": "compressor_weak", "loss_percent": 20.0, "begin_s": 4000.0},
             {"kind": "compressor_weak", "loss_percent": 30.0, "begin_s": 9000.0, "end_s": 14_000.0}],
            "compressor_weak", (20.0, 44.0, 20.0),
        ),
    ],
)  # fmt: skip
def test_one_that_grows_or_shrinks_is_told_again(name, faults, event, sizes):
    """Each with its begin; the model is not refused."""
    station = STATIONS[name](41, spread=0.005, ambient=3.0)
    record = day(station, 10, 20_000, "switched", faults)
    frames, known = frames_of(samples_of(measured_day(record, seed=41), tags())), load_station(name)
    followed = follow(frames, known)
    events = detect(frames, followed, known)
    assert [each.name for each in events] == [event] * 3
    for each, size, begin in zip(events, sizes, (4000.0, 9000.0, 14_000.0), strict=True):
        assert each.size == pytest.approx(size, rel=0.08)
        assert each.begin_low_s <= begin <= each.found_s
        assert begin - 100 < each.begin_s < begin + 1300  # a compressor may rest
    assert judged(followed, frames.start, events)[1] == []


def _events(known, record, lost=()):
    """Events of the day, calibrated or not, of which nothing was told in some seconds."""
    frames = frames_of(samples_of(measured_day(record, 1), tags()))
    values = frames.values.copy()
    for begin, end in lost:
        values[begin:end] = np.nan
    frames = replace(frames, values=values)
    return detect(frames, follow(frames, known), known)


def test_one_that_is_found_by_pressures_is_told_once():
    """At a calibrated station, before the filter's leak is clear: that it goes on to rise is no growth."""
    known, record = ailing_day("thesis-fit", 6.0, 1, {"kind": "leak", "buffer": "high", "rate_g_per_s": 0.9})
    (told,) = _events(known.station.model_copy(update={"calibrated": True}), record)
    assert told.name == "leak_high"
    assert told.begin_low_s > 3500.0


def test_no_leak_is_found_while_nothing_is_told():
    """What a line lost is not laid to a buffer because the source is silent for two hours behind a fill."""
    known, record = ailing_day("thesis-fit", 6.0, 1, {"kind": "line_leak", "rate_g_per_s": 2.0})
    told = [each.name for each in _events(known.station, record, [(7000, 14_200)])]
    assert [name for name in told if name.startswith("leak")] == ["leak_medium", "leak_line"]


def test_a_line_that_goes_on_to_leak_lasts_with_the_size_that_it_had():
    """For longer than it lasts unseen, at vehicles that come so fast that the leak of a buffer is never gone."""
    known, record = ailing_day("thesis-fit", 6.0, 1, {"kind": "line_leak", "rate_g_per_s": 5.0})
    frames = frames_of(samples_of(measured_day(record, 1), tags()))
    detector = Detector(frames.measured, known.station)
    told = latest(detector.feed(frames, follow(frames, known.station)))
    lasts = detector.lasting[:, DETECTABLE.index("leak_line")]
    (line,) = [each for each in told if each.name == "leak_line"]
    assert line.size == pytest.approx(5.0, abs=2.0 * line.size_deviation)
    assert lasts[int(line.found_s) : 36_000].all()
    assert not detector.lasting[4000:36_000, : len(BUFFERS)].any(), "none of a buffer lasts that nobody was told of"
