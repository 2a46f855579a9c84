"""A key that reads starts nothing, whatever operation of the OpenAPI document it is used for, with whatever body."""

from __future__ import annotations

import httpx
import pytest

from tests.fuzz.service import Fuzzed
from tests.waiting import wait_until


@pytest.fixture(scope="module")
def guarded(tmp_path_factory):
    running = Fuzzed(tmp_path_factory.mktemp("guarded"), guarded=True)
    yield running
    running.stop()


def _asking(service, scope):
    headers = {"authorization": f"Bearer {service.keys[scope]}"}
    return httpx.Client(base_url=service.url, headers=headers, timeout=60, trust_env=False)


@pytest.fixture(scope="module")
def things(guarded):
    """One of everything there is, by the parameter of a path that names it."""
    with _asking(guarded, "admin") as admin:
        day = {"name": "mine", "arrivals": {"kind": "uniform", "count": 1, "period_s": 9}}
        assert admin.put("/v1/scenarios/mine", json=day).status_code == 201
        made = {
            "run_id": admin.post("/v1/runs", json={"scenario": "S1"}).json()["id"],
            "comparison_id": admin.post("/v1/comparisons", json={"scenarios": ["S1"], "controllers": ["logic"]}).json()[
                "id"
            ],
            "certificate_id": admin.post(
                "/v1/certificates",
                json={"ask": "stability", "modes": [{"A": [["0.5"]]}], "constraint": {"kind": "dwell", "tau": 1}},
            ).json()["id"],
            "twin_id": admin.post("/v1/twins", json={"id": "t", "scenario": "S1", "paused": True}).json()["id"],
            "calibration_id": "calibration-x",
            "forecast_id": "forecast-x",
            "note_id": admin.post("/v1/twins/t/notes", json={"time_s": 0, "text": "seen"}).json()["id"],
            "name": "mine",
        }
        paths = [f"/v1/{kind}s/{made[f'{kind}_id']}" for kind in ("run", "comparison", "certificate")]
        wait_until(lambda: all(admin.get(path).json()["finished"] for path in paths))
    return made


def _state(guarded):
    """All that there is, but for what passes by itself."""
    with _asking(guarded, "admin") as admin:
        found = {
            path: admin.get(path).json()
            for path in (
                "/v1/runs",
                "/v1/comparisons",
                "/v1/certificates",
                "/v1/calibrations",
                "/v1/forecasts",
                "/v1/twins",
                "/v1/twins/t/notes",
                "/v1/twins/t/shadow",
                "/v1/twins/t/drills",
            )
        }
        found |= {path: admin.get(path).json() for path in ("/v1/scenarios", "/v1/keys")}
        found["certificate"] = admin.get("/v1/controllers/logic/certificate/state").json()
    return found


def _bodies(operation):
    """Bodies of an operation: that of the document, none, and an empty one."""
    content = operation.get("requestBody", {}).get("content", {})
    found = [None, {}]
    for each in content.values():
        found += [each["example"]] if "example" in each else each["schema"].get("examples", [])
    return found


def test_no_operation_starts_or_changes_anything(guarded, things):
    before = _state(guarded)
    document = httpx.get(f"{guarded.url}/openapi.json", timeout=30, trust_env=False).json()
    asked, refused = 0, set()
    with _asking(guarded, "read") as reader:
        for path, operations in document["paths"].items():
            for method, operation in operations.items():
                if path.endswith("/stream"):
                    continue
                for name in ("mine", "logic") if "{name}" in path else ("",):
                    place = path.format(**{**things, "name": name, "number": 0})
                    for body in _bodies(operation):
                        for headers in ({}, {"idempotency-key": f"k{asked}"}, {"x-http-method-override": "POST"}):
                            answer = reader.request(method.upper(), place, json=body, headers=headers)
                            asked += 1
                            if method != "get" and answer.status_code == 403:
                                assert answer.json()["type"] == "urn:hrs-twin:problem:scope"
                                refused.add((method, path))
    changing = {
        (method, path) for path, operations in document["paths"].items() for method in operations
        if method != "get" and not path.startswith(("/v1/scenarios/resolve", "/v1/scenarios/vehicles"))
        and path not in {"/v1/scenarios/trace", "/v1/certificates/verify"}
    }  # fmt: skip
    assert refused == changing
    assert asked > 300
    assert _state(guarded) == before
