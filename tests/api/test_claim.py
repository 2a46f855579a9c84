"""One server on a SQLite file; a file that has gone; a folder that cannot be made; a twin that runs elsewhere."""

from __future__ import annotations

import shutil

import httpx
import pytest

from api.store.claim import Claim
from station import InputError
from tests.api.conftest import RunningService
from tests.waiting import wait_until
from tests.warm import run_hrs


def _hrs(*arguments):
    done = run_hrs(*arguments)
    return done.returncode, done.stdout + done.stderr


def test_a_claim_is_one_servers_and_ends_with_it(tmp_path):
    file = tmp_path / "hrs.db"
    file.touch()
    first, second, other = Claim(file, "one"), Claim(file, "one"), Claim(file, "two")
    first.take()
    first.take()
    other.take()
    with pytest.raises(InputError, match="in use by another service"):
        second.take()
    first.release()
    second.take()
    assert not second.lost
    file.rename(tmp_path / "elsewhere")
    assert second.lost
    file.touch()  # another file at its place
    assert second.lost
    second.release()
    other.release()


@pytest.mark.slow
def test_a_second_service_is_refused_and_a_deleted_folder_is_told(tmp_path):
    service = RunningService(tmp_path / "data")
    try:
        status, said = _hrs("serve", "--port", "0", "--data", tmp_path / "data", "--zenoh-listen", "tcp/127.0.0.1:0")
        assert status == 2
        assert "in use by another service" in said
        with httpx.Client(base_url=service.url, trust_env=False, timeout=30) as http:
            assert http.post("/v1/runs", json={"scenario": "S1"}).status_code == 202
            shutil.rmtree(tmp_path / "data")
            refused = http.post("/v1/runs", json={"scenario": "S1"})
            assert (refused.status_code, refused.json()["title"]) == (503, "Database unavailable")
            wait_until(lambda: http.get("/readyz").status_code == 503)
            assert "moved or deleted" in http.get("/readyz").text
    finally:
        assert service.stop() < 10


@pytest.mark.parametrize("command", [["serve", "--port", "0"], ["keys", "list"], ["backup", "BACKUP"]])
def test_a_folder_that_cannot_be_made_is_an_error_in_words(tmp_path, command):
    file = tmp_path / "file"
    file.touch()
    words = [str(tmp_path / "a.backup") if word == "BACKUP" else word for word in command]
    status, said = _hrs(*words, "--data", file)
    assert status == 2
    assert "Traceback" not in said
    assert "error" in said


def test_a_backup_of_nothing_makes_nothing(tmp_path):
    status, said = _hrs("backup", tmp_path / "a.backup", "--data", tmp_path / "nowhere")
    assert status == 2
    assert "there is no database" in said
    assert list(tmp_path.iterdir()) == []


def test_a_twin_that_another_server_has_taken_is_not_shown_as_live_here(opened):
    from api.twins.schemas import TwinRequest
    from station import load_scenario

    one = opened()
    one.start(TwinRequest(id="demo", scenario=load_scenario("S1"), controller="logic", speed=10))
    other = opened()
    other.resume_all()
    wait_until(lambda: one.live("demo") is None)
    with pytest.raises(Exception, match="runs elsewhere now"):
        one.stop("demo")
    assert other.live("demo") is not None
