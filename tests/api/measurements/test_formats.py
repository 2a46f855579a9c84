"""Measurements in four formats: the same batch of the same rows, and one clear problem for whatever is wrong."""

from __future__ import annotations

import io
import json
import time

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyarrow import parquet

from api.http.problems import ProblemError
from api.measurements.formats import MEDIA_TYPES, NDJSON, read_measurements
from api.measurements.payload import PayloadError, decode_batch, digest_of, encode_batch
from api.settings import Settings
from station.batches import BATCH_MAX, Quality
from station.geometry import VALVES
from station.measurement import TagMap
from station.sensor_names import SENSORS
from tests.pace import slowness

SETTINGS = Settings()
TAGS = TagMap.model_validate({"tags": [{"tag": f"T.{name}", "column": name, "sensor": name} for name in SENSORS]})
PRESSURE, VALVE = "T.pressure_high", f"T.{VALVES[0]}"
PARQUET = "application/vnd.apache.parquet"

ROWS = [
    {"tag": PRESSURE, "time": 1795252800.25, "value": 812.5, "quality": "good"},
    {"tag": VALVE, "time": 1795252800.5, "value": 1.0, "quality": "uncertain"},
    {"tag": PRESSURE, "time": 1795252801.125, "value": 813.0, "quality": "bad"},
    {"tag": "T.vehicle", "time": 1795252801.125, "value": -1.0, "quality": "good"},
]


def _csv(rows):
    names = list(rows[0])
    lines = [",".join("" if row[name] is None else str(row[name]) for name in names) for row in rows]
    return "\n".join([",".join(names), *lines]).encode()


def _parquet(rows):
    stream = io.BytesIO()
    parquet.write_table(pa.Table.from_pylist(rows), stream)
    return stream.getvalue()


WRITTEN = {
    "application/json": lambda rows: json.dumps(rows).encode(),
    NDJSON: lambda rows: "\n".join(map(json.dumps, rows)).encode(),
    "text/csv": _csv,
    PARQUET: _parquet,
}


def _read(body, media="application/json"):
    return read_measurements(body, media, TAGS, SETTINGS)


def _problem(body, media="application/json"):
    with pytest.raises(ProblemError) as caught:
        _read(body, media)
    return caught.value.problem


def _listed(body, media="application/json"):
    return {each.field: each.message for each in _problem(body, media).errors}


@pytest.mark.parametrize("media", WRITTEN)
def test_every_format_gives_the_same_batch(media):
    batch = _read(WRITTEN[media](ROWS), media)
    assert batch.tag.tolist() == [SENSORS.index(row["tag"][2:]) for row in ROWS]
    assert batch.time.tolist() == [row["time"] for row in ROWS]
    assert batch.value.tolist() == [row["value"] for row in ROWS]
    assert batch.quality.tolist() == [Quality.GOOD, Quality.UNCERTAIN, Quality.BAD, Quality.GOOD]
    assert set(WRITTEN) == set(MEDIA_TYPES)


@pytest.mark.parametrize("media", WRITTEN)
@pytest.mark.parametrize(
    "moment",
    ["2026-11-21T09:20:00.250Z", "2026-11-21T10:20:00.25+01:00", "2026-11-21 09:20:00.250000+00:00", "1795252800.25"],
)
def test_times_are_read_with_their_zone(media, moment):
    assert _read(WRITTEN[media]([{**ROWS[0], "time": moment}]), media).time.tolist() == [1795252800.25]


@pytest.mark.parametrize("moment", ["2026-11-21T09:20:00", "2026-11-21", "noon", "", "2026-13-01T00:00:00Z"])
@pytest.mark.parametrize("media", WRITTEN)
def test_a_time_without_zone_or_sense_is_refused(media, moment):
    wrong = _listed(WRITTEN[media]([{**ROWS[0], "time": moment}]), media)
    assert list(wrong) == ["0.time"]
    assert "must be seconds or an ISO 8601 time with its zone; given" in wrong["0.time"]


@pytest.mark.parametrize("moments", [(1.5, False), (False, 1.5), (1, True), (True, True), (True, 1, 2.5)])
@pytest.mark.parametrize("media", ["application/json", NDJSON])
def test_truth_is_no_time_wherever_it_stands_among_numbers(media, moments):
    """Behind a number with a point it was 0 or 1 s."""
    wrong = _listed(WRITTEN[media]([{**ROWS[0], "time": moment} for moment in moments]), media)
    assert list(wrong) == [f"{row}.time" for row, moment in enumerate(moments) if isinstance(moment, bool)]


@pytest.mark.parametrize("moment", [1e300, -1e300, "nan", "inf"])
def test_a_time_far_away_is_refused(moment):
    assert list(_listed(WRITTEN["application/json"]([{**ROWS[0], "time": moment}]))) == ["0.time"]


def test_timestamps_of_parquet_are_read_in_every_unit_and_refused_without_zone():
    for unit, given_ in (("ms", 1795252800250), ("us", 1795252800250000), ("ns", 1795252800250000000)):
        table = pa.table({"tag": [PRESSURE], "time": pa.array([given_], pa.timestamp(unit, "UTC")), "value": [1]})
        stream = io.BytesIO()
        parquet.write_table(table, stream)
        assert _read(stream.getvalue(), PARQUET).time.tolist() == [1795252800.25]
    table = pa.table({"tag": [PRESSURE], "time": pa.array([1795252800250], pa.timestamp("ms")), "value": [1]})
    stream = io.BytesIO()
    parquet.write_table(table, stream)
    assert "0.time" in _listed(stream.getvalue(), PARQUET)


QUALITIES = {
    "good": 2, "Good": 2, " GOOD ": 2, "uncertain": 1, "bad": 0, None: 2, "": 2, 192: 2, 216: 2, 255: 2, 64: 1, 127: 1,
    0: 0, 63: 0, "192": 2, "64": 1, "0": 0, 1 << 30: 1, 0x40920000: 1, 0x80000000: 0, 0x803C0000: 0, 0xC0000000: 0,
}  # fmt: skip


@pytest.mark.parametrize("quality", QUALITIES)
@pytest.mark.parametrize("media", WRITTEN)
def test_qualities_are_words_classic_codes_or_status_codes(media, quality):
    assert _read(WRITTEN[media]([{**ROWS[0], "quality": quality}]), media).quality.tolist() == [QUALITIES[quality]]


@pytest.mark.parametrize("quality", ["fine", 128, 191, 256, -1, 1 << 32, True, 1.5, [1], {"a": 1}])
def test_a_quality_that_means_nothing_is_refused(quality):
    assert list(_listed(json.dumps([ROWS[0], {**ROWS[0], "quality": quality}]).encode())) == ["1.quality"]


@pytest.mark.parametrize("media", WRITTEN)
def test_what_is_not_said_is_good_and_what_is_no_number_is_bad(media):
    rows = [{"tag": PRESSURE, "time": 0.5, "value": value} for value in (1.5, None, float("nan"))]
    if media in ("application/json", NDJSON):
        del rows[2]  # JSON has no NaN
    batch = _read(WRITTEN[media](rows), media)
    assert batch.quality.tolist() == [Quality.GOOD, Quality.BAD, Quality.BAD][: len(rows)]
    assert np.isnan(batch.value[1:]).all()


def test_truth_values_are_numbers():
    rows = [{"tag": VALVE, "time": n, "value": value} for n, value in enumerate([True, False])]
    for media in ("application/json", NDJSON, PARQUET, "text/csv"):
        assert _read(WRITTEN[media](rows), media).value.tolist() == [1.0, 0.0], media


@pytest.mark.parametrize("media", WRITTEN)
def test_wrong_cells_are_named_by_row_and_field_and_at_most_twenty(media):
    rows = [{**ROWS[0], "tag": f"x{n}", "quality": "odd"} for n in range(30)]
    problem = _problem(WRITTEN[media](rows), media)
    assert (problem.status, problem.detail) == (422, "60 fields are wrong; 20 of them are listed")
    assert problem.errors[0].field.startswith("0.")
    assert 'given "x0"' in problem.errors[0].message


@pytest.mark.parametrize(
    ("body", "field", "message"),
    [
        (b"{", "", "is not JSON"),
        (b"[]", "", "must hold 1 to 20000 rows; given 0"),
        (b"3", "", "must be a list of rows"),
        (b"[3]", "0", "must be an object with tag"),
        (b'[{"tag": "a", "vlaue": 1}]', "0.vlaue", "is no field of a row"),
        (b'[{"tag": "T.vehicle", "time": 1, "value": "much"}]', "0.value", 'empty; given "much'),
        (b'[{"time": 1, "value": 1}]', "0.tag", "must be a tag of the twin's map; given null"),
    ],
)  # fmt: skip
def test_the_first_thing_wrong_is_said(body, field, message):
    assert message in _listed(body)[field]


def test_a_batch_that_is_too_long_is_refused():
    rows = [ROWS[0]] * (BATCH_MAX + 1)
    for media, write in WRITTEN.items():
        assert f"must hold 1 to {BATCH_MAX} rows; given {BATCH_MAX + 1}" in _listed(write(rows), media)[""]
        assert len(_read(write(rows[1:]), media)) == BATCH_MAX


def test_columns_that_are_missing_double_or_unknown_are_named():
    assert _listed(b"tag,time\na,1\n", "text/csv") == {"value": "must be a column"}
    assert list(_listed(b"tag,time,value,colour\na,1,1,red\n", "text/csv")) == ["colour"]
    assert list(_listed(b"tag,time,value,tag\na,1,1,b\n", "text/csv")) == ["tag"]


def test_another_media_type_is_refused():
    problem = _problem(b"<a/>", "text/xml; charset=utf-8")
    assert (problem.status, "text/xml" in problem.detail) == (415, True)
    assert len(_read(json.dumps(ROWS).encode(), "Application/JSON; charset=utf-8")) == len(ROWS)


_ANY = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3),
)
_CELLS = st.sampled_from([row[name] for row in ROWS for name in row]) | _ANY


@given(st.binary(max_size=200), st.sampled_from(list(MEDIA_TYPES)))
def test_no_bytes_bring_it_down(body, media):
    _refused_or_read(body, media)


@pytest.mark.slow
@given(st.lists(st.dictionaries(st.sampled_from(["tag", "time", "value", "quality", "x"]), _CELLS), max_size=4))
def test_no_json_brings_it_down(rows):
    _refused_or_read(json.dumps(rows).encode(), "application/json")


@given(
    st.lists(
        st.lists(st.sampled_from([PRESSURE, "1", "good", "", '"', "2026-01-01T00:00:00Z"]), max_size=5), max_size=5
    )
)
def test_no_csv_brings_it_down(rows):
    _refused_or_read("\n".join(["tag,time,value,quality", *map(",".join, rows)]).encode(), "text/csv")


@given(st.integers(0, 10**6), st.integers(0, 255), st.booleans())
def test_no_damaged_parquet_brings_it_down(place, byte, cut):
    whole = bytearray(_parquet(ROWS))
    whole[place % len(whole)] = byte
    _refused_or_read(bytes(whole[: place % len(whole)] if cut else whole), PARQUET)


def _refused_or_read(body, media):
    try:
        batch, problem = _read(body, media), None
    except ProblemError as error:
        batch, problem = None, error
    if problem is not None:
        assert 400 <= problem.problem.status < 500
        assert problem.document()
    if batch is not None:
        assert 1 <= len(batch) <= BATCH_MAX
        assert encode_batch(decode_batch(encode_batch(batch))) == encode_batch(batch)


def test_the_log_keeps_every_bit_and_tells_contents_apart():
    batch = _read(json.dumps(ROWS).encode())
    payload = encode_batch(batch)
    again = decode_batch(payload)
    for name in ("tag", "time", "value", "quality"):
        assert getattr(again, name).tobytes() == getattr(batch, name).tobytes()
    assert len(payload) == 8 + 19 * len(ROWS)
    assert digest_of(payload) == digest_of(encode_batch(_read(_parquet(ROWS), PARQUET)))
    assert digest_of(payload) != digest_of(encode_batch(_read(json.dumps(ROWS[::-1]).encode())))
    for wrong in (b"", payload[:-1], b"X" + payload[1:], payload + b"0"):
        with pytest.raises(PayloadError, match="cannot be read"):
            decode_batch(wrong)


@pytest.mark.timed
def test_a_second_of_a_station_takes_little():
    """Fifty stations of thirty tags a second must be cheap: a fifth of a core at the most."""
    rows = [{**ROWS[0], "tag": f"T.{SENSORS[n % len(SENSORS)]}"} for n in range(30)]
    for media, write in WRITTEN.items():
        body = write(rows)
        encode_batch(_read(body, media))  # what is loaded and looked up once
        begin = time.thread_time()
        for _ in range(50):
            encode_batch(_read(body, media))
        assert time.thread_time() - begin < 0.2 * slowness(), media
