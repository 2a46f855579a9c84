"""REST as a program sees it: a service in a process of its own, asked over HTTP."""

from __future__ import annotations

import csv
import io
import json
import time
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from api.comparisons.service import as_document, compare
from controllers import create
from station import Record, load_scenario, simulate
from station.metrics import UNITS
from tests.api.conftest import ended

S1 = load_scenario("S1")
MINE = {"name": "mine", "arrivals": {"kind": "uniform", "count": 1, "period_s": 9}}
NOBODY = {"kind": "uniform", "count": 0, "period_s": 9}
RECORD = simulate(S1, create("minlp1", horizon=2))


@pytest.fixture(scope="module")
def run(http):
    answer = http.post("/v1/runs", json={"scenario": "S1", "controller": "minlp1:horizon=2"})
    assert answer.status_code == 202
    assert answer.headers["location"] == f"/v1/runs/{answer.json()['id']}"
    return ended(http, answer.headers["location"])


def _problem(answer, status):
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    problem = answer.json()
    assert problem["status"] == status
    assert problem["type"].startswith("urn:hrs-twin:problem:")
    return problem


def test_a_run_has_the_figures_of_the_same_run_here(run):
    assert run["state"] == "succeeded"
    assert run["metrics"] == dict(RECORD.metrics())
    assert (run["scenario"], run["station"], run["controller"]) == ("S1", "thesis-fit", "minlp1:horizon=2")


def test_series_as_parquet_are_the_record_bit_for_bit(http, run):
    content = http.get(run["series"], params={"format": "parquet"}).content
    assert Record.from_parquet(content).to_bytes() == RECORD.to_bytes()


def test_series_as_json_and_csv_carry_every_digit(http, run):
    query = {"columns": "pressure_high,pressure_vehicle,vehicle"}
    table = http.get(run["series"], params=query).json()
    assert table["units"] == {"time": "s", "pressure_high": "bar", "pressure_vehicle": "bar", "vehicle": "index"}
    rows = list(csv.DictReader(io.StringIO(http.get(run["series"], params={**query, "format": "csv"}).text)))
    for name in table["units"]:
        expected = RECORD[name]
        as_json = np.array([np.nan if figure is None else figure for figure in table["columns"][name]])
        as_csv = np.array([float(row[name]) if row[name] else np.nan for row in rows])
        np.testing.assert_array_equal(as_json, expected)
        np.testing.assert_array_equal(as_csv, expected)


def test_series_by_time_and_step_take_the_row_that_holds(http, run):
    table = http.get(run["series"], params={"columns": "mass_low", "from_s": 100.5, "to_s": 200, "step_s": 2.5}).json()
    times = np.array(table["columns"]["time"])
    np.testing.assert_array_equal(times, np.arange(100.5, 200.1, 2.5))
    np.testing.assert_array_equal(table["columns"]["mass_low"], RECORD["mass_low"][np.floor(times).astype(int)])
    part = http.get(
        run["series"], params={"columns": "mass_low", "from_s": 10, "to_s": 19, "format": "parquet"}
    ).content
    read = pq.read_table(io.BytesIO(part))
    np.testing.assert_array_equal(read["mass_low"].to_numpy(), RECORD["mass_low"][10:20])
    assert read.schema.field("mass_low").metadata[b"unit"] == b"g"


def test_vehicles_of_a_run(http, run):
    table = http.get(f"/v1/runs/{run['id']}/vehicles").json()
    np.testing.assert_array_equal(table["columns"]["finished"], RECORD.vehicles["finished"])


def test_runs_are_listed_newest_first_in_pages(http, run):
    ids = [http.post("/v1/runs", json={"scenario": "S1", "seed": seed}).json()["id"] for seed in range(3)]
    for one in ids:
        ended(http, f"/v1/runs/{one}")
    first = http.get("/v1/runs", params={"limit": 2}).json()
    assert [item["id"] for item in first["items"]] == ids[:0:-1]
    then = http.get("/v1/runs", params={"limit": 2, "cursor": first["next"], "state": "succeeded"}).json()
    assert [item["id"] for item in then["items"]] == [ids[0], run["id"]]
    assert then["items"][1]["metrics"] == run["metrics"]
    assert http.delete(f"/v1/runs/{ids[0]}").status_code == 204
    _problem(http.get(f"/v1/runs/{ids[0]}"), 404)


def test_a_comparison_gives_what_the_command_line_gives(http):
    request = {"scenarios": ["S1", "S2"], "controllers": ["logic", "minlp1"], "replications": 3, "seed": 4}
    answer = http.post("/v1/comparisons", json=request)
    path = answer.headers["location"]
    assert answer.json()["runs"] == 12
    job = ended(http, path)
    assert (job["state"], job["runs_done"]) == ("succeeded", 12)
    here = compare([S1, load_scenario("S2")], ["logic", "minlp1"], replications=3, seed=4)
    assert http.get(f"{path}/results").json() == json.loads(json.dumps(as_document(here)))
    rows = list(csv.DictReader(io.StringIO(http.get(f"{path}/results", params={"format": "csv"}).text)))
    assert [float(row["t_comp"]) for row in rows] == [result.metrics.t_comp for result in here]
    assert set(rows[0]) == {"scenario", "controller", "replication", "seed", *UNITS}
    table = http.get(f"{path}/table").json()
    assert [item["title"].split()[2] for item in table["tables"]] == ["S1:", "S2:"]
    assert [row["origin"] for row in table["tables"][0]["rows"]][:3] == ["mean of 3", "std dev", "thesis"]


def test_an_inline_scenario_runs_and_is_checked(http):
    given = http.get("/v1/scenarios/S1").json()
    given["name"] = "mine"
    given["arrivals"]["count"] = 2
    job = http.post("/v1/runs", json={"scenario": given}).json()
    assert ended(http, f"/v1/runs/{job['id']}")["metrics"]["vehicles"] == 2
    short = {"name": "short", "station": "thesis-fit-a", "arrivals": {"kind": "uniform", "count": 1, "period_s": 10}}
    resolved = http.post("/v1/scenarios/resolve", json=short).json()
    assert resolved["station"]["name"] == "thesis-fit-a"
    assert http.post("/v1/scenarios/resolve", json=resolved).json() == resolved


def test_vehicles_are_those_the_simulator_draws(http):
    for replication, seed in ((0, 0), (3, 7)):
        query = {"replication": replication, "seed": seed}
        found = http.post("/v1/scenarios/vehicles", json="S2", params=query).json()
        drawn = load_scenario("S2").vehicles(replication, seed)
        assert found["units"]["volume"] == "m3"
        assert list(found["columns"]) == list(drawn._fields)
        assert all(found["columns"][name] == getattr(drawn, name).tolist() for name in drawn._fields)
    refused = http.post("/v1/scenarios/vehicles", json={"name": "no station"})
    assert refused.status_code == 422


def test_a_trace_is_read_as_from_a_file(http, tmp_path):
    text = (Path(__file__).parents[2] / "docs" / "examples" / "day.csv").read_text()
    arrivals = http.post("/v1/scenarios/trace", json={"csv": text}).json()
    file = tmp_path / "day.csv"
    file.write_text(text)
    assert arrivals == load_scenario(file).arrivals.model_dump(mode="json")
    for wrong, field in (("", "line 1"), ("time_s,start_pressure_bar\n1,x", "line 2, start_pressure_bar")):
        answer = http.post("/v1/scenarios/trace", json={"csv": wrong})
        assert answer.status_code == 422
        assert answer.json()["errors"][0]["field"] == field
    assert http.post("/v1/scenarios/trace", json={"csv": "time_s,start_pressure_bar\n"}).status_code == 422


@pytest.mark.parametrize(
    ("change", "field", "says"),
    [
        ({"scenario": "S9"}, "scenario", "there are S1, S2, S3, S4"),
        ({"scenario": "/etc/passwd"}, "scenario", "no scenario is called"),
        ({"scenario": "../day.csv"}, "scenario", "no scenario is called"),
        ({"controller": "nobody"}, "controller", "none is called 'nobody'"),
        ({"controller": "minlp1:horizon=11"}, "controller", "at most 10 (setting horizon_max); given 11"),
        ({"controller": "minlp1:speed=3"}, "controller", "Extra inputs"),
        ({"replication": -1}, "replication", "greater than or equal to 0; given -1"),
        ({"extra": 1}, "extra", "Extra inputs"),
        ({"scenario": MINE | {"arrivals": NOBODY}}, "scenario.arrivals.uniform.count", "or equal to 1; given 0"),
        ({"scenario": MINE | {"time_limit_s": 7e5}}, "scenario.time_limit_s", "duration_max_s"),
    ],
)
def test_wrong_input_names_field_value_and_limit(http, change, field, says):
    problem = _problem(http.post("/v1/runs", json={"scenario": "S1", **change}), 422)
    assert any(error["field"] == field and says in error["message"] for error in problem["errors"]), problem


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"scenarios": []}, "scenarios"),
        ({"scenarios": ["S1", "S1"]}, "scenarios"),
        ({"controllers": ["logic", "x"]}, "controllers.1"),
        ({"replications": 10_001}, "replications"),
        ({"replications": 0}, "replications"),
    ],
)
def test_wrong_comparisons_are_refused(http, change, field):
    problem = _problem(http.post("/v1/comparisons", json={"scenarios": ["S1"], **change}), 422)
    assert field in [error["field"] for error in problem["errors"]]


def test_everything_else_that_is_wrong_is_a_problem_too(http, run):
    _problem(http.get("/v1/nothing"), 404)
    _problem(http.get("/v1/runs/run-0"), 404)
    _problem(http.get(f"/v1/comparisons/{run['id']}"), 404)
    _problem(http.put("/v1/runs"), 405)
    assert http.put("/v1/runs").headers["allow"] == "GET, POST"
    _problem(http.post("/v1/runs", content="{", headers={"content-type": "application/json"}), 422)
    _problem(http.get(run["series"], params={"columns": "pressure"}), 422)
    _problem(http.get(run["series"], params={"from_s": 9, "to_s": 8}), 422)
    _problem(http.get(run["series"], params={"step_s": 1e-9}), 422)
    _problem(http.get(run["series"], params={"format": "xlsx"}), 422)
    _problem(http.get("/v1/runs", headers={"host": "elsewhere.example"}), 421)


def test_bodies_have_a_limit_with_and_without_a_length(http):
    large = b'{"scenario": "' + b"x" * 5_000_000 + b'"}'
    headers = {"content-type": "application/json"}
    for content in (large, iter([large[:3_000_000], large[3_000_000:]])):
        problem = _problem(http.post("/v1/runs", content=content, headers=headers), 413)
        assert "body_bytes_max" in problem["detail"]


def test_a_long_run_can_be_cancelled_and_has_no_series(http):
    slow = {"scenario": "S4", "controller": "minlp1:horizon=10:node_limit=1000000000"}
    path = http.post("/v1/runs", json=slow).headers["location"]
    _problem(http.get(f"{path}/series"), 409)
    _problem(http.delete(path), 409)
    assert http.post(f"{path}/cancel").json()["state"] == "cancelled"
    assert http.delete(path).status_code == 204


def test_scenarios_stations_and_controllers_are_listed(http):
    assert [item["name"] for item in http.get("/v1/scenarios").json()] == ["S1", "S2", "S3", "S4"]
    stations = [item["name"] for item in http.get("/v1/stations").json()]
    assert http.get(f"/v1/stations/{stations[0]}").json()["name"] == stations[0]
    found = {item["name"]: item for item in http.get("/v1/controllers").json()}
    assert set(found) >= {"logic", "minlp1", "minlp2", "minlp3"}
    assert found["minlp1"]["options"]["properties"]["horizon"]["maximum"] == 20
    for path in ("scenarios", "stations", "controllers"):
        _problem(http.get(f"/v1/{path}/none"), 404)


BOUNDS = {"minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum"}
WITH_UNIT = ("s", "bar", "m3", "c", "kw", "h")


def test_openapi_tells_unit_range_and_example_of_every_field(http):
    document = http.get("/openapi.json").json()
    lacking = []
    for name, schema in document["components"]["schemas"].items():
        for field, about in schema.get("properties", {}).items():
            where = f"{name}.{field}"
            if "const" in about:
                continue
            if "description" not in about:
                lacking.append(f"{where}: description")
            if not about.get("examples") and "example" not in about:
                lacking.append(f"{where}: example")
            numbers = [kind for kind in [about, *about.get("anyOf", [])] if kind.get("type") in ("number", "integer")]
            if numbers and not any(BOUNDS & set(kind) for kind in numbers):
                lacking.append(f"{where}: range")
            if numbers and field.rsplit("_", 1)[-1] in WITH_UNIT and "unit" not in json.dumps(about):
                lacking.append(f"{where}: unit")
    assert lacking == []
    for path, operations in document["paths"].items():
        for method, operation in operations.items():
            assert "application/problem+json" in operation["responses"]["default"]["content"], (method, path)
            assert "422" not in operation["responses"]


@pytest.mark.slow
def test_a_twin_is_started_operated_and_read(http):
    request = {"id": "rest", "scenario": "S1", "controller": "minlp1", "speed": 500, "at_end": "stop"}
    answer = http.post("/v1/twins", json=request)
    assert answer.status_code == 201
    assert answer.headers["location"] == "/v1/twins/rest"
    _problem(http.post("/v1/twins", json=request), 409)
    _problem(http.delete("/v1/twins/rest"), 409)
    while http.get("/v1/twins/rest").json()["state"] != "finished":
        time.sleep(0.05)
    record = simulate(S1, create("minlp1"))
    content = http.get("/v1/twins/rest/history", params={"format": "parquet"}).content
    read = pq.read_table(io.BytesIO(content))
    assert read.schema.field("pressure_high").metadata[b"unit"] == b"bar"
    for name in record.columns:
        np.testing.assert_array_equal(read[name].to_numpy(), record[name])
    query = {"columns": "mass_low", "from_s": 100, "to_s": 200, "step_s": 50, "format": "csv"}
    lines = http.get("/v1/twins/rest/history", params=query).text.splitlines()
    assert lines[0] == '"time","mass_low"'
    assert [line.split(",")[0] for line in lines[1:]] == ["100", "150", "200"]
    kinds, after = [], -1
    while page := http.get("/v1/twins/rest/events", params={"after": after, "limit": 500}).json()["items"]:
        assert [event["seq"] for event in page] == list(range(after + 1, after + 1 + len(page)))
        kinds += [event["kind"] for event in page]
        after = page[-1]["seq"]
    assert kinds.count("fill_end") == 5
    assert (kinds[0], kinds[-1]) == ("started", "finished")
    _problem(http.patch("/v1/twins/rest", json={"paused": True}), 409)
    assert "rest" in [twin["id"] for twin in http.get("/v1/twins").json()["items"]]
    assert http.delete("/v1/twins/rest").status_code == 204
    for path in ("", "/history", "/events", "/stream"):
        _problem(http.get(f"/v1/twins/rest{path}"), 404)


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"speed": 0.5}, "speed"),
        ({"speed": "fast"}, "speed"),
        ({"id": "No Way"}, "id"),
        ({"at_end": "never"}, "at_end"),
        ({"controller": "nobody"}, "controller"),
        ({"scenario": "S9"}, "scenario"),
    ],
)
def test_wrong_twins_are_refused(http, change, field):
    problem = _problem(http.post("/v1/twins", json={"scenario": "S1", **change}), 422)
    assert field in [error["field"] for error in problem["errors"]], problem
