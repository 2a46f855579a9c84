"""Batches become the seconds of the whole record, byte for byte, in whatever order and batches its samples come."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from station import InputError
from station.batches import Batch
from station.estimation.assembly import Assembler, Counts
from station.frames import Frames, frames_of
from station.geometry import VALVES
from station.measurement import Tag, TagMap

TAGS = TagMap(
    tags=[
        *(Tag(tag=name, column=name, sensor=name, source="plc") for name in (*VALVES[:-2], "vehicle")),
        *(Tag(tag=name, column=name, sensor=name, source="plc", on_change=True) for name in VALVES[-2:]),
        Tag(tag="PT", column="PT", sensor="pressure_high", lag_s=3.0),
        Tag(tag="TT", column="TT", sensor="temperature_high"),
        Tag(tag="FT", column="FT", sensor="flow_compressor", noise_relative=0.05),
        Tag(tag="FD", column="FD", sensor="flow_dispenser", noise=0.2, on_change=True),
    ]
)


def batch(*rows) -> Batch:
    """Of rows (tag, time, value)."""
    tag, time, value = zip(*rows, strict=True)
    return Batch.named(TAGS, tag, time, value)


def seconds(parts) -> Frames:
    parts = [part for part in parts if part is not None]
    assert [part.start for part in parts[1:]] == [part.start + len(part) for part in parts[:-1]]
    assert all(part.relative.tobytes() == parts[0].relative.tobytes() for part in parts)
    return Frames(
        parts[0].start,
        np.concatenate([part.values for part in parts]),
        np.concatenate([part.noise for part in parts]),
        parts[0].relative,
        parts[0].measured,
        parts[0].time_constants,
    )


def same(one: Frames, two: Frames) -> bool:
    return (one.start, one.measured) == (two.start, two.measured) and all(
        getattr(one, name).tobytes() == getattr(two, name).tobytes() for name in ("values", "noise", "relative")
    )


@st.composite
def sent(draw):
    """Batches of a record of a minute, none of whose samples is late: each comes within 4 s of its own time."""
    seed = draw(st.integers(0, 2**32 - 1))
    rng = np.random.default_rng(seed)
    count = draw(st.integers(1, 300))
    stamp = np.round(rng.uniform(0, 60, count), draw(st.sampled_from([0, 1, 6])))
    tag = rng.integers(0, draw(st.integers(1, len(TAGS.tags))), count)
    stamp[0], tag[0] = -4.0, 0  # the first comes first
    value = rng.uniform(0, 1, count)
    value[1:][rng.random(count - 1) < 0.1] = np.nan
    order = np.argsort(stamp + rng.uniform(0, 4, count) * (np.arange(count) > 0), kind="stable")
    order = np.r_[0, order[order != 0]]
    whole = Batch(tag[order], 1.7e9 + stamp[order], value[order], rng.integers(1, 3, count))
    cuts = sorted(draw(st.lists(st.integers(1, count), max_size=12)))
    return whole, [whole.part(slice(a, b)) for a, b in zip([0, *cuts], [*cuts, count], strict=True)]


@pytest.mark.slow
@settings(max_examples=200, deadline=None)
@given(sent(), st.sampled_from([0.0, 2.0, -2.0]))
def test_seconds_are_those_of_the_whole_record(sent, skew):
    whole, batches = sent
    fast = {"station": skew}
    live = Assembler(TAGS, fast, lateness=8.0)
    parts = []
    for each in batches:
        parts.append(live.push(each))
        kept = live.snapshot()
        live = Assembler(TAGS, fast, lateness=8.0)
        live.restore(kept)
    found = seconds([*parts, live.close()])
    assert same(found, frames_of(whole.samples(TAGS), fast))
    counts = live.counts
    assert counts.taken + counts.empty + counts.late == len(whole)
    assert counts.late == 0 or skew > 0
    assert counts.ahead == 0


@st.composite
def wild(draw):
    """Batches of anything: clocks that jump, values out of range, tags at random."""
    times = st.floats(-2e5, 2e5) | st.sampled_from([0.0, 0.5, 600.0, 1e11, -1e11])
    row = st.tuples(st.integers(0, len(TAGS.tags) - 1), times, st.floats(), st.integers(0, 2))
    return Batch(*zip(*draw(st.lists(row, min_size=1, max_size=8)), strict=True))


@pytest.mark.slow
@settings(max_examples=200, deadline=None)
@given(st.lists(wild(), max_size=6))
def test_whatever_comes_seconds_follow_one_another_and_every_sample_is_counted(batches):
    live, parts, taken = Assembler(TAGS), [], 0
    for each in batches:
        before = live.counts
        try:
            parts.append(live.push(each))
        except InputError:
            assert live.counts == before
            continue
        taken += len(each)
    parts = [part for part in (*parts, live.close()) if part is not None]
    counts = live.counts
    assert counts.taken + counts.late + counts.empty + counts.ahead == taken
    assert counts.duplicate <= counts.taken
    if parts:
        whole = seconds(parts)
        assert whole.start + len(whole) - 1 == np.ceil(live.newest)


def test_a_second_closes_by_the_time_of_the_data_alone():
    live = Assembler(TAGS, lateness=2.0)  # and 3 s of the lag of PT
    assert len(live.push(batch(("TT", 10.0, 20.0)))) == 0
    assert len(live.push(batch(("TT", 15.4, 20.0)))) == 0
    closed = live.push(batch(("TT", 15.5, 21.0)))
    assert (closed.start, closed["temperature_high"].tolist()) == (10.0, [20.0])
    assert live.next_second == 11.0


def test_a_silent_meter_is_measured_and_keeps_its_relative_noise():
    live = Assembler(TAGS)
    frames = live.push(batch(("TT", 0.0, 20.0)))
    assert frames.measured == tuple(tag.sensor for tag in TAGS.tags if not tag.on_change)
    assert frames.relative.max() == 0.05


def test_of_two_samples_equally_near_the_later_to_come_counts():
    for rows, wanted in (([9.75, 10.25], 2.0), ([10.25, 9.75], 2.0), ([10.25, 10.25], 2.0), ([10.25, 9.7], 1.0)):
        live = Assembler(TAGS)
        live.push(batch(("TT", 9.0, 0.0)))
        for value, time in enumerate(rows, 1):
            live.push(batch(("TT", time, float(value))))
        assert live.close()["temperature_high"][1] == wanted


def test_samples_without_a_value_do_not_move_time():
    live = Assembler(TAGS)
    assert live.push(batch(("TT", 500.0, np.nan))) is None
    live.push(batch(("TT", 10.0, 20.0), ("TT", 90.0, np.inf), ("TT", 95.0, 1e6)))
    assert (live.newest, live.next_second) == (10.0, 10.0)
    assert live.counts == Counts(taken=1, empty=3)


def test_late_samples_and_repeated_ones_are_counted():
    live = Assembler(TAGS, lateness=0.0)
    live.push(batch(("TT", 10.0, 20.0), ("TT", 10.0, 21.0)))
    live.push(batch(("TT", 20.0, 21.0)))
    assert live.next_second == 17.0
    assert len(live.push(batch(("TT", 16.4, 30.0), ("TT", 9.9, 30.0), ("TT", 20.0, 21.0)))) == 0
    assert live.counts == Counts(taken=4, late=2, duplicate=2)


def test_one_sample_far_ahead_is_refused_and_time_that_has_gone_on_is_not():
    live = Assembler(TAGS)
    live.push(batch(*((tag.tag, 0.0, 0.5) for tag in TAGS.tags)))
    live.push(batch(("TT", 1.0, 20.0), ("FT", 1.0, 2.0), ("inlet_high", 5000.0, 1.0)))
    assert (live.counts.ahead, live.newest) == (1, 1.0)
    live.push(batch(("TT", 5000.0, 20.0), ("FT", 5001.0, 2.0), ("inlet_high", 2.0, 1.0)))
    assert (live.counts.ahead, live.newest, live.next_second) == (1, 5001.0, 4993.0)


def test_a_long_batch_without_a_gap_is_not_ahead_of_itself():
    live = Assembler(TAGS)
    live.push(batch(*(("TT", 60.0 * k, 20.0) for k in range(100)), ("FT", 0.0, 1.0)))
    live.push(batch(*(("TT", 6000.0 + 60.0 * k, 20.0) for k in range(100)), ("FT", 6000.0, 1.0)))
    assert (live.counts.ahead, live.counts.taken) == (0, 202)


def test_more_than_a_day_at_once_is_refused_and_changes_nothing():
    live = Assembler(TAGS)
    live.push(batch(("TT", 0.0, 20.0)))
    before = live.snapshot()
    with pytest.raises(InputError, match="must not go on by more than 86400 s at once; given 86401"):
        live.push(batch(("TT", 86_401.0, 20.0)))
    after = live.snapshot()
    assert {name: each.tobytes() for name, each in after.items()} == {n: e.tobytes() for n, e in before.items()}
    assert len(live.push(batch(("TT", 86_400.0, 20.0)))) == 86_392  # 8 s are held open


def test_a_lateness_without_end_is_refused():
    with pytest.raises(InputError, match="must lie from 0 to 600 s; given 601"):
        Assembler(TAGS, lateness=601.0)
