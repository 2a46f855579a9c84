"""Bodies, queries, headers and streams beyond the document, on both databases; and those that once were a defect."""

from __future__ import annotations

import base64
import json

import httpx
import pytest

from tests.fuzz import bodies, streams
from tests.fuzz.rounds import rounds
from tests.fuzz.service import asking, fuzzed


@pytest.fixture(scope="module", params=["sqlite", "postgresql"])
def service(request, tmp_path_factory):
    """A service with a twin `fuzzed`."""
    database = request.getfixturevalue("module_postgres_url") if request.param == "postgresql" else None
    with fuzzed(tmp_path_factory.mktemp("requests"), database) as running, asking(running) as client:
        running.properties = bodies.properties(client) + streams.properties(client)
        yield running
        assert running.complaints() == []


@pytest.mark.slow
@rounds(60, 2000)
@pytest.mark.parametrize("place", range(3))
def test_whatever_is_asked_is_answered(service, place, cases, seed):
    assert service.properties[place].run(cases, seed) >= cases


def _cursor(*place):
    return base64.urlsafe_b64encode(json.dumps(place).encode()).decode().rstrip("=")


@pytest.mark.parametrize(
    ("path", "status"),
    [
        ("/v1/twins/fuzzed/events?after=" + "9" * 30, 422),
        (f"/v1/twins/fuzzed/events?cursor={_cursor(10**30)}", 422),
        (f"/v1/runs?cursor={_cursor(1.0, chr(0xD800))}", 422),
        (f"/v1/runs?cursor={_cursor(1.0, chr(0))}", 422),
        (f"/v1/twins?cursor={_cursor(float('inf'), 'x')}", 422),
        ("/v1/twins/fuzzed/history?step_s=inf", 422),
        ("/v1/runs/%00", 400),
    ],
)
def test_what_no_database_holds_is_the_askers_fault(service, path, status):
    answer = httpx.get(service.url + path, timeout=60, trust_env=False)
    assert status <= answer.status_code < 500, answer.text


@pytest.mark.parametrize("name", ["\x00", "\x1b[2J", "a\nb"])
def test_a_key_is_not_named_in_control_characters(service, name):
    answer = httpx.post(f"{service.url}/v1/keys", json={"name": name}, timeout=60, trust_env=False)
    assert (answer.status_code, answer.json()["errors"][0]["field"]) == (422, "name")
