"""A station followed by batches: live in whatever batches, and from a snapshot anywhere, the bytes of one pass."""

from __future__ import annotations

import numpy as np
import pytest

from station import InputError, load_station
from station.archives import pack, unpack
from station.batches import Batch
from station.estimation.detection import detect
from station.estimation.detection import latest as last_words
from station.estimation.filter import FIRST_SECONDS, STATES, follow
from station.estimation.followed import FollowedRun, FollowedSeconds, followed_columns
from station.frames import frames_of
from station.geometry import VALVES
from station.measurement import Tag, TagMap
from station.sensor_names import ANALOG, SENSORS

SECONDS = 300
TAGS = TagMap(
    tags=[Tag(tag=name, column=name, sensor=name) for name in (*ANALOG, *VALVES, "vehicle")]
)  # fmt: skip
FIELDS = ("time", "states", "deviations", "innovations", "errors", "measured")


@pytest.fixture(scope="module")
def station():
    return load_station("thesis-fit")


@pytest.fixture(scope="module")
def record() -> Batch:
    """Five minutes of readings at random, some missing, none later than 4 s; the flow meter of outlets is silent."""
    rng = np.random.default_rng(26)
    tag, time = (each.ravel() for each in np.meshgrid(np.arange(len(TAGS.tags)), np.arange(float(SECONDS))))
    low, high = np.zeros(len(TAGS.tags)), np.ones(len(TAGS.tags))
    for place, each in enumerate(TAGS.tags):
        kind = each.sensor.partition("_")[0]
        low[place], high[place] = {"pressure": (300, 303), "temperature": (20, 21), "flow": (0, 20)}.get(kind, (0, 0.7))
    value = rng.uniform(low[tag], high[tag])
    vehicle = tag == len(TAGS.tags) - 1
    value[vehicle] = time[vehicle] // 90 - 1
    value[rng.random(len(value)) < 0.1] = np.nan
    kept = tag != ANALOG.index("flow_dispenser")
    order = np.argsort((time + rng.uniform(0, 4, len(time)) * (time > 0))[kept], kind="stable")
    quality = rng.integers(1, 3, len(value))
    return Batch(*(each[kept][order] for each in (tag, 1.7e9 + time + 0.1, value, quality)))


def parts_of(record: Batch, cuts: list[int]) -> list[Batch]:
    return [record.part(slice(a, b)) for a, b in zip([0, *cuts], [*cuts, len(record)], strict=True)]


def joined(parts) -> list[object]:
    events = last_words(event for part in parts for event in part.events)
    return [*(np.concatenate([getattr(part, name) for part in parts]).tobytes() for name in FIELDS), events]


@pytest.fixture(scope="module")
def whole(station, record):
    """What one pass over the whole record gives."""
    frames = frames_of(record.samples(TAGS))
    followed = follow(frames, station)
    assert np.isfinite(followed.innovations).any()
    time = frames.start + np.arange(len(frames), dtype=float)
    arrays = (time, followed.states, followed.deviations, followed.innovations, followed.errors, frames.values)
    events = detect(frames, followed)
    assert "absent_flow_dispenser" in {event.name for event in events}
    return [*(each.tobytes() for each in arrays), events]


@pytest.mark.slow
@pytest.mark.parametrize("size", [1, 16, 997, 20_000])
def test_any_batches_give_the_seconds_of_one_pass(station, record, whole, size):
    run = FollowedRun(station, TAGS)
    parts = [run.push(each) for each in parts_of(record, list(range(size, len(record), size)))]
    assert joined([*parts, run.finish()]) == whole
    assert run.counts.late == run.counts.ahead == 0


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_from_a_snapshot_anywhere_it_goes_on_byte_for_byte(station, record, whole, seed):
    cuts = sorted(np.random.default_rng(seed).choice(np.arange(1, len(record)), 40, replace=False).tolist())
    run, parts = FollowedRun(station, TAGS), []
    for each in parts_of(record, cuts):
        parts.append(run.push(each))
        kept = run.snapshot()
        run = FollowedRun.restore(station, TAGS, kept)
        assert run.snapshot() == kept
    assert joined([*parts, run.finish()]) == whole


def test_the_first_minute_is_held_back_and_then_the_newest_second(station, record):
    run, told = FollowedRun(station, TAGS, lateness=4.0), {}
    for each in parts_of(record, list(range(16, 16 * 100, 16))):
        told[run.newest] = len(run.push(each))
    counts = [each for each in told.values() if each]
    assert counts[0] >= FIRST_SECONDS - 1
    assert run.next_second <= run.newest - 4


def test_masses_are_as_unsure_as_the_volumes(station, record, whole):
    unsure = station.model_copy(update={"volume_deviations_percent": {"high": 3.0}})
    run = FollowedRun(unsure, TAGS)
    found = FollowedSeconds.joined([run.push(record), run.finish()])
    assert found.states.tobytes() == whole[1]
    filtered = np.frombuffer(whole[2]).reshape(found.deviations.shape)
    assert found.deviations[:, 1:].tobytes() == filtered[:, 1:].tobytes()
    assert found.deviations[:, 0] == pytest.approx(np.hypot(filtered[:, 0], 0.03 * found.states[:, 0]))


def test_a_run_that_has_ended_takes_nothing(station, record):
    run = FollowedRun(station, TAGS)
    assert len(run.finish()) == 0
    with pytest.raises(InputError, match="must not have ended"):
        run.push(record.part(slice(0, 1)))
    assert len(run.finish()) == 0
    assert FollowedRun.restore(station, TAGS, run.snapshot()).over


def test_a_snapshot_of_other_tags_or_none_at_all_is_refused(station, record):
    kept = FollowedRun(station, TAGS).snapshot()
    for other, why in ((TAGS, "lateness"), (TagMap(tags=TAGS.tags[1:]), "tags")):
        with pytest.raises(InputError, match=why):
            FollowedRun.restore(station, other, kept, lateness=9.0)
    for broken in (b"", kept[:100], kept[:-30]):
        with pytest.raises(InputError, match="cannot be read"):
            FollowedRun.restore(station, TAGS, broken)


def test_a_snapshot_that_no_run_could_have_written_is_refused(station, record):
    run = FollowedRun(station, TAGS)
    run.push(record.part(slice(0, 5000)))
    arrays = unpack(run.snapshot())
    changed = {"detector_memory_beyond_place": arrays["detector_memory_beyond_place"] + 60}
    cut = {name: array[:-1] for name, array in arrays.items() if array.ndim and len(array)}
    for name, array in {**cut, **changed}.items():
        with pytest.raises(InputError, match="cannot be read"):
            FollowedRun.restore(station, TAGS, pack({**arrays, name: array}))
    for name in arrays:
        with pytest.raises(InputError, match="cannot be read"):
            FollowedRun.restore(station, TAGS, pack({k: each for k, each in arrays.items() if k != name}))


def test_a_table_has_a_row_a_second_and_a_column_for_everything(station, record):
    run = FollowedRun(station, TAGS)
    found = run.push(record)
    table, columns = found.table(), list(followed_columns())
    assert table.shape == (len(found), 2 * len(STATES) + 2 * len(ANALOG) + len(SENSORS)) == (len(found), len(columns))
    place = columns.index("measured_temperature_high")
    assert table[:, place].tobytes() == found.measured[:, SENSORS.index("temperature_high")].tobytes()
    assert followed_columns()["estimate_mass_low"] == "g"


@pytest.mark.parametrize("at", [0, 16 * 30, 16 * 200])
def test_a_run_that_is_moved_follows_with_the_other_station_from_the_seconds_it_holds_on(station, record, at):
    other = station.model_copy(
        update={
            "compressor": station.compressor.model_copy(update={"pressure_bar": station.compressor.pressure_bar + 9})
        }
    )
    first = FollowedRun(station, TAGS)
    before = first.push(record.part(slice(0, at)))
    moved, _ = first.moved(other)
    moved = FollowedRun.restore(other, TAGS, moved.snapshot())
    after = [moved.push(record.part(slice(at, None))), moved.finish()]
    frames = frames_of(record.samples(TAGS))
    wanted = follow(frames.part(len(before), len(frames)), other)
    assert np.concatenate([part.states for part in after]).tobytes() == wanted.states.tobytes()
    assert np.concatenate([part.time for part in [before, *after]]).tolist() == [
        frames.start + second for second in range(len(frames))
    ]
    assert moved.counts.taken == int(np.isfinite(record.value).sum())
    with pytest.raises(InputError, match="must not have ended"):
        moved.moved(station)


@pytest.mark.parametrize("at", [0, 16 * 30, 16 * 200])
def test_what_another_version_left_is_gone_on_from_with_estimates_that_begin_anew(station, record, at):
    """An update of the service ends no twin: no second is lost, and none is told twice."""
    first = FollowedRun(station, TAGS)
    before = first.push(record.part(slice(0, at)))
    left = unpack(first.snapshot())
    held = {name: each for name, each in unpack(left["filter"].tobytes()).items() if name != "meter_class"}
    left["filter"] = np.frombuffer(pack(held), np.uint8)
    lacking = ("detector_", "assembly_last", "assembly_heard", "shift_kept_meter_class")
    kept = {name: each for name, each in left.items() if not name.startswith(lacking)}
    other = pack({**kept, "detector_memory_runs": np.zeros((2, 3)), "version": np.array(1), "key": np.array("0" * 64)})
    run = FollowedRun.restore(station, TAGS, other)
    assert run.renewed
    after = [run.push(record.part(slice(at, None))), run.finish()]
    frames = frames_of(record.samples(TAGS))
    wanted = follow(frames.part(len(before), len(frames)), station)
    assert np.concatenate([part.states for part in after]).tobytes() == wanted.states.tobytes()
    assert np.concatenate([part.time for part in [before, *after]]).tolist() == [
        frames.start + second for second in range(len(frames))
    ]
    assert not FollowedRun.restore(station, TAGS, run.snapshot()).renewed
