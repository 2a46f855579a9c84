"""A batch holds what a source sends, within limits, and reads it as a record's columns are read."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pytest

from station import InputError
from station.batches import BATCH_MAX, Batch, Quality
from station.geometry import VALVES
from station.measurement import Tag, TagMap, samples_of

TAGS = TagMap(
    tags=[
        *(Tag(tag=name.upper(), column=name, sensor=name) for name in (*VALVES, "vehicle")),
        Tag(tag="PT", column="PT", sensor="pressure_high", unit="MPa", lag_s=2.0, noise=0.5, quality="Q"),
        Tag(tag="FT", column="FT", sensor="flow_compressor", scale=0.5, offset=1.0),
    ]
)
PT = len(VALVES) + 1


def test_samples_of_a_batch_are_those_of_a_table():
    time, read = np.arange(6.0), [30.0, np.nan, 31.0, -4.0, 32.5, 33.0]
    words, levels = ["good", "good", "uncertain", "good", "bad", "64"], [2, 2, 1, 2, 0, 1]
    table = {name: np.zeros(6) for name in (*VALVES, "vehicle", "FT")}
    (wanted,) = [
        each
        for each in samples_of(pa.table({"time_s": time, "PT": read, "Q": words, **table}), TAGS)
        if each.tag.tag == "PT"
    ]
    found = Batch.named(TAGS, ["PT"] * 6, time, read, levels).samples(TAGS)[PT]
    for name in ("time", "value", "noise"):
        assert getattr(found, name).tobytes() == getattr(wanted, name).tobytes()
    assert np.isfinite(found.value).tolist() == [True, False, True, False, False, True]


def test_a_silent_tag_has_an_empty_series():
    samples = Batch.named(TAGS, ["PT"], [1.0], [30.0]).samples(TAGS)
    assert [each.tag.tag for each in samples] == [tag.tag for tag in TAGS.tags]
    assert [len(each.time) for each in samples] == [0] * PT + [1, 0]


def test_a_value_that_is_no_number_is_bad_and_arrays_cannot_be_written():
    batch = Batch([0, 0, 0], [1.0, 2.0, 3.0], [np.inf, np.nan, 1.0], [2, 1, 2])
    assert batch.quality.tolist() == [Quality.BAD, Quality.BAD, Quality.GOOD]
    assert np.isnan(batch.value[:2]).all()
    with pytest.raises(ValueError, match="read-only"):
        batch.value[2] = 5.0


def test_a_batch_keeps_nothing_of_the_arrays_it_was_given():
    time = np.array([1.0])
    batch = Batch([0], time, [0.0], [2])
    time[0] = 7.0
    assert batch.time.tolist() == [1.0]


def test_batches_are_joined_in_their_order_and_cut():
    one, two = Batch([0], [5.0], [1.0], [2]), Batch([1, 0], [4.0, 5.0], [0.0, 0.0], [1, 2])
    both = Batch.joined([one, two])
    assert (both.tag.tolist(), both.time.tolist(), both.quality.tolist()) == ([0, 1, 0], [5.0, 4.0, 5.0], [2, 1, 2])
    assert both.part(slice(1, 3)).time.tolist() == [4.0, 5.0]
    assert len(Batch.joined([])) == 0


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (([0], [np.nan], [1.0], [2]), r"time: must lie from -253402300800 to 253402300800; given nan at 0"),
        (([0, 0], [0.0, np.inf], [1.0, 1.0], [2, 2]), "given inf at 1"),
        (([0], [0.0], [1.0], [3]), "quality: must lie from 0 to 2; given 3 at 0"),
        (([-1], [0.0], [1.0], [2]), "tag: must lie from 0 to 32767; given -1 at 0"),
        (([0.5], [0.0], [1.0], [2]), r"tag: must hold whole numbers; given 0\.5 at 0"),
        (([0], [0.0, 1.0], [1.0], [2]), "time: must hold 1 entries, as tag does; given 2"),
        (([0], [0.0], ["x"], [2]), "value: must hold numbers"),
        (([[0]], [0.0], [1.0], [2]), "tag: must have one dimension; given 2"),
        (([0] * (BATCH_MAX + 1),) * 4, "must hold at most 20000 samples; given 20001"),
    ],
)
def test_what_is_no_batch_is_refused(given, message):
    with pytest.raises(InputError, match=message):
        Batch(*given)


def test_tags_that_the_map_does_not_have_are_refused():
    with pytest.raises(InputError, match="tag: must be tags of the map; given XT"):
        Batch.named(TAGS, ["PT", "XT"], [0.0, 0.0], [1.0, 1.0])
    with pytest.raises(InputError, match="tag: must lie from 0 to 8; given 9 at 0"):
        Batch([9], [0.0], [1.0], [2]).samples(TAGS)
    twice = TagMap(tags=[*TAGS.tags, Tag(tag="PT", column="x", sensor="pressure_low")])
    with pytest.raises(InputError, match="given twice PT"):
        Batch.named(twice, ["PT"], [0.0], [1.0])
