"""The filter over seconds as they come gives what one pass gives, byte for byte, and goes on from a snapshot."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from station import InputError, load_station
from station.estimation.filter import FIRST_SECONDS, ROBUST, STIFF, Followed, follow
from station.estimation.online import OnlineFilter
from station.frames import Frames
from station.sensor_names import ANALOG, SENSORS

SECONDS = 900


@pytest.fixture(scope="module", params=[False, True], ids=["as its file says", "calibrated"])
def station(request):
    return load_station("thesis-fit").model_copy(update={"calibrated": request.param})


@pytest.fixture(scope="module")
def frames():
    """Readings at random, many of them missing, and vehicles that come and go, some while nobody tells."""
    rng = np.random.default_rng(26)
    values = np.full((SECONDS, len(SENSORS)), np.nan)
    for column, sensor in enumerate(SENSORS):
        low, high = {"pressure": (200, 600), "temperature": (10, 40), "flow": (0, 20)}.get(
            sensor.partition("_")[0], (0, 1)
        )
        values[:, column] = rng.uniform(low, high, SECONDS)
    values[:, len(ANALOG) : len(ANALOG) + 6] = rng.random((SECONDS, 6)) < 0.2
    values[:, SENSORS.index("vehicle")] = np.repeat(rng.integers(-1, 9, SECONDS // 9), 9)
    values[:, SENSORS.index("vehicle_volume")] = 0.12
    values[rng.random(values.shape) < 0.2] = np.nan
    values[5:, 0] = np.nan
    noise = rng.uniform(0.5, 2.0, (SECONDS, len(ANALOG)))
    relative = np.array([0.02 if sensor.startswith("flow") else 0.0 for sensor in ANALOG])
    return Frames(1000.0, values, noise, relative, SENSORS, np.array([0.0, 10.0, 30.0, 5.0]))


def joined(parts: list[Followed]) -> list[bytes]:
    whole = Followed.joined(parts)
    drifts = () if whole.drifts is None else (whole.drifts.biases, whole.drifts.begins, whole.drifts.lasts)
    return [each.tobytes() for each in (whole.states, whole.deviations, whole.innovations, whole.errors, *drifts)]


def cuts(seed: int) -> list[int]:
    inner = np.random.default_rng(seed).choice(np.arange(1, SECONDS), 25, replace=False)
    return [0, *sorted(int(each) for each in inner), SECONDS]


@pytest.mark.parametrize("tuning", [ROBUST, STIFF], ids=["robust", "stiff"])
@pytest.mark.parametrize("split", [list(range(SECONDS + 1)), [0, SECONDS], cuts(1), cuts(2)])
def test_any_split_gives_the_bytes_of_one_pass(station, frames, tuning, split):
    online = OnlineFilter(station, tuning)
    parts = [online.push(frames.part(a, b)) for a, b in pairwise(split)]
    whole = follow(frames, station, tuning)
    assert np.isfinite(whole.innovations).any()
    assert joined([*parts, online.close()]) == joined([whole])


@pytest.mark.parametrize("seed", [3, 4])
def test_from_a_snapshot_anywhere_it_goes_on_byte_for_byte(station, frames, seed):
    online, parts, split = OnlineFilter(station), [], cuts(seed)
    for a, b in pairwise(split):
        parts.append(online.push(frames.part(a, b)))
        kept = online.snapshot()
        assert len(kept) < 150_000
        online = OnlineFilter(station)
        online.restore(kept)
    assert joined([*parts, online.close()]) == joined([follow(frames, station)])


def test_all_but_the_newest_second_is_told_once_the_first_minute_is_over(station, frames):
    online = OnlineFilter(station)
    told = [len(online.push(frames.part(second, second + 1)).states) for second in range(FIRST_SECONDS + 3)]
    assert told == [0] * (FIRST_SECONDS - 1) + [FIRST_SECONDS - 1, 1, 1, 1]


def test_a_record_shorter_than_a_minute_is_followed_when_it_closes(station, frames):
    online = OnlineFilter(station)
    online.push(frames.part(0, 20))
    assert joined([online.close()]) == joined([follow(frames.part(0, 20), station)])


def test_seconds_that_do_not_follow_are_refused_and_change_nothing(station, frames):
    online = OnlineFilter(station)
    online.push(frames.part(0, 100))
    before = online.snapshot()
    with pytest.raises(InputError, match=r"must be 1100\.0 s; given 1101\.0"):
        online.push(frames.part(101, 200))
    assert online.snapshot() == before
    assert online.next_second == 1100.0
