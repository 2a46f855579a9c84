"""Samples become frames of a second; what nobody measured stays unknown."""

from __future__ import annotations

import json

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from station import InputError
from station.frames import as_kept_now, frames_of, frames_of_seconds, kept_frames
from station.geometry import VALVES
from station.measurement import Tag, TagMap, convert, load_tags, read_table, samples_of
from station.sensor_names import ANALOG, SENSORS

_REST = [{"tag": name, "column": "zero", "sensor": name} for name in (*VALVES, "vehicle")]


def _map(**more):
    return TagMap.model_validate({"tags": [{"tag": "PT1", "column": "p", "sensor": "pressure_high", **more}, *_REST]})


def _frames(times, values, words=None, **more):
    table = {"time_s": pa.array(times, pa.float64()), "p": pa.array(values, pa.float64()), "zero": [0.0] * len(times)}
    if words:
        table["q"] = words
    return frames_of(samples_of(pa.table(table), _map(**more)))


@pytest.mark.parametrize(
    ("unit", "sensor", "given", "wanted"),
    [
        ("MPa", "pressure_high", 70.0, 700.0),
        ("psi", "pressure_high", 10_000.0, 689.4757),
        ("kelvin", "temperature_low", 300.0, 26.85),
        ("degF", "temperature_low", 212.0, 100.0),
        ("kg/h", "flow_compressor", 36.0, 10.0),
        ("liter", "vehicle_volume", 122.4, 0.1224),
    ],
)
def test_units_are_converted(unit, sensor, given, wanted):
    assert convert(np.array([given]), unit, sensor)[0] == pytest.approx(wanted, rel=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"unit": "kg"}, "unit must be one of bar's dimension; given 'kg'"),
        ({"unit": "furlongs_of_hydrogen("}, "unit must be"),
        ({"sensor": "pressure_hihg"}, "sensor must be one of"),
        ({"scale": 0.0}, "scale must not be 0"),
        ({"lag_s": 61.0}, "less than or equal to 60"),
        ({"sensor": "inlet_high"}, "each sensor must have one tag; inlet_high has more"),
    ],
)
def test_a_wrong_tag_is_named(change, message, tmp_path):
    tags = [{"tag": "PT1", "column": "p", "sensor": "pressure_high", **change}, *_REST]
    path = tmp_path / "tags.json"
    path.write_text(json.dumps({"tags": tags}))
    with pytest.raises(InputError, match=message.replace("(", r"\(")):
        load_tags(path)


def test_scale_offset_lag_and_the_nearest_sample():
    frames = _frames([0.0, 1.4, 1.1, 3.0, 4.0], [1, 2, 3, 4, 5], scale=10.0, offset=1.0)
    np.testing.assert_array_equal(frames["pressure_high"], [11, 31, np.nan, 41, 51])
    frames = _frames([0.0, 1.0, 2.0, 3.0], [1, 2, 3, 4], lag_s=2.0)
    np.testing.assert_array_equal(frames["pressure_high"][: frames.values.shape[0]][:2], [1, 2])
    assert frames.start == -2.0


def test_of_two_samples_of_one_time_the_later_counts():
    np.testing.assert_array_equal(_frames([0, 1, 1, 2], [5, 6, 7, 8])["pressure_high"], [5, 7, 8])


def test_quality_and_ranges():
    words = ["Good", "uncertain", "bad", "", "good", "192"]
    frames = _frames(range(6), [1, 2, 3, 4, 5000, 6], words, quality="q", noise=1.0)
    np.testing.assert_array_equal(frames["pressure_high"], [1, 2, np.nan, np.nan, np.nan, 6])
    assert frames.noise[1, 0] == 3.0


@given(
    st.lists(
        st.tuples(st.floats(-1e3, 1e3) | st.just(float("nan")), st.floats(allow_nan=True, allow_infinity=True)),
        min_size=1,
        max_size=60,
    )
)
def test_no_value_is_invented(samples):
    times, values = zip(*samples, strict=True)
    usable = np.isfinite(times)
    if not usable.any():
        with pytest.raises(InputError, match="at least one sample"):
            _frames(list(times), list(values))
        return
    frames = _frames(list(times), list(values))
    read = frames["pressure_high"]
    known = np.flatnonzero(np.isfinite(read))
    assert set(read[known]) <= {value for value in values if 0 <= value <= 2000}
    for second in known:
        assert any(
            abs(time - frames.start - second) <= 0.5 and value == read[second]
            for time, value in samples
            if np.isfinite(time)
        )


@given(st.permutations(range(12)))
def test_the_order_of_samples_does_not_matter(order):
    times = np.array(order, float)
    np.testing.assert_array_equal(_frames(times, times + 1)["pressure_high"], np.arange(12.0) + 1)


def test_a_wrong_record_is_named(tmp_path):
    path = tmp_path / "record.csv"
    path.write_text("time_s,p,zero\n0,much,0\n")
    with pytest.raises(InputError, match="p: must hold numbers"):
        samples_of(read_table(path), _map())
    path.write_text("time_s,zero\n0,0\n")
    with pytest.raises(InputError, match="column 'p' must be in the record"):
        samples_of(read_table(path), _map())
    with pytest.raises(InputError, match=r"must be a \.csv or \.parquet file"):
        read_table(tmp_path / "record.xls")
    with pytest.raises(InputError, match="cannot be read"):
        read_table(tmp_path / "none.csv")
    with pytest.raises(InputError, match="must not span more than"):
        _frames([0, 1e9], [1, 1])
    assert len(SENSORS) == 19


@pytest.mark.parametrize(("sensor", "percent", "worse"), [("pressure_high", 4.0, 0.5), ("flow_compressor", 1.5, 1.5)])
def test_frames_carry_the_worse_class_of_the_meters(sensor, percent, worse):
    sensors = [*ANALOG, *VALVES, "vehicle"]
    given = [Tag(tag=name, column=name, sensor=name) for name in sensors]
    given[sensors.index(sensor)] = Tag(tag=sensor, column=sensor, sensor=sensor, class_percent=percent)
    frames = frames_of_seconds(0.0, np.zeros((3, len(SENSORS))), TagMap(tags=given).tags)
    assert frames.meter_class == frames.part(1, 2).meter_class == kept_frames(frames.arrays()).meter_class == worse
    kept = frames.arrays()
    del kept["meter_class"]  # of a version before
    assert kept_frames(as_kept_now(kept)).meter_class == 0.5
    with pytest.raises(InputError, match="meter_class"):
        kept_frames(kept)


@pytest.mark.parametrize("columns", [0, 3, len(SENSORS), len(SENSORS) + 2])
@pytest.mark.parametrize("values", [1, 1.0, True, "x", 1j], ids=lambda value: type(value).__name__)
def test_seconds_of_another_version_are_read_or_refused(columns, values):
    tags = [Tag(tag=sensor, column=sensor, sensor=sensor) for sensor in SENSORS]
    kept = frames_of_seconds(0.0, np.zeros((3, len(SENSORS))), tags).arrays()
    kept["values"] = np.full((3, columns), values)
    if isinstance(values, float) and columns <= len(SENSORS):
        read = kept_frames(as_kept_now(kept)).values
        assert (read[:, :columns] == 1.0).all()
        assert np.isnan(read[:, columns:]).all()
    else:
        with pytest.raises(InputError, match="values: cannot be read"):
            kept_frames(as_kept_now(kept))
