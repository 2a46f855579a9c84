"""Bodies that would stop the service: none holds it up, none is answered by more than 64 kB."""

from __future__ import annotations

import io
import json
import threading
import time

import httpx
import numpy as np
import pyarrow as pa
import pytest
from fastapi.routing import APIRoute
from pyarrow import parquet

from api.http.bodies import JsonRoute, check_structure
from api.http.problems import ProblemError
from api.server.app import create_app
from api.settings import Settings
from tests.pace import slowness
from tests.stalls import Stalls

ANSWER_MAX = 64_000
VEHICLE = {"time_s": 1.0, "start_pressure_bar": 120.5, "volume_m3": 0.14, "finish_pressure_bar": 690.0}


def _run(vehicles):
    arrivals = {"kind": "trace", "vehicles": vehicles}
    scenario = {"name": "x", "about": "x", "arrivals": arrivals, "time_limit_s": 600_000.0}
    return {"scenario": scenario, "controller": "logic"}


def _trace(count, **more):
    return _run([{**VEHICLE, "time_s": float(k), **more} for k in range(count)])


def _question(matrix, modes=1, **constraint):
    given = constraint or {"kind": "dwell", "tau": 2}
    return {"ask": "stability", "modes": [{"A": matrix}] * modes, "constraint": given}


def _packed_table(rows):
    table = pa.table({"tag": ["a"] * rows, "time": np.zeros(rows), "value": np.zeros(rows)})
    stream = io.BytesIO()
    parquet.write_table(table, stream, compression="zstd")
    return stream.getvalue()


def _unknown():
    return {f"k{k}": 1 for k in range(210_000)}


FLOODS = {
    "unknown keys": lambda: json.dumps(_unknown()),
    "unknown keys in objects": lambda: json.dumps({f"k{i}": {f"l{j}": 1 for j in range(200)} for i in range(999)}),
    "long keys": lambda: json.dumps({f"{k}" + "\u0001" * 100_000: 1 for k in range(6)}),
    "wrong vehicles": lambda: json.dumps(_trace(20_000, start_pressure_bar="x", volume_m3=-1)),
    "vehicles with unknown keys": lambda: json.dumps(_trace(1000, **{f"k{k}": 1 for k in range(200)})),
    "numbers": lambda: "[" + "1," * 1_999_990 + "1]",
    "controllers": lambda: json.dumps({"scenarios": ["S1"], "controllers": [1] * 240_000}),
    "scenarios": lambda: json.dumps({"scenarios": [{}] * 120_000, "controllers": ["logic"]}),
    "wrong matrices": lambda: json.dumps(_question([[None] * 15] * 15, modes=999)),
    "edges": lambda: json.dumps(
        _question([["0.5"]], kind="graph", edges=[[[], [], []]] * 19_000, initial=[[]] * 19_000)
    ),
    "nested": lambda: "[" * 1_900_000 + "]" * 1_900_000,
    "digits": lambda: '{"scenario": "S1", "seed": ' + "9" * 3_900_000 + "}",
    "numbers of 4200 digits": lambda: "[" + ",".join(["1" * 4200] * 900) + "]",
    "a long text": lambda: json.dumps({"scenario": "S1", "controller": "\u0001" * 600_000}),
    "escapes": lambda: '"' + '\\"' * 1_900_000,
    "lines of a trace": lambda: json.dumps({"csv": "time_s,start_pressure_bar\n" + "x,y\n" * 700_000}),
    "columns of a trace": lambda: json.dumps({"csv": "a," * 1_900_000}),
}
"""Bodies of nearly 4 MB, or with as many errors as can be."""


MEASUREMENTS = "/v1/twins/{twin_id}/measurements"


def _rows():
    return [{"tag": f"T-{n % 30}", "time": float(n // 30), "value": 1.0, "quality": "good"} for n in range(40_000)]


MEASURED_FLOODS = {
    "rows": ("application/json", lambda: json.dumps(_rows()).encode()),
    "lines": ("application/x-ndjson", lambda: "\n".join(map(json.dumps, _rows())).encode()),
    "empty lines": ("application/x-ndjson", lambda: b"{}\n" * 1_200_000),
    "columns": ("text/csv", lambda: b"tag,time,value\n" + b"a,0,1\n" * 650_000),
    "wrong columns": ("text/csv", lambda: b"tag,time,value\n" + b"a,x,y\n" * 650_000),
    "quotes": ("text/csv", lambda: b"tag,time,value\n" + b'"' * 3_900_000),
    "a wide head": ("text/csv", lambda: b"a," * 1_900_000),
    "a table that unpacks to much": ("application/vnd.apache.parquet", lambda: _packed_table(3_000_000)),
    "no table": ("application/vnd.apache.parquet", lambda: b"PAR1" + b"\xff" * 3_900_000 + b"PAR1"),
} | {
    name: ("application/json", lambda name=name: FLOODS[name]().encode())
    for name in ("unknown keys", "numbers", "nested", "digits")
}
"""Bodies of nearly 4 MB where measurements are read."""


class Prober:
    """Asks /livez again and again; the longest wait [s]."""

    def __init__(self, url):
        self._url, self._ending, self.worst, self.asked = url, threading.Event(), 0.0, 0
        self._thread = threading.Thread(target=self._ask)

    def _ask(self):
        with httpx.Client(base_url=self._url, timeout=30, trust_env=False) as http:
            while not self._ending.wait(0.005):
                began = time.perf_counter()
                assert http.get("/livez").status_code == 200
                self.worst = max(self.worst, time.perf_counter() - began)
                self.asked += 1

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_error):
        self._ending.set()
        self._thread.join()


def _commands(http):
    paths = http.get("/openapi.json").json()["paths"]
    return [(path, method) for path, methods in paths.items() for method in methods if method != "get"]


@pytest.mark.timed
@pytest.mark.parametrize("flood", FLOODS)
def test_no_body_stops_the_service_or_is_answered_at_length(http, service, flood):
    content = FLOODS[flood]().encode()
    assert len(content) < 4_000_000
    path = {"wrong matrices": "certificates", "edges": "certificates"}.get(flood, "runs")
    path = "comparisons" if flood in {"controllers", "scenarios"} else path
    path = "scenarios/trace" if "trace" in flood else path
    with Stalls() as stalls, Prober(service.url) as prober:
        answer = http.post(f"/v1/{path}", content=content, headers={"content-type": "application/json"})
    problem = answer.json()
    assert (answer.status_code, problem["type"]) == (422, "urn:hrs-twin:problem:invalid")
    assert len(answer.content) <= ANSWER_MAX
    assert len(problem.get("errors", ())) <= 20
    assert problem.get("errors") or "none of them are listed" in problem["detail"]
    assert prober.worst < 1.0 * slowness() + stalls.total, (
        prober.worst
    )  # 3.5 s, where all of it was done in the event loop


@pytest.mark.timed
@pytest.mark.parametrize("flood", MEASURED_FLOODS)
def test_no_measurements_stop_the_service_or_are_answered_at_length(http, service, measured_twin, flood):
    media, made = MEASURED_FLOODS[flood]
    content = made()
    assert len(content) < 4_000_000
    path = MEASUREMENTS.format(twin_id=measured_twin)
    with Stalls() as stalls, Prober(service.url) as prober:
        answer = http.post(f"{path}?source=a&sequence=0", content=content, headers={"content-type": media})
    problem = answer.json()
    assert 400 <= answer.status_code < 500, problem
    assert len(answer.content) <= ANSWER_MAX
    assert len(problem.get("errors", ())) <= 20
    assert prober.worst < 1.0 * slowness() + stalls.total, prober.worst


@pytest.mark.slow
def test_every_command_bounds_what_it_reads_and_answers(http):
    content = json.dumps(_unknown()).encode()
    headers = {"content-type": "application/json"}
    for path, method in _commands(http):
        answer = http.request(method, path.replace("{", "").replace("}", ""), content=content, headers=headers)
        assert answer.status_code < 500, path
        assert len(answer.content) <= ANSWER_MAX, path


@pytest.mark.slow
def test_every_route_with_a_body_reads_it_beside_the_event_loop(tmp_path):
    app = create_app(Settings(data=tmp_path))

    def routes(router):
        for route in router.routes:
            if isinstance(route, APIRoute):
                yield route
            elif (inner := getattr(route, "original_router", None)) is not None:
                yield from routes(inner)

    with_body = [route for route in routes(app) if route.body_field is not None]
    reads_itself = {route.path for route in routes(app) if "requestBody" in (route.openapi_extra or {})}
    bodies = [
        operation for methods in app.openapi()["paths"].values() for operation in methods.values()
        if "requestBody" in operation
    ]  # fmt: skip
    assert len(with_body) + len(reads_itself) == len(bodies) > 8
    assert all(isinstance(route, JsonRoute) for route in with_body)
    assert reads_itself == {MEASUREMENTS}, "a body of other types than JSON has floods of its own, as measurements have"
    app.state.services.database.close()
    app.state.services.twins.close()


def test_errors_are_counted_and_twenty_are_listed(http):
    problem = http.post("/v1/runs", json={"scenario": "S1", **{f"k{k}": 1 for k in range(50)}}).json()
    assert (problem["detail"], len(problem["errors"])) == ("50 fields are wrong; 20 of them are listed", 20)
    few = http.post("/v1/runs", json={"scenario": "S1", "a": 1, "b": 2}).json()
    assert (few["detail"], len(few["errors"])) == ("2 fields are wrong", 2)


@pytest.mark.timed
def test_a_day_of_twenty_thousand_vehicles_is_taken(http, service):
    with Prober(service.url) as prober:
        made = http.post("/v1/runs", json=_trace(20_000))
        resolved = http.post("/v1/scenarios/resolve", json=_trace(20_000)["scenario"])
    assert made.status_code == 202
    assert len(resolved.json()["arrivals"]["vehicles"]) == 20_000
    http.post(f"{made.headers['location']}/cancel")
    assert prober.worst < 1.0


def test_a_wrong_vehicle_far_behind_is_named(http):
    body = _trace(20_000)
    body["scenario"]["arrivals"]["vehicles"][17_003]["volume_m3"] = -1
    problem = http.post("/v1/runs", json=body).json()
    assert [error["field"] for error in problem["errors"]] == ["scenario.arrivals.trace.vehicles.17003.volume_m3"]


@pytest.mark.parametrize("path", ["/v1/runs/" + "x" * 60_000, "/v1/twins/" + "%00" * 20_000, "/" + "y" * 60_000])
def test_long_addresses_are_answered_shortly(http, path):
    for method in ("GET", "POST", "PROPFIND"):
        answer = http.request(method, path)
        assert 400 <= answer.status_code < 500
        assert len(answer.content) <= ANSWER_MAX
    assert len(http.get("/v1/runs", params={"cursor": "x" * 50_000, "limit": "9" * 5_000}).content) <= ANSWER_MAX


def test_what_is_in_texts_does_not_count_as_structure():
    settings = Settings(body_values_max=1000, body_depth_max=16)
    text = json.dumps({"csv": '[{,"\\' * 5_000}).encode()
    check_structure(text, settings)
    check_structure(b"[" * 16 + b"]" * 16, settings)
    check_structure(b"[" + b"[]," * 400 + b"[]]", settings)
    for beyond in (b"[" * 17, b"[" + b"1," * 1000 + b"1]", b'"\\\\"' + b"[" * 17, b"[" + b'"",' * 1000 + b'""]'):
        with pytest.raises(ProblemError):
            check_structure(beyond, settings)


@pytest.mark.parametrize("content", [b"{", b"\xff", b'{"scenario": "\\ud800"}', b"nul", b"[]]", b'{"\\ud800": 1}'])
def test_what_is_no_json_is_refused(http, content):
    answer = http.post("/v1/runs", content=content, headers={"content-type": "application/json"})
    assert (answer.status_code, answer.json()["type"]) == (422, "urn:hrs-twin:problem:invalid")
