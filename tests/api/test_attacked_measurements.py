"""Senders of measurements that are wrong in ways real ones are: each is told or counted, and the twin goes on."""

from __future__ import annotations

import gzip
import json

import pytest

from station.batches import BATCH_MAX
from tests.api.measured import BEGIN, NAMES, batches
from tests.api.test_measurements import _send
from tests.waiting import wait_until

WORKERS = 0
GOOD = {"pressure": 300.0, "temperature": 20.0, "flow": 10.0, "vehicle": -1.0}
"""Readings by the kind of the sensor; of a valve 0."""

YEAR_S = 365 * 86_400.0


@pytest.fixture
def twin(http, measured_twin):
    """The address of a measured twin that has followed a minute and more of good readings."""
    path = f"/v1/twins/{measured_twin}"
    for n, batch in enumerate(batches(80, each=40)):
        assert _send(http, path, n, batch).status_code == 202
    wait_until(lambda: http.get(f"{path}/estimate").json().get("number") == 2)
    return path


def _post(http, twin, sequence, given, source="plc", **headers):
    """Send rows as they are, again as long as the twin is behind."""
    answers = []

    def sent():
        content = given if isinstance(given, bytes) else json.dumps(given).encode()
        answers.append(
            http.post(
                f"{twin}/measurements", params={"source": source, "sequence": sequence}, content=content,
                headers={"content-type": "application/json", **headers},
            )
        )  # fmt: skip
        return answers[-1].status_code != 503

    wait_until(sent)
    return answers[-1]


def _later(seconds, begin=80.0):
    """Good rows of seconds behind those that the twin has."""
    return [
        {"tag": f"T.{name}", "time": BEGIN + begin + second + 0.1, "value": GOOD.get(name.partition("_")[0], 0.0)}
        for second in range(seconds)
        for name in NAMES
    ]


def _counts(http, twin, number):
    wait_until(lambda: http.get(f"{twin}/estimate").json()["number"] == number)
    return http.get(f"{twin}/estimate").json()["samples"]


def _goes_on(http, twin, number, begin=80.0):
    """Good readings are followed as before."""
    before = http.get(f"{twin}/estimate").json()
    assert _post(http, twin, 1000, _later(40, begin)).json()["number"] == number
    _counts(http, twin, number)
    after = http.get(f"{twin}/estimate").json()
    assert after["seq"] >= before["seq"] + 30
    assert http.get(twin).json()["state"] == "running"


def test_times_in_milliseconds_are_refused_by_their_limit(http, twin):
    given = [{**row, "time": row["time"] * 1000.0} for row in _later(1)]
    answer = _post(http, twin, 2, given)
    assert answer.status_code == 422
    assert answer.json()["errors"][0]["field"] == "0.time"
    assert "must lie within 253402300800 s of 1970; given 1.7" in answer.json()["errors"][0]["message"]
    _goes_on(http, twin, 3)


@pytest.mark.parametrize("jump", [YEAR_S, -YEAR_S])
def test_a_clock_that_jumps_a_year_is_told_and_no_second_is_made_of_it(http, twin, jump):
    given = [{**row, "time": row["time"] + jump} for row in _later(2)]
    assert _post(http, twin, 2, given).status_code == 202
    counts = _counts(http, twin, 3)
    refused = [each for each in http.get(f"{twin}/events").json()["items"] if each["kind"] == "measurements_refused"]
    if jump > 0:
        assert [(each["details"]["number"], each["details"]["samples"]) for each in refused] == [(3, 34)]
    else:
        assert (counts["late"], refused) == (34, [])
    _goes_on(http, twin, 4)


def test_one_tag_whose_clock_jumps_does_not_take_the_others_along(http, twin):
    given = _later(1)
    given[0]["time"] += 7200.0
    assert _post(http, twin, 2, given).status_code == 202
    assert _counts(http, twin, 3)["ahead"] == 1
    _goes_on(http, twin, 4, 81.0)


@pytest.mark.slow
def test_twenty_thousand_samples_of_one_second_are_one_second(http, twin):
    one = _later(1)
    given = [{**one[n % len(one)], "time": BEGIN + 80.0 + n / BATCH_MAX / 2.1} for n in range(BATCH_MAX)]
    assert _post(http, twin, 2, given).json() == {"number": 3, "samples": BATCH_MAX, "repeated": False}
    before = http.get(twin).json()["samples"]
    _counts(http, twin, 3)
    assert http.get(twin).json()["samples"] <= before + 1
    assert _post(http, twin, 3, [*given, given[0]]).status_code == 422
    _goes_on(http, twin, 4, 81.0)


def test_the_same_rows_in_another_order_are_other_content(http, twin):
    """The order says which of two samples of one time counts, so it belongs to what was sent."""
    given = _later(2)
    assert _post(http, twin, 2, given).status_code == 202
    again = _post(http, twin, 2, given[::-1])
    assert (again.status_code, "other content" in again.json()["detail"]) == (409, True)
    other = _post(http, twin, 3, given[::-1])
    assert other.status_code == 202
    assert _counts(http, twin, 4)["duplicate"] == 34
    _goes_on(http, twin, 5, 82.0)


def test_a_tag_twice_for_one_time_counts_once(http, twin):
    given = _later(1)
    assert _post(http, twin, 2, [*given, {**given[0], "value": 1.0}]).status_code == 202
    assert _counts(http, twin, 3)["duplicate"] == 1
    _goes_on(http, twin, 4, 81.0)


@pytest.mark.parametrize("text", ["NaN", "Infinity", "-Infinity", "1e999"])
def test_what_is_no_number_in_json_is_refused(http, twin, text):
    given = json.dumps(_later(1)).replace('"value": -1.0', f'"value": {text}', 1).encode()
    assert text.encode() in given
    answer = _post(http, twin, 2, given)
    assert answer.status_code in (202, 422)
    if answer.status_code == 202:
        assert _counts(http, twin, 3)["empty"] >= 1
    _goes_on(http, twin, 3 + (answer.status_code == 202), 81.0)


def test_rows_of_another_twins_tags_are_named_and_none_is_stored(http, twin):
    given = [{**row, "tag": f"B.{row['tag']}"} for row in _later(2)]
    answer = _post(http, twin, 2, [*_later(1), *given])
    assert (answer.status_code, len(answer.json()["errors"])) == (422, 20)
    assert answer.json()["errors"][0]["field"] == "17.tag"
    assert "34 fields are wrong" in answer.json()["detail"]
    _goes_on(http, twin, 3)


def test_sources_number_by_themselves_and_gaps_are_theirs(http, twin):
    half = _later(4)
    sent = [("a", 7, half[:17]), ("b", 7, half[17:34]), ("a", 1000, half[34:51]), ("b", 8, half[51:])]
    for number, (source, sequence, given) in enumerate(sent, 3):
        assert _post(http, twin, sequence, given, source).json()["number"] == number
    repeated = _post(http, twin, 7, half[:17], "a").json()
    assert (repeated["number"], repeated["repeated"]) == (3, True)
    assert _post(http, twin, 7, half[:17], "b").status_code == 409, "b's own 7 was something else"
    assert _post(http, twin, 500, half[34:51], "a").json()["number"] == 7
    found = {each["source"]: each["sequence"] for each in http.get(f"{twin}/measurements").json()["sources"]}
    assert found == {"a": 1000, "b": 8, "plc": 1}
    assert _post(http, twin, 2024 + 1, half[:17], "a").json()["number"] == 8
    late = _post(http, twin, 1000, half[:17], "a")
    assert late.status_code == 409
    old = _post(http, twin, 999, half[:17], "a")
    assert (old.status_code, "1024 below" in old.json()["detail"]) == (409, True)
    _goes_on(http, twin, 9, 84.0)


@pytest.mark.parametrize("given", [b"[]", b'{"samples": []}', b"", b"null", b"{}"])
def test_batches_without_rows_are_refused(http, twin, given):
    assert _post(http, twin, 2, given).status_code == 422
    _goes_on(http, twin, 3)


def test_a_body_that_is_packed_is_refused_in_words(http, twin):
    packed = gzip.compress(json.dumps(_later(1)).encode())
    answer = _post(http, twin, 2, packed, **{"content-encoding": "gzip"})
    assert (answer.status_code, "Content-Encoding must be left out" in answer.json()["detail"]) == (415, True)
    assert _post(http, twin, 2, packed).status_code == 422
    _goes_on(http, twin, 3)
