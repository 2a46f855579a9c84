"""Measurements over REST: durable once they are answered, in four formats, with a scope of their own."""

from __future__ import annotations

import io
import json
import random

import httpx
import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from tests.api.conftest import RunningService
from tests.api.measured import ORDER, batches, followed, rows
from tests.waiting import wait_until

WORKERS = 0


@pytest.fixture
def twin(measured_twin):
    """The address of a measured twin that nobody has used."""
    return f"/v1/twins/{measured_twin}"


def _csv(given):
    lines = (f"{row['tag']},{row['time']},{'' if row['value'] is None else row['value']}" for row in given)
    return "\n".join(["tag,time,value", *lines]).encode()


def _parquet(given):
    stream = io.BytesIO()
    parquet.write_table(pa.Table.from_pylist(given), stream)
    return stream.getvalue()


WRITTEN = {
    "application/json": lambda given: json.dumps(given).encode(),
    "application/x-ndjson": lambda given: "\n".join(map(json.dumps, given)).encode(),
    "text/csv; charset=utf-8": _csv,
    "application/vnd.apache.parquet": _parquet,
}


def _send(http, twin, sequence, batch, media="application/json", source="plc"):
    """Send a batch, again as long as the twin is behind, as whoever sends must."""
    answers = []

    def sent():
        answer = http.post(
            f"{twin}/measurements", params={"source": source, "sequence": sequence},
            content=WRITTEN[media](rows(batch)), headers={"content-type": media},
        )  # fmt: skip
        answers.append(answer)
        return answer.status_code != 503 or "retry-after" not in answer.headers

    wait_until(sent)
    return answers[-1]


def _rows(http, twin):
    table = http.get(f"{twin}/history").json()["columns"]
    names = [name for name in table if name not in ("sent", "resolution")]
    assert table["time"] == [float(n) for n in range(len(table["time"]))]
    return np.array([table[name] for name in names[1:]], float).T


@pytest.mark.slow
def test_the_same_measurements_count_once_whatever_their_format(http, twin):
    sent, medias = batches(80), list(WRITTEN)
    for n, batch in enumerate(sent):
        first = _send(http, twin, n, batch, medias[n % 4])
        assert (first.status_code, first.json()) == (202, {"number": n + 1, "samples": 17, "repeated": False})
        again = _send(http, twin, n, batch, medias[(n + 1) % 4])
        assert (again.status_code, again.json()) == (200, {"number": n + 1, "samples": 17, "repeated": True})
    other = _send(http, twin, 3, sent[4])
    assert (other.status_code, other.json()["type"]) == (409, "urn:hrs-twin:problem:conflict")
    assert http.post(f"{twin}/stop").json()["samples"] == 81
    assert _rows(http, twin).tobytes() == followed(sent, finish=True).tobytes()


def test_an_estimate_is_there_after_the_first_minute(http, twin):
    early = http.get(f"{twin}/estimate")
    assert (early.status_code, "has followed no second yet" in early.json()["detail"]) == (409, True)
    for n, batch in enumerate(batches(80, each=20)):
        assert _send(http, twin, n, batch).status_code == 202
    wait_until(lambda: http.get(f"{twin}/estimate").json().get("number") == 4)
    found = http.get(f"{twin}/estimate").json()
    assert found["quantities"]["mass_high"]["unit"] == "g"
    assert found["quantities"]["mass_high"]["deviation"] > 0
    assert found["sensors"]["pressure_high"]["innovation"] is not None
    assert found["events"] == [] or all(event["unit"] is not None for event in found["events"])
    assert found["samples"]["taken"] > 0


@pytest.mark.parametrize(
    ("query", "field"),
    [
        ({"sequence": 0}, "source"), ({"source": "plc"}, "sequence"), ({"source": "a b", "sequence": 0}, "source"),
        ({"source": "x" * 65, "sequence": 0}, "source"), ({"source": "plc", "sequence": -1}, "sequence"),
        ({"source": "plc", "sequence": 2**53}, "sequence"), ({"source": "plc", "sequence": 0, "sort": 1}, "sort"),
    ],
)  # fmt: skip
def test_a_wrong_query_names_what_is_wrong(http, twin, query, field):
    answer = http.post(f"{twin}/measurements", params=query, json=rows(batches(1)[0]))
    assert (answer.status_code, [each["field"] for each in answer.json()["errors"]]) == (422, [field])


def test_a_wrong_body_names_rows_and_stores_nothing(http, twin):
    query = {"source": "plc", "sequence": 0}
    wrong = [{**rows(batches(1)[0])[0], "tag": "T.nothing"}]
    answer = http.post(f"{twin}/measurements", params=query, json=wrong)
    assert answer.status_code == 422
    assert answer.json()["errors"] == [
        {"field": "0.tag", "message": 'must be a tag of the twin\'s map; given "T.nothing"'}
    ]
    for media in ("text/plain", "application/x-www-form-urlencoded", ""):
        answer = http.post(f"{twin}/measurements", params=query, content=b"[]", headers={"content-type": media})
        assert (answer.status_code, answer.json()["type"]) == (415, "urn:hrs-twin:problem:media-type")
    empty = http.post(f"{twin}/measurements", params=query)
    assert empty.status_code == 415
    assert _send(http, twin, 0, batches(1)[0]).json()["number"] == 1
    other = http.post("/v1/twins", content=b"a,b", headers={"content-type": "text/csv"})
    assert other.status_code == 415, "no other route reads it"


def test_a_simulated_twin_takes_no_measurements_and_a_measured_one_no_commands(http, twin):
    http.post("/v1/twins", json={"id": "simulated", "scenario": "S1"})
    assert _send(http, "/v1/twins/simulated", 0, batches(1)[0]).status_code == 409
    assert http.get("/v1/twins/simulated/estimate").status_code == 409
    assert _send(http, "/v1/twins/nobody", 0, batches(1)[0]).status_code == 404
    assert http.patch(twin, json={"paused": True}).status_code == 409
    assert http.post(f"{twin}/vehicles", json={"start_pressure_bar": 50}).status_code == 409
    assert http.get(f"{twin}/days").json()["items"] == []
    refused = http.post("/v1/twins", json={**ORDER, "id": "odd", "speed": 2})
    assert (refused.status_code, "speed must be left out" in refused.text) == (422, True)
    http.post("/v1/twins/simulated/stop")


def _through_kills(folder, kills, seed):
    """A service that is killed by the system at any moment, and a sender that sends again what was not answered."""
    chance, sent, place = random.Random(seed), batches(60 * (kills + 1)), 0
    running = RunningService(folder, "--workers", "0")
    twin = f"{running.url}/v1/twins/m"
    try:
        with httpx.Client(trust_env=False, timeout=30) as http:
            assert http.post(f"{running.url}/v1/twins", json={**ORDER, "id": "m"}).status_code == 201
            for _ in range(kills):
                until = min(len(sent), place + chance.randrange(20, 60))
                for n in range(place, until):
                    assert _send(http, twin, n, sent[n]).status_code in (200, 202)
                running.kill()
                place = until - chance.randrange(2)  # the last answer may have been lost
                running.start()
            for n in range(place, len(sent)):
                assert _send(http, twin, n, sent[n]).status_code in (200, 202)
            wait_until(lambda: http.get(f"{twin}/estimate").json().get("number") == len(sent))
            assert http.post(f"{twin}/stop").status_code == 200
            assert _rows(http, twin).tobytes() == followed(sent, finish=True).tobytes()
    finally:
        running.stop()


@pytest.mark.slow
def test_a_service_that_is_killed_loses_nothing_that_it_answered(tmp_path):
    _through_kills(tmp_path, 2, seed=26)


@pytest.mark.slow
def test_a_service_that_is_killed_thirty_times_loses_nothing_that_it_answered(tmp_path):
    _through_kills(tmp_path, 30, seed=27)
