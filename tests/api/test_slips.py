"""Slips of the pen are named with what they may have meant, in JSON's words; what is ambiguous is refused."""

from __future__ import annotations

import json

import httpx
import pytest

from api.http import authentication
from api.http.problems import in_json
from api.nearest import fields_beside, nearest
from api.scenarios.schemas import ScenarioInput
from api.server.app import create_app
from api.settings import Settings
from api.twins.schemas import TwinChange
from tests.waiting import awaited

MINE = {"name": "mine", "arrivals": {"kind": "uniform", "count": 2, "period_s": 60}}


@pytest.fixture(scope="module")
def app(tmp_path_factory):
    made = create_app(Settings(data=tmp_path_factory.mktemp("data"), workers=0))
    made.state.services.database.migrate()
    yield made
    made.state.services.twins.close()
    made.state.services.database.close()


@pytest.fixture(scope="module")
def asked(app):
    """Ask the application in this process."""

    def ask(method, path, **more):
        async def answer():
            transport = httpx.ASGITransport(app, raise_app_exceptions=False)
            async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as client:
                return await client.request(method, path, **more)

        return awaited(answer())

    return ask


def _wrong(answer):
    assert answer.status_code == 422, answer.text
    return {error["field"]: error["message"] for error in answer.json()["errors"]}


@pytest.mark.parametrize(
    ("method", "path", "field", "says"),
    [
        ("GET", "/v1/runs?limt=5", "limt", "the nearest is limit"),
        ("GET", "/v1/runs?limit=5&State=queued", "State", "the nearest is state"),
        ("GET", "/v1/runs/run-0/series?colums=time", "colums", "the nearest is columns"),
        ("GET", "/v1/runs/run-0/series?form=csv", "form", "the nearest is format"),
        ("GET", "/v1/twins/t/events?befor=7", "befor", "the nearest is before"),
        ("POST", "/v1/controllers/reserve/certificate?preset=thesis-fit", "preset", "the nearest is "),
        ("GET", "/v1/stations?limit=5", "limit", "it takes none"),
        ("DELETE", "/v1/runs/run-0?force=true", "force", "it takes none"),
    ],
)
def test_a_query_that_nothing_reads_is_refused(asked, method, path, field, says):
    wrong = _wrong(asked(method, path))
    assert list(wrong) == [field]
    assert says in wrong[field]


def test_probes_may_ask_with_what_they_like(asked):
    assert asked("GET", "/livez?at=7").status_code == 200
    assert asked("GET", "/?view=live").status_code == 200


@pytest.mark.parametrize(
    ("path", "body", "field", "near"),
    [
        ("/v1/runs", {"scenario": "S1", "contoller": "logic"}, "contoller", "controller"),
        ("/v1/runs", {"scenario": {**MINE, "communicaton": True}}, "scenario.communicaton", "communication"),
        (
            "/v1/runs", {"scenario": {**MINE, "arrivals": {**MINE["arrivals"], "periods": 6}}},
            "scenario.arrivals.uniform.periods", "period_s",
        ),
        ("/v1/comparisons", {"scenarios": [{**MINE, "abot": ""}]}, "scenarios.0.abot", "about"),
        ("/v1/certificates", {"ask": "stability", "modes": [{"A": [["0.5"]], "a": 1}], "constraint": {
            "kind": "dwell", "tau": 2, "tua": 3}}, "constraint.dwell.tua", "tau"),
        ("/v1/runs", {"scenario": "S1", "controller": "minlp1:horizn=2"}, "controller", "horizon"),
    ],
)  # fmt: skip
def test_an_unknown_name_is_told_with_its_nearest_neighbour(asked, path, body, field, near):
    assert _wrong(asked("POST", path, json=body))[field].endswith(f"; the nearest is {near}")


def test_neighbours_are_looked_for_in_every_alternative():
    assert "period_s" in fields_beside(ScenarioInput, ("arrivals", "what the union calls it", "x"))
    assert fields_beside(TwinChange, ("x",)) == {"speed", "controller", "paused"}
    assert fields_beside(int, ("x", "y")) == set()
    assert nearest("x", ()) == ""
    assert nearest("é" * 10_000_000, ["speed"]) == "; the nearest is speed"


@pytest.mark.parametrize(
    ("given", "said"), [(True, "true"), (None, "null"), ("two", '"two"'), (0.5, "0.5"), ("é'", '"é\'"')]
)
def test_what_was_given_is_said_as_json_writes_it(asked, given, said):
    wrong = _wrong(asked("POST", "/v1/runs", json={"scenario": "S1", "replication": given}))
    assert wrong["replication"].endswith(f"; given {said}")
    assert in_json(b"1") == "b'1'"


@pytest.mark.parametrize(
    ("content", "field"),
    [
        ('{"scenario": "S1", "seed": 1, "seed": 2}', "seed"),
        ('{"scenario": {"name": "mine", "arrivals": {"kind": "uniform", "kind": "poisson"}}}', "kind"),
        ('{"scenario": "S1", "s\\u0065ed": 1, "seed": 1}', "seed"),
    ],
)
def test_a_key_that_stands_twice_is_refused(asked, content, field):
    answer = asked("POST", "/v1/runs", content=content, headers={"content-type": "application/json"})
    assert _wrong(answer) == {field: "stands twice in an object"}


def test_two_hosts_are_refused_whichever_comes_first(asked):
    for hosts in (["127.0.0.1", "evil.example"], ["evil.example", "127.0.0.1"], ["127.0.0.1"] * 2):
        answer = asked("GET", "/v1/twins", headers=[("host", host) for host in hosts])
        assert (answer.status_code, answer.json()["type"]) == (400, "urn:hrs-twin:problem:malformed")


@pytest.mark.parametrize("path", ["/", "/docs", "/openapi.json", "/static/app.js"])
def test_what_can_be_read_has_a_head(asked, path):
    read, head = asked("GET", path), asked("HEAD", path)
    assert (head.status_code, head.headers["content-type"]) == (200, read.headers["content-type"])
    allowed = asked("POST", path, json={})
    assert allowed.status_code == 405
    assert "HEAD" in allowed.headers["allow"]


def test_bodies_together_are_bounded_and_the_room_is_given_back(app, asked, monkeypatch):
    def resolve(text):
        return asked("POST", "/v1/scenarios/resolve", json=text)

    found = next(each for each in _layers(app) if isinstance(each, authentication.AuthenticationMiddleware))
    assert found._held_max == authentication.BODIES_BYTES_MAX
    assert resolve("S1").status_code == 200
    assert found._held == 0
    monkeypatch.setattr(found, "_held_max", 100)
    monkeypatch.setattr(found, "_held", 60)
    answer = resolve("S1" + " " * 60)
    assert (answer.status_code, answer.json()["type"]) == (503, "urn:hrs-twin:problem:busy")
    assert int(answer.headers["retry-after"]) > 0
    assert resolve("S1").status_code == 200
    assert found._held == 60


def _layers(app):
    layer = app.middleware_stack
    while layer is not None:
        yield layer
        layer = getattr(layer, "app", None) or getattr(layer, "_app", None)


def test_a_certificate_of_service_is_not_begun_while_the_store_is_full(app, asked, monkeypatch):
    monkeypatch.setattr(app.state.services.room, "full", lambda: "the store takes too much")
    answer = asked("POST", "/v1/controllers/reserve/certificate")
    assert (answer.status_code, answer.json()["type"]) == (507, "urn:hrs-twin:problem:store-full")
    assert json.loads(asked("GET", "/v1/controllers/reserve/certificate/state").content)["state"] == "none"
