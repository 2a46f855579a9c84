"""Backup and restore: all of a database at one moment, into either kind of database, or nothing."""

from __future__ import annotations

import gzip
import json
import random
import threading

import httpx
import pytest
import sqlalchemy as sa

from api.store import backup as store
from api.store.backup import backup, restore
from api.store.database import Database, open_database
from api.store.jobs import JobRepository
from api.store.keys import KeyRepository
from api.store.notes import NoteRepository
from api.store.records import Checkpoint, Chunk, ChunkResult, JobKind, StoredNote, StoredScenario, Superseded
from api.store.scenarios import ScenarioRepository
from api.store.tables import metadata
from api.store.twins import TwinRepository
from station import InputError
from tests.api.conftest import RunningService, ended
from tests.warm import run_hrs


def _quiet(_done, _total):
    pass


def _all(database):
    """Every row of every table, in order."""
    with database.read() as connection:
        return {
            table.name: [tuple(row) for row in connection.execute(sa.select(table).order_by(*table.primary_key))]
            for table in metadata.sorted_tables
        }


def _fill(database):
    """Something in every table, with bytes, floats and words that are hard to carry."""
    KeyRepository(database).create('änn "quoted" \\ \U0001f698')
    jobs = JobRepository(database)
    job = jobs.add(JobKind.RUN, {"f": 0.1 + 0.2, "n": None, "s": "\u2028"}, {"seed": 2**53 + 1}, [Chunk(0, {}, 1)], 100)
    jobs.complete(
        jobs.claim("me", 60, 5), ChunkResult(b'[{"x":1}]', 1, (), bytes(range(256)) * 10, {0: bytes(range(256))})
    )
    jobs.add(JobKind.COMPARISON, {}, {}, [Chunk(k, {"k": k}, 1) for k in range(120)], 100)
    jobs.fail(jobs.claim("me", 60, 5), {"title": "no"})
    jobs.add(JobKind.CERTIFICATE, {}, {}, [Chunk(0, {}, 1)], 100)
    stored = StoredScenario("my-day", {"about": "\u2028"}, "d", 0.1 + 0.2)
    ScenarioRepository(database).put(stored, {"n": None, "f": 0.1 + 0.2}, 1, lambda _: None)
    twins = TwinRepository(database, "hrs")
    from tests.api.test_idempotency import _answer

    epoch = twins.add("demo", {"speed": 1}, _answer()).epoch
    twins.save("demo", epoch, Checkpoint("running", {}, b"\x00snap", 0, 9, b"PAR1", ({"seq": 0, "kind": "started"},)))
    twins.thin("demo", epoch, 0, 9, 1.5, b"PAR1")
    NoteRepository(database).add("demo", StoredNote("note-1", 0.1 + 0.2, None, "\u2028 \U0001f698", "me", 1.5))
    twins.save("demo", epoch, Checkpoint("running", {}, b"\x00snap", 9, 9, b"PAR1"))
    twins.measurements.append("demo", epoch, "plc \u2028", 2**53 + 1, "d" * 64, 3, bytes(range(256)))
    return job


@pytest.mark.slow
def test_what_was_backed_up_is_restored_to_the_letter(database, tmp_path):
    _fill(database)
    before = _all(database)
    assert all(before.values()), "a table without rows"
    file = tmp_path / "hrs.backup"
    told = []
    rows = backup(database, file, lambda *progress: told.append(progress))
    assert rows == {name: len(found) for name, found in before.items()}
    assert told[-1] == (sum(rows.values()),) * 2
    assert _all(database) == before
    assert (file.stat().st_mode & 0o777, [path.name for path in tmp_path.glob("*hrs*backup*")]) == (
        0o600,
        ["hrs.backup"],
    )
    with pytest.raises(InputError, match="is not empty; --replace"):
        restore(database, file, _quiet, replace=False)
    assert _all(database) == before
    TwinRepository(database, "hrs").open("demo")
    JobRepository(database).claim("me", 60, 5)
    restore(database, file, _quiet, replace=True)
    assert database.differences() == []
    after = _all(database)
    (twin,) = TwinRepository(database, "hrs").all()
    assert twin.epoch == 3  # behind the one that may still run
    for name, found in before.items():
        if name != "twins":
            assert after[name] == found, name
    with pytest.raises(Superseded):
        TwinRepository(database, "hrs").save("demo", 2, Checkpoint("running", {}, b"", 0, 0, None))


@pytest.mark.slow
def test_a_backup_of_one_database_is_restored_into_the_other(postgres_url, tmp_path):
    sqlite, postgres = Database(f"sqlite:///{tmp_path / 'a.db'}"), Database(postgres_url)
    third = Database(f"sqlite:///{tmp_path / 'b.db'}")
    sqlite.migrate()
    _fill(sqlite)
    sqlite_of = _all(sqlite)
    sqlite_of["chunks"] = [(*row[:7], None, 0.0) for row in sqlite_of["chunks"]]  # nobody holds a chunk any more
    for source, target in ((sqlite, postgres), (postgres, third)):
        file = tmp_path / "across"
        backup(source, file, _quiet)
        restore(target, file, _quiet, replace=False)
        assert target.differences() == []
        assert _all(target) == sqlite_of
    for database in (sqlite, postgres, third):
        database.close()


def test_an_older_backup_is_brought_to_this_version(database, tmp_path):
    _fill(database)
    file = tmp_path / "old"
    backup(database, file, _quiet)
    lines = [json.loads(line) for line in gzip.decompress(file.read_bytes()[store._HEAD :]).splitlines()]
    lines[0]["schema"] = "0001"
    later = ("idempotency_keys", "scenarios", "twin_minutes", "run_records", "measurements", "twin_notes")
    for table in later:
        del lines[0]["rows"][table]
        begin = next(n for n, line in enumerate(lines) if isinstance(line, dict) and line.get("table") == table)
        end = next((n for n, line in enumerate(lines) if n > begin and isinstance(line, dict)), len(lines))
        del lines[begin:end]
    begin = next(n for n, line in enumerate(lines) if isinstance(line, dict) and line.get("table") == "twins")
    place = lines[begin]["columns"].index("measured")  # of a later version, too
    del lines[begin]["columns"][place]
    for row in lines[begin + 1 : begin + 1 + lines[0]["rows"]["twins"]]:
        del row[place]
    _rewrite(file, lines)
    restore(database, file, _quiet, replace=True)
    assert database.differences() == []
    assert len(JobRepository(database).newest(JobKind.RUN)) == 1


def _rewrite(file, lines):
    """As if another version had written it."""
    file.write_bytes(bytes(store._HEAD) + gzip.compress(b"".join(store._line(line) for line in lines)))
    content = file.read_bytes()[store._HEAD :]
    file.write_bytes(store._MAGIC + store._digest(file) + b"\n" + content)


def test_what_cannot_be_restored_leaves_the_database_as_it_was(database, tmp_path):
    _fill(database)
    before = _all(database)
    file, wrong = tmp_path / "whole", tmp_path / "wrong"
    backup(database, file, _quiet)
    content = file.read_bytes()
    chance = random.Random(5)
    places = [0, 12, 25, store._HEAD - 1, store._HEAD, len(content) - 1, *chance.sample(range(len(content)), 40)]
    for place in places:
        wrong.write_bytes(content[:place] + bytes([content[place] ^ (1 << chance.randrange(8))]) + content[place + 1 :])
        with pytest.raises(InputError, match=r"damaged|no backup|another form"):
            restore(database, wrong, _quiet, replace=True)
    for length in (0, 10, store._HEAD, len(content) // 2, len(content) - 1):
        wrong.write_bytes(content[:length])
        with pytest.raises(InputError, match=r"damaged|no backup"):
            restore(database, wrong, _quiet, replace=True)
    lines = [json.loads(line) for line in gzip.decompress(content[store._HEAD :]).splitlines()]
    _rewrite(wrong, [{**lines[0], "schema": "9999"}, *lines[1:]])
    with pytest.raises(InputError, match="newer version of hrs"):
        restore(database, wrong, _quiet, replace=True)
    _rewrite(wrong, lines[:-1])
    with pytest.raises(InputError, match="rows are missing"):
        restore(database, wrong, _quiet, replace=True)

    def stop(done, _total):
        if done == 60:
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        restore(database, file, stop, replace=True)
    assert _all(database) == before
    with pytest.raises(ZeroDivisionError):
        backup(database, tmp_path / "half", stop)
    assert sorted(path.name for path in tmp_path.iterdir() if path.suffix not in {".db", ".db-wal", ".db-shm"}) == [
        "whole",
        "wrong",
    ]


@pytest.mark.slow
def test_a_service_is_backed_up_while_it_runs(database_url, tmp_path):
    """Work and twins go on, and what is backed up is one moment of them: every count agrees with its rows."""
    service = RunningService(tmp_path / "data", "--workers", "1", "--database", database_url)
    with httpx.Client(base_url=service.url, timeout=30, trust_env=False) as http:
        run = http.post("/v1/runs", json={"scenario": "S1"}).headers["location"]
        metrics = ended(http, run)["metrics"]
        http.post("/v1/twins", json={"id": "lives", "scenario": "S1", "speed": "max", "at_end": "repeat"})
        done = threading.Event()

        def work():
            while not done.is_set():
                httpx.post(service.url + "/v1/runs", json={"scenario": "S1"}, trust_env=False)

        worker = threading.Thread(target=work)
        worker.start()
        file = tmp_path / "hrs.backup"
        made = [run_hrs("backup", file, "--database", database_url) for _ in range(3)]
        done.set()
        worker.join()
    for one in made:
        assert one.returncode == 0, one.stderr
        assert f"tables written to {file}" in one.stderr
        assert one.stdout == ""
    service.stop()
    again = tmp_path / "again"
    restored = run_hrs("restore", file, "--data", again)
    assert restored.returncode == 0, restored.stderr
    refused = run_hrs("restore", file, "--data", again)
    assert refused.returncode == 2
    assert "--replace" in refused.stderr
    found = Database(f"sqlite:///{again / 'hrs.db'}")
    with found.read() as connection:
        for row in connection.execute(sa.text("SELECT id, runs_done FROM jobs")):
            count = connection.execute(
                sa.text("SELECT count(*) FROM results WHERE job_id = :id"), {"id": row.id}
            ).scalar()
            assert count == row.runs_done
        told = connection.execute(sa.text("SELECT events, samples FROM twins")).one()
        assert connection.execute(sa.text("SELECT count(*) FROM twin_events")).scalar() == told.events
        assert connection.execute(sa.text("SELECT sum(rows) FROM twin_segments")).scalar() == told.samples
    found.close()
    service = RunningService(again, "--workers", "1")
    try:
        with httpx.Client(base_url=service.url, timeout=30, trust_env=False) as http:
            assert http.get(run).json()["metrics"] == metrics
            assert http.get("/v1/twins/lives").json()["state"] == "running"
    finally:
        service.stop()


@pytest.mark.slow
def test_a_folder_is_made_for_what_is_restored(tmp_path):
    file, made = tmp_path / "hrs.backup", tmp_path / "new" / "folder"
    with open_database(f"sqlite:///{tmp_path / 'hrs.db'}") as database:
        database.migrate()
        backup(database, file, _quiet)
    restored = run_hrs("restore", file, "--data", made)
    assert restored.returncode == 0, restored.stderr
    with open_database(f"sqlite:///{made / 'hrs.db'}") as database:
        assert not database.outdated()


def test_a_file_that_cannot_be_is_named(tmp_path):
    for command in (("backup", tmp_path / "no" / "file"), ("restore", tmp_path / "none")):
        refused = run_hrs(*command, "--data", tmp_path)
        assert refused.returncode == 2
        assert str(command[1]) in refused.stderr
        assert "Traceback" not in refused.stderr
