"""Web pages of others in a real Chromium: whatever they send to the service, by whatever way, nothing is obeyed."""

from __future__ import annotations

import json
import re

import httpx
import pytest

from api.store.database import open_database
from api.store.keys import KeyRepository
from tests.api.conftest import RunningService, ended
from tests.api.page.foreign import elsewhere

LINE = re.compile(r"(GET|HEAD|POST|PUT|PATCH|DELETE|OPTIONS) (/\S*) (\d{3})\b")


@pytest.fixture(scope="module", params=["loopback", pytest.param("keys", marks=pytest.mark.slow)])
def attacked(request, tmp_path_factory):
    """A service with a log of requests, with and without keys, and a client that may do everything."""
    folder = tmp_path_factory.mktemp("attacked")
    options, headers = [], {}
    if request.param == "keys":
        with open_database(f"sqlite:///{folder / 'hrs.db'}") as database:
            database.migrate()
            headers["authorization"] = f"Bearer {KeyRepository(database).create('ann', ['admin'])}"
        options += ["--host", "0.0.0.0"]  # noqa: S104  # what needs the key
    service = RunningService(folder, *options, HRS_ACCESS_LOG="true", HRS_RATE_LIMIT_BURST="100000")
    with httpx.Client(base_url=service.url, timeout=30, trust_env=False, headers=headers) as http:
        yield service, http
    service.stop()


@pytest.fixture(scope="module")
def world(attacked):
    """Things to operate on, by the name of their path's parameter."""
    _, http = attacked
    twin = {"id": "demo", "scenario": "S1", "controller": "logic", "at_end": "repeat"}
    assert http.post("/v1/twins", json=twin).status_code == 201
    run = http.post("/v1/runs", json={"scenario": "S1"}).headers["location"]
    comparison = http.post("/v1/comparisons", json={"scenarios": ["S1"], "controllers": ["logic"]}).headers["location"]
    question = {"ask": "stability", "modes": [{"A": [["0.5"]]}], "constraint": {"kind": "dwell", "tau": 2}}
    certificate = http.post("/v1/certificates", json=question).headers["location"]
    for job in (run, comparison, certificate):
        ended(http, job)
    return {
        "twin_id": "demo",
        "run_id": run.rsplit("/", 1)[1],
        "comparison_id": comparison.rsplit("/", 1)[1],
        "certificate_id": certificate.rsplit("/", 1)[1],
    }


def _operations(document, world):
    """Every command of the API as (method, path, body), and every address that is read."""
    commands, addresses = [], []
    for path, methods in document["paths"].items():
        filled = re.sub(r"\{(\w+)\}", lambda name: world.get(name[1], "logic"), path)
        for method, about in methods.items():
            if method == "get":
                addresses.append(filled)
                continue
            content = about.get("requestBody", {}).get("content", {}).get("application/json", {})
            body = content.get("example", {})
            commands.append((method.upper(), filled, json.dumps(body)))
    return commands, addresses


def _state(http):
    """What commands would change."""
    jobs = {kind: http.get(f"/v1/{kind}").json() for kind in ("runs", "comparisons", "certificates")}
    twins = [
        {name: twin[name] for name in ("id", "state", "speed", "controller")}
        for twin in http.get("/v1/twins").json()["items"]
    ]
    twin = http.get("/v1/twins/demo/events?after=0&limit=1000").json()["items"]
    told = [event["kind"] for event in twin if event["kind"] in {"vehicle_added", "stopped", "speed_changed", "paused"}]
    states = [http.get(f"/v1/controllers/{name}/certificate/state").json() for name in ("logic", "minlp1")]
    keys = http.get("/v1/keys").json()
    return jobs, twins, told, states, keys


ORIGINS = {
    "another site": ("http://evil.localhost:{}/", "127.0.0.1", None),
    "the same host, another port": ("http://127.0.0.1:{}/", "127.0.0.1", None),
    "localhost, another port": ("http://localhost:{}/", "localhost", None),
    "localhost for 127.0.0.1": ("http://localhost:{}/", "127.0.0.1", None),
    "a sandboxed frame": ("http://127.0.0.1:{}/sandboxed", "127.0.0.1", "inner"),
}


ORDINARY = ("the same host, another port", "a sandboxed frame")
"""The nearest to the service's own, and the one without a name; the others with the slow tests."""


@pytest.mark.slow
@pytest.mark.parametrize(
    "origin", [name if name in ORDINARY else pytest.param(name, marks=pytest.mark.slow) for name in ORIGINS]
)
def test_no_foreign_page_operates_the_service(chromium, attacked, world, origin):
    service, http = attacked
    commands, addresses = _operations(http.get("/openapi.json").json(), world)
    assert len(commands) > 15
    before = _state(http)
    place, host, frame = ORIGINS[origin]
    context = chromium.new_context()
    with elsewhere() as port:
        page = context.new_page()
        page.goto(place.format(port))
        inside = page.frame(frame) if frame else page.main_frame
        inside.wait_for_function("() => Boolean(window.attack)")
        mark = len(service.said)
        base = f"http://{host}:{service.port}"
        given = [{"method": method, "url": base + path, "body": body} for method, path, body in commands]
        tried = inside.evaluate("([given, urls]) => attack(given, urls)", [given, [base + path for path in addresses]])
        context.close()
    assert tried > 10 * (len(commands) + len(addresses))
    came = [found.groups() for line in service.said[mark:] if (found := LINE.match(line))]
    opens = {"/", "/docs", "/openapi.json", "/livez", "/readyz"}
    obeyed = [each for each in came if each[2] not in {"403", "401", "421"} and each[1] not in opens]
    assert obeyed == []
    for method, path, _ in commands:
        ways = [each for each in came if each[1] == path and each[0] == method]
        assert len(ways) >= 8 or method != "POST", (path, len(ways))  # the attempts did arrive
    for path in set(addresses) - opens:
        assert len([each for each in came if each[:2] == ("GET", path)]) >= 6, path
    assert _state(http) == before


def test_the_user_may_follow_a_link_to_an_answer(chromium, attacked, world):
    service, http = attacked
    if "authorization" in http.headers:
        pytest.skip("a link carries no key")
    context = chromium.new_context()
    with elsewhere() as port:
        page = context.new_page()
        page.goto(f"http://evil.localhost:{port}/")
        with page.expect_navigation():
            page.evaluate("url => { location.href = url }", f"{service.url}/v1/twins/demo")
        assert '"id":"demo"' in page.content()
        for path in ("/", "/docs"):
            page.goto(f"http://evil.localhost:{port}/")
            page.evaluate("url => { location.href = url }", service.url + path)
            page.wait_for_url(service.url + path)
            assert page.title()
        context.close()
