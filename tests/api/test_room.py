"""A budget for the disk: what no longer fits is refused before anything is lost, and what was accepted is stored."""

from __future__ import annotations

import secrets

import httpx
import pytest
import sqlalchemy as sa

from api.store import size as store_size
from api.store.database import Database
from api.store.records import StoreFull
from api.store.size import Size, StoreRoom, measure
from tests.api.conftest import RunningService, ended
from tests.waiting import wait_until

LIMIT = 20_000_000


@pytest.fixture
def service(tmp_path):
    running = RunningService(tmp_path, HRS_STORE_BYTES_MAX=str(LIMIT), HRS_WORKERS="1")
    yield running
    running.stop()


def _submit(http, seed, **more):
    body = {"scenario": "S3", "controller": "logic", "seed": seed, **more}
    return http.post("/v1/runs", json=body, headers={"Idempotency-Key": f"run-{seed}"})


@pytest.mark.slow
def test_a_store_at_its_limit_refuses_new_work_and_keeps_what_was_accepted(service):
    with httpx.Client(base_url=service.url, timeout=30, trust_env=False) as http:
        http.post("/v1/twins", json={"id": "t", "scenario": "S1", "at_end": "repeat"}).raise_for_status()
        first = _submit(http, 0)
        accepted = [first.json()["id"]]
        for seed in range(1, 60):
            answer = _submit(http, seed)
            if answer.status_code == 507:
                break
            accepted.append(answer.json()["id"])
            ended(http, f"/v1/runs/{accepted[-1]}")
        assert answer.status_code == 507
        assert answer.json()["type"] == "urn:hrs-twin:problem:store-full"
        assert f"store_bytes_max = {LIMIT}" in answer.json()["detail"]
        assert int(answer.headers["retry-after"]) > 0
        assert len(accepted) > 5
        assert {ended(http, f"/v1/runs/{job}")["state"] for job in accepted} == {"succeeded"}
        assert _submit(http, 0).content == first.content  # what was answered once is answered again
        for path, body in (
            ("/v1/comparisons", {"scenarios": ["S1"], "controllers": ["logic"]}),
            ("/v1/twins", {"id": "u", "scenario": "S1"}),
        ):
            assert http.post(path, json=body).status_code == 507
        assert http.get("/v1/twins/u").status_code == 404
        assert http.post("/v1/twins/t/vehicles", json={"start_pressure_bar": 99}).status_code == 201
        ready = http.get("/readyz")
        assert (ready.status_code, ready.json()["store"]["full"]) == (200, True)
        assert ready.json()["store"]["bytes"] >= LIMIT
        metrics = http.get("/metrics").text
        assert "hrs_store_bytes_max 2e+07" in metrics
        assert "hrs_store_disk_free_bytes" in metrics
        for job in accepted[1:]:
            http.delete(f"/v1/runs/{job}").raise_for_status()
        wait_until(lambda: _submit(http, 1000).status_code == 202)  # free pages do not count


def test_records_are_kept_as_asked(service):
    with httpx.Client(base_url=service.url, timeout=30, trust_env=False) as http:
        runs = {kept: _submit(http, seed, record=kept).json() for seed, kept in enumerate(("full", "vehicles", "none"))}
        for kept, run in runs.items():
            path = f"/v1/runs/{run['id']}"
            done = ended(http, path)
            assert (done["record"], done["metrics"]["vehicles"] > 0) == (kept, True)
            assert (done["series"] is not None) == (kept == "full")
            series, vehicles = http.get(f"{path}/series?step_s=9000"), http.get(f"{path}/vehicles")
            assert series.status_code == (200 if kept == "full" else 404)
            assert vehicles.status_code == (404 if kept == "none" else 200)
            if kept == "none":
                assert vehicles.json()["type"] == "urn:hrs-twin:problem:not-kept"
                assert "record = none" in series.json()["detail"]
        tables = [http.get(f"/v1/runs/{runs[kept]['id']}/vehicles").json() for kept in ("full", "vehicles")]
        assert tables[0]["columns"].keys() == tables[1]["columns"].keys()
        wrong = _submit(http, 9, record="some")
        assert (wrong.status_code, wrong.json()["errors"][0]["field"]) == (422, "record")


def test_a_disk_that_runs_out_is_refused_before_it_is_full(tmp_path, monkeypatch):
    database = Database(f"sqlite:///{tmp_path / 'hrs.db'}")
    database.migrate()
    room = StoreRoom(database, None, 10**6)
    assert room.full() == ""
    monkeypatch.setattr(store_size, "KEPT_S", 0.0)
    monkeypatch.setattr(store_size, "measure", lambda _: Size(10**12, 10**6 - 1))
    tight = StoreRoom(database, None, 10**6)
    with pytest.raises(StoreFull, match="disk_free_min_bytes = 1000000"):
        tight.check()
    database.close()


def test_a_store_that_does_not_tell_its_size_is_not_called_full(tmp_path, monkeypatch):
    database = Database(f"sqlite:///{tmp_path / 'hrs.db'}")
    room = StoreRoom(database, 1, 10**18)
    monkeypatch.setattr(database, "read", lambda: (_ for _ in ()).throw(store_size.StoreError("silent")))
    room.check()
    database.close()


def test_the_size_is_that_of_what_is_stored_and_free_pages_go_back_to_the_disk(database):
    empty = measure(database).used
    with database.write() as connection:
        heap = sa.Table("heap", sa.MetaData(), sa.Column("bytes", sa.LargeBinary))
        heap.create(connection)
        connection.execute(heap.insert(), [{"bytes": secrets.token_bytes(500_000)} for _ in range(40)])
    assert measure(database).used > empty + 19_000_000
    if not database.sqlite:
        return
    with database.write() as connection:
        connection.exec_driver_sql("DELETE FROM heap")
    with database.read() as connection:
        assert connection.exec_driver_sql("PRAGMA freelist_count").scalar() > 4000
    database.shrink()
    with database.read() as connection:
        assert connection.exec_driver_sql("PRAGMA freelist_count").scalar() == 0
        assert connection.exec_driver_sql("PRAGMA page_count").scalar() < 500
