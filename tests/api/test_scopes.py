"""What keys may do: every request needs a scope, and a key without it gets nothing."""

from __future__ import annotations

import httpx
import pytest
from fastapi import APIRouter

from api.http.authorization import RequiredScopes, requires
from api.scopes import Scope, allows
from api.server.app import RESOURCES, create_app
from api.settings import Settings
from tests.api.conftest import RunningService
from tests.api.here import hrs

OPERATIONS = {
    ("POST", "/v1/twins"), ("PATCH", "/v1/twins/{twin_id}"), ("DELETE", "/v1/twins/{twin_id}"),
    ("POST", "/v1/twins/{twin_id}/stop"), ("POST", "/v1/twins/{twin_id}/vehicles"),
    ("POST", "/v1/twins/{twin_id}/station"), ("POST", "/v1/twins/{twin_id}/alarms/{name}"),
    ("POST", "/v1/twins/{twin_id}/drills"), ("DELETE", "/v1/twins/{twin_id}/drills"),
    ("POST", "/v1/twins/{twin_id}/notes"), ("DELETE", "/v1/twins/{twin_id}/notes/{note_id}"),
    ("PUT", "/v1/twins/{twin_id}/shadow"), ("DELETE", "/v1/twins/{twin_id}/shadow"),
}  # fmt: skip
RUNS = {"/v1/twins/{twin_id}/forecasts"}
"""What computes and changes nothing of a twin."""

MEASURES = {("POST", "/v1/twins/{twin_id}/measurements")}
ASKED = {
    ("POST", "/v1/scenarios/resolve"), ("POST", "/v1/scenarios/vehicles"), ("POST", "/v1/scenarios/trace"),
    ("POST", "/v1/certificates/verify"),
}  # fmt: skip


@pytest.mark.slow
def test_every_request_needs_the_scope_of_what_it_does(tmp_path):
    app = create_app(Settings(data=tmp_path))
    required, seen = RequiredScopes(RESOURCES), set()
    for path, methods in app.openapi()["paths"].items():
        for method in (name.upper() for name in methods):
            if path.startswith("/v1/keys"):
                wanted = Scope.ADMIN
            elif method == "GET" or (method, path) in ASKED:
                wanted = Scope.READ
            elif (method, path) in MEASURES:
                wanted = Scope.MEASURE
            else:
                wanted = Scope.OPERATE if (method, path) in OPERATIONS else Scope.RUN
                assert wanted is Scope.OPERATE or not path.startswith("/v1/twins") or path in RUNS, (method, path)
            assert required.of(method, path) is wanted, (method, path)
            seen.add((method, path))
    assert seen >= OPERATIONS | MEASURES | ASKED
    app.state.services.database.close()
    app.state.services.twins.close()


def test_a_route_that_changes_something_declares_its_scope():
    router = APIRouter(prefix="/v1/things")

    @router.post("/{name}/undeclared")
    def undeclared(name: str) -> None:
        pass

    with pytest.raises(TypeError, match="undeclared declares no scope"):
        RequiredScopes([router])
    router.routes.clear()

    @router.post("/{name}/declared")
    @requires(Scope.OPERATE)
    def declared(name: str) -> None:
        pass

    required = RequiredScopes([router])
    assert required.of("POST", "/v1/things/a/declared") is Scope.OPERATE
    assert {required.of(method, "/v1/things/a") for method in ("GET", "HEAD", "POST")} == {Scope.READ}


@pytest.mark.parametrize("held", Scope)
@pytest.mark.parametrize("wanted", Scope)
def test_each_scope_includes_reading_and_admin_everything(held, wanted):
    assert allows([held], wanted) == (held in {wanted, Scope.ADMIN} or wanted is Scope.READ)
    assert not allows([], wanted)


@pytest.fixture(scope="module")
def guarded(tmp_path_factory):
    """A service that asks for keys, and a key of each scope."""
    folder = tmp_path_factory.mktemp("guarded")

    def made(scope):
        return hrs("keys", "create", scope, "--scope", scope, "--data", folder).stdout.strip()

    keys = {scope: made(scope) for scope in Scope}
    running = RunningService(folder, "--host", "0.0.0.0")  # noqa: S104  # what needs the keys
    yield running, keys
    running.stop()


def _ask(guarded, scope, method, path, **more):
    running, keys = guarded
    headers = {"Authorization": f"Bearer {keys[scope]}"}
    return httpx.request(method, running.url + path, headers=headers, trust_env=False, timeout=30, **more)


@pytest.mark.slow
def test_a_key_does_what_it_may_and_nothing_else(guarded):
    wanted = {
        Scope.READ: ("GET", "/v1/runs", {}, 200),
        Scope.RUN: ("POST", "/v1/runs", {"json": {"scenario": "S1"}}, 202),
        Scope.OPERATE: ("POST", "/v1/twins", {"json": {"scenario": "S1", "paused": True}}, 201),
        Scope.ADMIN: ("GET", "/v1/keys", {}, 200),
    }
    for scope, (method, path, more, good) in wanted.items():
        for held in Scope:
            answer = _ask(guarded, held, method, path, **more)
            if allows([held], scope):
                assert answer.status_code == good, (held, path, answer.text)
            else:
                problem = answer.json()
                assert (answer.status_code, problem["type"]) == (403, "urn:hrs-twin:problem:scope")
                assert f"needs the scope {scope}" in problem["detail"]
    assert _ask(guarded, Scope.READ, "GET", "/v1/twins").json()["items"]


def test_keys_are_made_and_revoked_over_rest(guarded):
    made = _ask(guarded, Scope.ADMIN, "POST", "/v1/keys", json={"name": "screen", "scopes": ["read"]})
    assert made.status_code == 201
    headers = {"Authorization": f"Bearer {made.json()['key']}"}
    runs = guarded[0].url + "/v1/runs"
    assert httpx.get(runs, headers=headers, trust_env=False).status_code == 200
    assert _ask(guarded, Scope.ADMIN, "POST", "/v1/keys", json={"name": "screen"}).status_code == 409
    wrong = _ask(guarded, Scope.ADMIN, "POST", "/v1/keys", json={"name": "x", "scopes": ["all"]})
    assert wrong.json()["errors"][0]["field"] == "scopes.0"
    listed = _ask(guarded, Scope.ADMIN, "GET", "/v1/keys")
    assert {each["name"]: each["scopes"] for each in listed.json()}["screen"] == ["read"]
    assert made.json()["key"] not in listed.text
    assert _ask(guarded, Scope.ADMIN, "DELETE", "/v1/keys/screen").status_code == 204
    assert httpx.get(runs, headers=headers, trust_env=False).status_code == 401
    assert _ask(guarded, Scope.ADMIN, "DELETE", "/v1/keys/screen").status_code == 404
