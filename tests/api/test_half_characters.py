"""Half a character (a lone surrogate) is refused wherever a text comes in; what was stored so is still listed."""

from __future__ import annotations

import json

import httpx
import pytest
import sqlalchemy as sa

from api.store.database import Database
from api.store.documents import read_json
from station import InputError, load_scenario
from station.texts import half_characters
from tests.api.conftest import RunningService
from tests.api.test_strict import BODIES, SCENARIO, _places, _with
from tests.warm import run_hrs

WORKERS = 0
HALF = "a\ud800"
PLAIN = {"name": "sur", "arrivals": {"kind": "uniform", "count": 2, "period_s": 100}}
CHANGES = {
    ("PUT", "/v1/scenarios/sur"): {**SCENARIO, "name": "sur", "about": "x"},
    ("PATCH", "/v1/twins/none"): {"controller": "logic"},
    ("POST", "/v1/twins/none/vehicles"): {"start_pressure_bar": 120.0},
    ("POST", "/v1/calibrations"): {"twin": "none"},
    ("POST", "/v1/twins/none/station"): {"calibration": "calibration-x"},
    ("POST", "/v1/certificates/verify"): {"format": "hrs-certificate", "claim": "x"},
    ("POST", "/v1/scenarios/vehicles"): SCENARIO,
    **{("POST", path): body for path, body in BODIES.items()},
}


def _containers(value, path=()):
    if isinstance(value, dict | list):
        if isinstance(value, dict):
            yield path
        for key, item in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _containers(item, (*path, key))


def _spoilt(body):
    """The body with half a character in each of its texts, and as a key in each of its objects."""
    for place, value in _places(body):
        if isinstance(value, str):
            yield _with(body, place, value + HALF)
    for place in _containers(body):
        yield _with(body, (*place, HALF), 1)


def _texts_of_people(scenario):
    """The same scenario with texts that are read by nobody but people."""
    yield {**scenario, "about": HALF}
    for name in ("about", "source", "name"):
        yield {**scenario, "station": {"preset": "thesis-fit", name: HALF}}


def _ask(http, method, path, body):
    return http.request(method, path, content=json.dumps(body), headers={"content-type": "application/json"})


def test_no_text_and_no_key_of_a_body_may_hold_one(http):
    asked, taken = 0, []
    for (method, path), body in CHANGES.items():
        for spoilt in _spoilt(body):
            asked += 1
            answer = _ask(http, method, path, spoilt)
            told = [error["message"] for error in answer.json().get("errors", [])]
            if answer.status_code != 422 or not any("half a character" in message for message in told):
                taken.append((method, path, spoilt, answer.status_code, told))
    assert asked > 60
    assert taken == []


def test_texts_for_people_are_refused_wherever_a_scenario_is_taken(http):
    for scenario in _texts_of_people(PLAIN):
        for method, path, body in (
            ("PUT", "/v1/scenarios/sur", scenario),
            ("POST", "/v1/scenarios/resolve", scenario),
            ("POST", "/v1/runs", {"scenario": scenario, "controller": "logic"}),
            ("POST", "/v1/comparisons", {"scenarios": ["S1", scenario], "controllers": ["logic"]}),
            ("POST", "/v1/twins", {"scenario": scenario, "id": "half"}),
        ):
            answer = _ask(http, method, path, body)
            assert (answer.status_code, answer.json()["type"]) == (422, "urn:hrs-twin:problem:invalid"), path
    assert http.get("/v1/scenarios").status_code == 200
    assert http.get("/v1/scenarios/sur").status_code == 404


@pytest.mark.parametrize(
    "content",
    [
        json.dumps({**PLAIN, "about": HALF}, ensure_ascii=False).encode("utf-8", "surrogatepass"),
        json.dumps({**PLAIN, "about": HALF}, ensure_ascii=False).encode("utf-16-le", "surrogatepass"),
        json.dumps({**PLAIN, "about": HALF}).encode("utf-16"),
        json.dumps({**PLAIN, "about": "\ude00\ud83d"}).encode(),
        json.dumps({**PLAIN, "about": HALF}).replace("ud800", "uD800").encode(),
    ],
)
def test_it_may_come_in_no_other_way(http, content):
    answer = http.put("/v1/scenarios/sur", content=content, headers={"content-type": "application/json"})
    assert answer.status_code == 422, answer.text


def test_whole_characters_are_kept_however_they_are_written(http):
    for name, about in (("smile", "\U0001f600"), ("path", "C:\\ud800"), ("nul", "a\u0000b")):
        for ascii_only in (True, False):
            content = json.dumps({**PLAIN, "name": name, "about": about}, ensure_ascii=ascii_only).encode()
            answer = http.put(f"/v1/scenarios/{name}", content=content, headers={"content-type": "application/json"})
            assert answer.status_code in {200, 201}, answer.text
        assert http.get(f"/v1/scenarios/{name}").json()["about"] == about
        http.delete(f"/v1/scenarios/{name}")


@pytest.mark.parametrize(
    "path", ["/v1/scenarios/%ED%A0%80", "/v1/twins/%ED%A0%80", "/v1/runs/%ED%A0%80", "/v1/runs/%00"]
)
def test_a_path_may_not_hold_one(http, path):
    assert http.get(path).status_code == 404


def test_queries_and_headers_may_not_hold_one(http):
    for path in (
        "/v1/runs?state=%ED%A0%80",
        "/v1/runs?%ED%A0%80=1",
        "/v1/controllers/logic/certificate?options=%ED%A0%80",
    ):
        assert http.get(path).status_code in {404, 422}, path
    headers = {"content-type": "application/json", "idempotency-key": b"\xed\xa0\x80"}
    assert http.post("/v1/runs", content=b'{"scenario": "S1"}', headers=headers).status_code == 422
    assert http.get("/v1/scenarios/S1", headers={"if-none-match": b'"\xed\xa0\x80"'}).status_code in {200, 422}


def _spoil(database_url, **columns):
    """As an earlier version has stored it: `about me` with half a character, in these columns of tables."""
    database = Database(database_url)
    text = "REPLACE({0}, :old, :new)" if database.sqlite else "CAST(REPLACE(CAST({0} AS TEXT), :old, :new) AS JSON)"
    with database.engine.execution_options(hrs_writes=True).begin() as connection:
        for table, names in columns.items():
            changes = ", ".join(f"{name} = {text.format(name)}" for name in names)
            connection.execute(
                sa.text(f"UPDATE {table} SET {changes}"),  # noqa: S608
                {"old": "about me", "new": "about \\ud800me"},
            )
    database.close()


@pytest.mark.slow
def test_what_is_stored_so_is_listed_and_read(tmp_path, database_url):
    running = RunningService(tmp_path, "--workers", "0", HRS_DATABASE=database_url)
    try:
        with httpx.Client(base_url=running.url, timeout=30, trust_env=False) as client:
            scenario = {**PLAIN, "about": "about me"}
            assert client.put("/v1/scenarios/sur", json=scenario).status_code == 201
            assert client.post("/v1/twins", json={"id": "sur", "scenario": scenario}).status_code == 201
            assert client.post("/v1/runs", json={"scenario": scenario, "controller": "logic"}).status_code == 202
            _spoil(database_url, scenarios=("about", "document"), twins=("settings",), jobs=("spec",))
            listed = client.get("/v1/scenarios")
            assert listed.status_code == 200
            assert [each["about"] for each in listed.json() if each["name"] == "sur"] == ["about ?me"]
            for path in ("/v1/scenarios/sur", "/v1/twins", "/v1/twins/sur", "/v1/twins/sur/scenario", "/v1/runs"):
                assert client.get(path).status_code == 200, path
    finally:
        running.stop()


@pytest.mark.slow
def test_no_database_minds_a_nul(tmp_path, postgres_url):
    running = RunningService(tmp_path, "--workers", "0", HRS_DATABASE=postgres_url)
    try:
        with httpx.Client(base_url=running.url, timeout=30, trust_env=False) as client:
            for (method, path), body in CHANGES.items():
                for place, value in _places(body):
                    if isinstance(value, str):
                        answer = client.request(method, path, json=_with(body, place, value + "\0"))
                        assert answer.status_code < 500, (path, place, answer.text)
            scenario = {**PLAIN, "about": "a\0b"}
            assert client.put("/v1/scenarios/sur", json=scenario).is_success
            for path in ("/v1/scenarios", "/v1/twins", "/v1/runs", "/v1/comparisons", "/v1/keys", "/v1/certificates"):
                assert client.get(path).status_code == 200, path
            for path in ("/v1/twins/%00", "/v1/runs/%00", "/v1/scenarios/%00", "/v1/twins/%00/events"):
                assert 400 <= client.get(path).status_code < 500, path
            assert 400 <= client.delete("/v1/keys/%00").status_code < 500
    finally:
        running.stop()


def test_a_stored_document_can_always_be_written():
    assert read_json('{"a": ["\\ud800", "\\ud83d\\ude00"], "\\udc00": 1}') == {"a": ["?", "\U0001f600"], "?": 1}
    assert read_json(b'["C:\\\\ud800"]') == ["C:\\ud800"]


def test_each_place_is_named():
    document = {"a": [1, {"b": HALF}], HALF: HALF}
    found = dict(half_characters(json.dumps(document), document))
    assert set(found) == {"a.1.b", "a\\ud800"}


@pytest.mark.slow
def test_a_file_may_not_hold_one(service, tmp_path):
    for scenario in _texts_of_people(PLAIN):
        path = tmp_path / "sur.json"
        path.write_text(json.dumps(scenario))
        with pytest.raises(InputError, match="half a character"):
            load_scenario(path)
    question = tmp_path / "question.json"
    question.write_text(json.dumps({**BODIES["/v1/certificates"], "ask": HALF}))
    for command in (
        ("scenarios", "put", "sur", path, "--url", service.url),
        ("scenarios", path),
        ("simulate", path),
        ("submit", path, "--url", service.url),
        ("certify", question),
    ):
        done = run_hrs(*command)
        assert (done.returncode, "Traceback" in done.stderr) == (2, False), done.stderr
        assert "half a character" in done.stderr, command


@pytest.mark.slow
def test_an_argument_may_not_hold_one(service):
    for command in (
        ("scenarios", "get", b"sur\xff", "--url", service.url),
        ("scenarios", "put", b"sur\xff", "S1", "--url", service.url),
        ("scenarios", "delete", b"sur\xff", "--url", service.url),
        ("submit", b"sur\xff", "--url", service.url),
        ("keys", "create", b"sur\xff"),
    ):
        done = run_hrs(*command)
        assert (done.returncode, "Traceback" in done.stderr) == (2, False), (command, done.stderr)
