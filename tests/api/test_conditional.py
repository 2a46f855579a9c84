"""Conditional requests: nobody downloads twice what never changes, nobody overwrites what others changed."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor

import httpx
import pytest

from tests.api.conftest import ended
from tests.api.test_idempotency import SYSTEM


@pytest.fixture(scope="module")
def places(http):
    """Paths of a job of each kind that has ended, with what belongs to it."""
    of_a_run = ["", "/series", "/series?columns=mass_low&format=csv", "/series?format=parquet", "/vehicles"]
    posts = {
        "/v1/runs": ({"scenario": "S1"}, of_a_run),
        "/v1/comparisons": (
            {"scenarios": ["S1"], "controllers": ["logic"]},
            ["", "/results", "/results?format=csv", "/table", "/figures", "/scenarios", "/report"],
        ),
        "/v1/certificates": (SYSTEM, ["", "/document"]),
    }  # fmt: skip
    found = []
    for path, (body, parts) in posts.items():
        place = http.post(path, json=body).headers["location"]
        assert ended(http, place)["state"] == "succeeded"
        found += [place + part for part in parts]
    return found


def test_what_has_ended_is_sent_once(http, places):
    tags = set()
    for place in places:
        answer = http.get(place)
        tag = answer.headers["etag"]
        assert tag.startswith('"')
        assert answer.headers["cache-control"] == "private, no-cache"
        for held in (tag, "*", f'"other", W/{tag}', f"W/{tag}"):
            again = http.get(place, headers={"if-none-match": held})
            assert (again.status_code, again.content, again.headers["etag"]) == (304, b"", tag), place
            assert "x-request-id" in again.headers
        assert http.get(place, headers={"if-none-match": '"other"'}).content == answer.content
        tags.add(tag)
    assert len(tags) == len(places)


def test_any_tag_is_a_star_alone(http, places):
    for held, status in (("*", 304), ('"*', 200), ('"*"', 200), ('"a", *', 200)):
        assert http.get(places[0], headers={"if-none-match": held}).status_code == status, held


def test_who_may_be_told_that_nothing_changed_is_told_so_in_the_document(http):
    for path, operations in http.get("/openapi.json").json()["paths"].items():
        for method, operation in operations.items():
            asked = any(given["name"].lower() == "if-none-match" for given in operation.get("parameters", ()))
            assert ("304" in operation["responses"]) == (asked and method == "get"), (method, path)


def test_what_has_not_ended_has_no_tag(http):
    slow = {"scenario": "S4", "controller": "minlp1:horizon=10:node_limit=1000000000"}
    for path, body in (
        ("/v1/runs", slow),
        ("/v1/comparisons", {"scenarios": ["S4"], "controllers": [slow["controller"]]}),
    ):
        place = http.post(path, json=body).headers["location"]
        assert "etag" not in http.get(place, headers={"if-none-match": "*"}).headers
        assert http.post(f"{place}/cancel").json()["state"] == "cancelled"
        assert http.get(place, headers={"if-none-match": http.get(place).headers["etag"]}).status_code == 304


@pytest.fixture
def twin(http):
    path = "/v1/twins/tagged"
    assert (
        http.post("/v1/twins", json={"id": "tagged", "scenario": "S1", "speed": 50, "at_end": "repeat"}).status_code
        == 201
    )
    yield path
    http.post(f"{path}/stop")
    assert http.delete(path).status_code == 204


def test_a_change_is_made_once(http, twin):
    tag = http.get(twin).headers["etag"]
    time.sleep(0.2)  # ten samples, which nobody changed
    changed = http.patch(twin, json={"speed": 5}, headers={"if-match": tag})
    assert (changed.status_code, changed.json()["speed"]) == (200, 5)
    refused = http.patch(twin, json={"speed": 7, "paused": True}, headers={"if-match": tag})
    assert refused.status_code == 412
    assert refused.json()["type"] == "urn:hrs-twin:problem:changed"
    assert refused.json()["errors"][0]["field"] == "If-Match"
    found = http.get(twin).json()
    assert (found["speed"], found["state"]) == (5, "running")
    assert http.patch(twin, json={"speed": 8}, headers={"if-match": f"W/{changed.headers['etag']}"}).status_code == 412
    for held in (changed.headers["etag"], "*", f'"x", {http.get(twin).headers["etag"]}'):
        assert http.patch(twin, json={"controller": "logic"}, headers={"if-match": held}).status_code == 200
    assert http.post(f"{twin}/stop", headers={"if-match": tag}).status_code == 412
    assert http.get(twin).json()["state"] == "running"


def test_of_many_changes_of_one_state_one_is_made(service, http, twin):
    tag = http.get(twin).headers["etag"]

    def change(speed):
        answer = httpx.patch(
            service.url + twin, json={"speed": speed}, headers={"if-match": tag}, timeout=30, trust_env=False
        )
        return answer.status_code, speed

    with ThreadPoolExecutor(8) as pool:
        answers = list(pool.map(change, range(100, 116)))
    made = [speed for status, speed in answers if status == 200]
    assert len(made) == 1
    assert {status for status, _ in answers} == {200, 412}
    assert http.get(twin).json()["speed"] == made[0]


def test_a_twin_that_stands_still_is_sent_once(http, twin):
    http.patch(twin, json={"paused": True})
    tag = http.get(twin).headers["etag"]
    while http.get(twin, headers={"if-none-match": tag}).status_code != 304:  # its last lateness is told a moment later
        tag = http.get(twin).headers["etag"]
    http.patch(twin, json={"paused": False})
    again = http.get(twin, headers={"if-none-match": tag})
    assert (again.status_code, again.json()["state"]) == (200, "running")


def test_an_ended_twin_is_deleted_as_it_is_known(http):
    path = "/v1/twins/short"
    http.post("/v1/twins", json={"id": "short", "scenario": "S1", "at_end": "idle"})
    live = http.get(path).headers["etag"]
    http.post(f"{path}/stop")
    assert http.delete(path, headers={"if-match": live}).status_code == 412
    assert http.delete(path, headers={"if-match": http.get(path).headers["etag"]}).status_code == 204
