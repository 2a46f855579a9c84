"""Records of the runs of a comparison: kept as asked, read as a run's own, gone with it."""

from __future__ import annotations

import numpy as np
import pytest

from controllers import create
from station import Record, load_scenario, simulate
from tests.api.conftest import RunningService, ended
from tests.api.test_cli_service import hrs

SCENARIOS = ["S1", "S2"]
CONTROLLERS = ["logic", "minlp1:horizon=2"]
ASKED = {"scenarios": SCENARIOS, "controllers": CONTROLLERS, "replications": 3, "seed": 9}
RUNS = [(scenario, name, k) for scenario in SCENARIOS for name in CONTROLLERS for k in range(3)]


@pytest.fixture(scope="module")
def service(tmp_path_factory):
    running = RunningService(tmp_path_factory.mktemp("service"), HRS_RECORDS_MAX=str(len(RUNS)), HRS_WORKERS="2")
    yield running
    running.stop()


def _compared(http, **more):
    answer = http.post("/v1/comparisons", json={**ASKED, **more})
    assert answer.status_code == 202, answer.text
    path = answer.headers["location"]
    done = ended(http, path)
    assert (done["state"], done["runs_done"]) == ("succeeded", len(RUNS))
    return path, done


@pytest.mark.slow
def test_each_series_is_the_record_of_the_same_run_here(http):
    path, done = _compared(http, record="full")
    assert done["record"] == "full"
    rows = http.get(f"{path}/results").json()["results"]
    assert [(row["scenario"], row["controller"], row["replication"]) for row in rows] == RUNS
    for number, (scenario, controller, replication) in enumerate(RUNS):
        name, _, horizon = controller.partition(":horizon=")
        made = create(name, horizon=int(horizon)) if horizon else create(name)
        expected = simulate(load_scenario(scenario), made, replication=replication, seed=9)
        run = f"{path}/runs/{number}"
        answer = http.get(f"{run}/series", params={"format": "parquet"})
        assert answer.content == expected.parquet()
        assert Record.from_parquet(answer.content).to_bytes() == expected.to_bytes()
        table = http.get(f"{run}/vehicles").json()
        np.testing.assert_array_equal(
            np.array(table["columns"]["finished"], float), expected.vehicles["finished"]
        )  # fmt: skip
    part = http.get(f"{run}/series", params={"columns": "pressure_high", "from_s": 10, "to_s": 12, "format": "csv"})
    assert part.text.splitlines()[0] == '"time","pressure_high"'
    assert [line.partition(",")[0] for line in part.text.splitlines()[1:]] == ["10", "11", "12"]
    again = http.get(f"{run}/series", params={"format": "parquet"}, headers={"If-None-Match": answer.headers["etag"]})
    assert again.status_code == 304
    for beyond in (len(RUNS), 2**31 - 1):
        answer = http.get(f"{path}/runs/{beyond}/series")
        assert (answer.status_code, answer.json()["type"]) == (404, "urn:hrs-twin:problem:not-found")
    assert http.get(f"{path}/runs/{2**31}/series").status_code == 422
    assert http.delete(path).status_code == 204
    assert http.get(f"{run}/series").status_code == 404


@pytest.mark.slow
def test_what_is_not_kept_is_not_found(http, service):
    path, done = _compared(http)
    assert done["record"] == "none"
    for what in ("series", "vehicles"):
        answer = http.get(f"{path}/runs/0/{what}")
        assert (answer.status_code, answer.json()["type"]) == (404, "urn:hrs-twin:problem:not-kept")
        assert "record = none" in answer.json()["detail"]
    told = hrs(
        "submit", *SCENARIOS, "--controllers", ",".join(CONTROLLERS), "--replications", "3", "--record", "vehicles",
        HRS_URL=service.url,
    )  # fmt: skip
    assert told.returncode == 0, told.stderr
    path = f"/v1/comparisons/{told.stdout.strip()}"
    assert ended(http, path)["record"] == "vehicles"
    assert http.get(f"{path}/runs/11/vehicles").status_code == 200
    assert http.get(f"{path}/runs/11/series").json()["type"] == "urn:hrs-twin:problem:not-kept"


@pytest.mark.slow
def test_runs_that_were_not_done_have_no_record(http):
    path = http.post("/v1/comparisons", json={
        "scenarios": ["S3"], "controllers": ["minlp3:horizon=3"], "replications": 12, "record": "full",
    }).headers["location"]  # fmt: skip
    http.post(f"{path}/cancel").raise_for_status()
    answer = http.get(f"{path}/runs/11/series")
    assert (answer.status_code, answer.json()["type"]) == (409, "urn:hrs-twin:problem:conflict")


def test_more_records_than_the_limit_are_refused(http):
    for kept, status in (("full", 422), ("vehicles", 422), ("none", 202), ("some", 422)):
        answer = http.post("/v1/comparisons", json={**ASKED, "replications": 4, "record": kept})
        assert answer.status_code == status, answer.text
        if status == 422:
            assert answer.json()["errors"][0]["field"] == "record"
