"""Scenarios of users: stored by name, changed safely, and used as they were when something was submitted."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor

import httpx
import pytest

from api.store.records import CapacityError, StoredScenario
from api.store.scenarios import ScenarioRepository
from tests.api.conftest import RunningService, ended

DAY = {"name": "my-day", "about": "a day of mine", "arrivals": {"kind": "uniform", "count": 2, "period_s": 300}}
PLACE = "/v1/scenarios/my-day"


def _problem(answer, status, kind):
    assert (answer.status_code, answer.json()["type"]) == (status, f"urn:hrs-twin:problem:{kind}"), answer.text
    return answer.json()


@pytest.fixture
def stored(http):
    """The day as the service has it, and its tag."""
    http.delete(PLACE)
    made = http.put(PLACE, json=DAY)
    assert (made.status_code, made.headers["location"]) == (201, PLACE)
    yield made.json(), made.headers["etag"]
    http.delete(PLACE)


def test_a_scenario_is_stored_whole_listed_and_read_again(http, stored):
    whole, tag = stored
    assert whole["station"]["compressor"]["count"] == 1
    read = http.get(PLACE)
    assert (read.json(), read.headers["etag"]) == (whole, tag)
    assert http.get(PLACE, headers={"if-none-match": tag}).status_code == 304
    listed = {item["name"]: item for item in http.get("/v1/scenarios").json()}
    assert [name for name, item in listed.items() if item["origin"] == "shipped"] == ["S1", "S2", "S3", "S4"]
    mine = listed["my-day"]
    assert (mine["origin"], mine["about"], mine["station"], mine["vehicles"]) == ("own", DAY["about"], "thesis-fit", 2)
    assert mine["changed"].endswith("Z")
    assert listed["S1"]["changed"] is None
    assert http.post("/v1/scenarios/resolve", json="my-day").json() == whole
    assert http.post("/v1/scenarios/vehicles", json="my-day").json()["columns"]["arrival"] == [0, 300]


def test_a_list_stays_small_whatever_is_stored(http):
    long = {**DAY, "name": "long", "about": 500_000 * "x"}
    assert http.put("/v1/scenarios/long", json=long).status_code == 201
    assert len(http.get("/v1/scenarios").content) < 4_000
    assert http.get("/v1/scenarios/long").json()["about"] == long["about"]
    assert http.delete("/v1/scenarios/long").status_code == 204


def test_it_is_replaced_only_as_it_is_known(http, stored):
    whole, tag = stored
    assert http.put(PLACE, json=whole, headers={"if-match": tag}).headers["etag"] == tag
    changed = http.put(PLACE, json={**DAY, "about": "another"}, headers={"if-match": tag})
    assert changed.status_code == 200
    assert changed.headers["etag"] != tag
    assert "location" not in changed.headers
    for held in ({"if-match": tag}, {"if-none-match": "*"}, {"if-match": f"W/{changed.headers['etag']}"}):
        _problem(http.put(PLACE, json=DAY, headers=held), 412, "changed")
    _problem(http.delete(PLACE, headers={"if-match": tag}), 412, "changed")
    assert http.get(PLACE).json()["about"] == "another"
    assert http.delete(PLACE, headers={"if-match": changed.headers["etag"]}).status_code == 204
    for held in ({"if-match": "*"}, {"if-match": tag}):
        _problem(http.put(PLACE, json=DAY, headers=held), 412, "changed")
        _problem(http.delete(PLACE, headers=held), 412, "changed")
    _problem(http.delete(PLACE), 404, "not-found")
    _problem(http.get(PLACE), 404, "not-found")
    assert http.put(PLACE, json=DAY, headers={"if-none-match": "*"}).status_code == 201


def test_of_many_that_replace_one_state_one_succeeds(service, http, stored):
    def replace(number):
        return httpx.put(
            service.url + PLACE, json={**DAY, "about": f"day {number}"}, headers={"if-match": stored[1]}, timeout=30,
            trust_env=False,
        ).status_code  # fmt: skip

    with ThreadPoolExecutor(8) as pool:
        statuses = sorted(pool.map(replace, range(16)))
    assert statuses == [200] + 15 * [412]


@pytest.mark.parametrize(
    ("name", "status", "kind"),
    [
        ("S1", 409, "conflict"), ("s3", 409, "conflict"), ("resolve", 422, "invalid"), ("a%20day", 422, "invalid"),
        ("day.toml", 422, "invalid"), ("%C3%A4", 422, "invalid"), ("x" * 65, 422, "invalid"), ("-x", 422, "invalid"),
    ],
)  # fmt: skip
def test_names_that_ship_or_are_none_are_refused(http, name, status, kind):
    plain = httpx.URL(f"http://x/{name}").path[1:]
    _problem(http.put(f"/v1/scenarios/{name}", json={**DAY, "name": plain[:64]}), status, kind)
    assert http.delete(f"/v1/scenarios/{name}").status_code in {404, status}


def test_the_name_in_the_document_is_that_of_the_path(http):
    problem = _problem(http.put(PLACE, json={**DAY, "name": "other"}), 422, "invalid")
    assert problem["errors"] == [{"field": "name", "message": 'must be "my-day", as in the path; given "other"'}]


@pytest.mark.slow
def test_what_was_submitted_keeps_its_scenario(http, stored):
    run = http.post("/v1/runs", json={"scenario": "my-day"}).headers["location"]
    both = http.post("/v1/comparisons", json={"scenarios": ["my-day", "S1"], "controllers": ["logic"]})
    twin = http.post("/v1/twins", json={"id": "of-my-day", "scenario": "my-day", "paused": True})
    assert twin.status_code == 201, twin.text
    http.put(PLACE, json={**DAY, "arrivals": {"kind": "uniform", "count": 9, "period_s": 900}})
    later = http.post("/v1/runs", json={"scenario": "my-day"}).headers["location"]
    http.delete(PLACE)
    assert ended(http, run)["state"] == "succeeded"
    assert len(http.get(f"{run}/vehicles").json()["columns"]["arrival"]) == 2
    assert ended(http, later)["state"] == "succeeded"
    assert len(http.get(f"{later}/vehicles").json()["columns"]["arrival"]) == 9
    place = both.headers["location"]
    assert ended(http, place)["state"] == "succeeded"
    assert [item["arrivals"]["count"] for item in http.get(f"{place}/scenarios").json()] == [2, 5]
    assert http.get("/v1/twins/of-my-day/scenario").json() == stored[0]
    http.post("/v1/twins/of-my-day/stop")
    http.delete("/v1/twins/of-my-day")


def test_the_same_request_again_is_answered_though_its_scenario_has_gone(http, stored):
    key = {"idempotency-key": f"stored-{time.time()}"}
    first = http.post("/v1/runs", json={"scenario": "my-day"}, headers=key)
    http.delete(PLACE)
    again = http.post("/v1/runs", json={"scenario": "my-day"}, headers=key)
    assert (again.status_code, again.content) == (202, first.content)


@pytest.mark.parametrize("name", ["my-dya", "../S1", "", "x\u0000y", "S5"])
def test_a_name_that_nothing_has_is_told_with_what_there_is(http, stored, name):
    requests = {
        "/v1/runs": ({"scenario": name}, "scenario"),
        "/v1/comparisons": ({"scenarios": ["S1", name], "controllers": ["logic"]}, "scenarios.1"),
        "/v1/twins": ({"scenario": name}, "scenario"),
    }
    for path, (body, field) in requests.items():
        problem = _problem(http.post(path, json=body), 422, "invalid")
        (error,) = problem["errors"]
        assert error["field"] == field
        assert error["message"].startswith("no scenario is called ")
        assert "S1, S2, S3, S4" in error["message"]
        assert ("my-day" in error["message"]) == (name == "my-dya")


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A service that stores two scenarios of a few kilobytes."""
    limits = {"HRS_SCENARIOS_MAX": "2", "HRS_SCENARIO_BYTES_MAX": "6000"}
    running = RunningService(tmp_path_factory.mktemp("small"), "--workers", "0", **limits)
    yield running
    running.stop()


def test_there_are_only_so_many_and_only_so_large_ones(small):
    with httpx.Client(base_url=small.url, timeout=30, trust_env=False) as http:
        day = [{"time_s": time, "start_pressure_bar": 100} for time in range(200)]
        large = {**DAY, "arrivals": {"kind": "trace", "vehicles": day}}
        problem = _problem(http.put(PLACE, json=large), 413, "body-too-large")
        assert "scenario_bytes_max" in problem["detail"]
        with ThreadPoolExecutor(6) as pool:
            answers = pool.map(lambda name: http.put(f"/v1/scenarios/{name}", json={**DAY, "name": name}), "abcdef")
            statuses = [answer.status_code for answer in answers]
        assert sorted(statuses) == [201, 201] + 4 * [429]
        mine = [item["name"] for item in http.get("/v1/scenarios").json() if item["origin"] == "own"]
        assert len(mine) == 2
        assert http.put(f"/v1/scenarios/{mine[0]}", json={**DAY, "name": mine[0], "about": "new"}).status_code == 200


def _entry(name, digest="a"):
    return StoredScenario(name, {"about": ""}, digest, 1.0)


def test_what_is_checked_holds_until_it_is_written(database):
    """Eight at once on an empty store with room for three; then eight that each replace what they have seen."""
    store = ScenarioRepository(database)

    def put(number):
        try:
            return store.put(_entry(f"s{number}"), {}, 3, lambda held: None)
        except CapacityError:
            return None

    with ThreadPoolExecutor(8) as pool:
        assert sorted(map(str, pool.map(put, range(8)))) == 5 * ["None"] + 3 * ["True"]
        name = store.all()[0].name

        def replace(number):
            def check(held):
                if held.digest != "a":
                    raise ZeroDivisionError

            try:
                return store.put(_entry(name, f"b{number}"), {"n": number}, 3, check)
            except ZeroDivisionError:
                return None

        assert sorted(map(str, pool.map(replace, range(8)))) == ["False"] + 7 * ["None"]
    entry, document = store.get(name)
    assert entry.digest == f"b{document['n']}"
    assert store.remove(name, lambda held: None)
    assert not store.remove(name, lambda held: None)
    assert store.get(name) is None
