"""What the service says and stores when all is over."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Iterator
from http import HTTPStatus
from typing import Any

import httpx
import sqlalchemy as sa

from api.comparisons.service import compare
from api.runs.service import run
from api.store.database import Database, open_database
from api.store.tables import chunks, jobs, results
from api.telemetry.session import connect
from station import Scenario
from station.metrics import UNITS
from tests.nemesis.arena import PATIENCE_S, Arena, LostError, until
from tests.nemesis.checker import FINAL, Document, Evidence, canonical
from tests.nemesis.history import History
from tests.nemesis.operators import GUESTS, TWINS
from tests.warm import run_hrs

NAMED = ("time", "pressure_high", "mass_low", "inlet_low", "vehicle")
"""Columns that are asked for over REST, too."""


def gather(arena: Arena, history: History) -> Evidence:
    """Wait until every job has ended, then ask for everything; the twins have been stopped."""
    with (
        open_database(arena.database_url) as database,
        httpx.Client(base_url=arena.service.url, timeout=60, trust_env=False) as http,
    ):
        _wait(database)
        stored = _jobs(database)
        shown = {job: _job(http, job) for job in stored}
        runs = [job for job, about in shown.items() if job.startswith("run-") and about["state"] == "succeeded"]
        told = {twin: _replay(arena, twin) for twin in TWINS}
        return Evidence(
            jobs=shown,
            rows={job: _results(http, job, about) for job, about in shown.items()},
            series={job: _digest(_get(http, f"/v1/runs/{job}/series?format=parquet").content) for job in runs},
            expected=expected([entry["request"] for entry in history.of("asked")]),
            chunks={job: _chunks(database, job) for job in stored},
            samples={twin: samples for twin, (samples, _) in told.items()},
            columns={twin: _columns(http, twin) for twin in TWINS},
            epochs={twin: epochs for twin, (_, epochs) in told.items()},
            events={twin: list(_events(http, twin)) for twin in TWINS},
            twins={twin: _twin(http, twin) for twin in (*TWINS, *GUESTS)},
        )


def _wait(database: Database) -> None:
    """Wait until every job has ended; LostError when there is some left and nothing moves any more."""
    moved, seen = time.monotonic(), None
    while waiting := _open(database):
        if waiting != seen:
            moved, seen = time.monotonic(), waiting
        elif time.monotonic() - moved > PATIENCE_S:
            raise LostError(f"jobs do not end; nothing has moved for {PATIENCE_S:g} s: {waiting}")
        time.sleep(0.5)


def _open(database: Database) -> list[tuple[str, int, int, int]]:
    """(job, chunk, attempt, runs done of the job) of every chunk that is open, and of jobs without any."""
    query = (
        sa.select(jobs.c.id, chunks.c.number, chunks.c.attempt, jobs.c.runs_done)
        .join_from(jobs, chunks, sa.and_(chunks.c.job_id == jobs.c.id, chunks.c.open), isouter=True)
        .where(sa.or_(chunks.c.open, jobs.c.state.not_in(FINAL)))
        .order_by(jobs.c.id, chunks.c.number)
    )
    with database.read() as connection:
        return [tuple(row) for row in connection.execute(query)]


def _get(http: httpx.Client, path: str) -> httpx.Response:
    return http.get(path).raise_for_status()


def _jobs(database: Database) -> list[str]:
    with database.read() as connection:
        return list(connection.scalars(sa.select(jobs.c.id).order_by(jobs.c.id)))


def _path(job: str) -> str:
    return f"/v1/{job.partition('-')[0]}s/{job}"


def _job(http: httpx.Client, job: str) -> Document:
    return _get(http, _path(job)).json()


def _twin(http: httpx.Client, twin: str) -> Document | None:
    answer = http.get(f"/v1/twins/{twin}")
    return None if answer.status_code == HTTPStatus.NOT_FOUND else answer.raise_for_status().json()


def _results(http: httpx.Client, job: str, about: Document) -> list[Document]:
    """As the API shows them; a run shows its figures alone."""
    if job.startswith("comparison-"):
        return _get(http, f"{_path(job)}/results").json()["results"]
    return [about["metrics"]] if about["metrics"] else []


def _chunks(database: Database, job: str) -> list[Document]:
    """Chunks of a job as stored, in order, and how many results each has."""
    query = (
        sa.select(chunks.c.number, chunks.c.runs, chunks.c.open, results.c.rows)
        .join_from(
            chunks, results, sa.and_(results.c.job_id == chunks.c.job_id, results.c.number == chunks.c.number),
            isouter=True,
        )
        .where(chunks.c.job_id == job)
        .order_by(chunks.c.number)
    )  # fmt: skip
    with database.read() as connection:
        return [
            {"number": row.number, "runs": row.runs, "open": row.open, "rows": len(json.loads(row.rows or "[]"))}
            for row in connection.execute(query)
        ]


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def expected(requests: list[dict[str, Any]]) -> dict[str, Document]:
    """What an undisturbed run of each request for a job gives, computed here."""
    made: dict[str, Document] = {}
    for request in requests:
        if "replications" in request and canonical(request) not in made:
            scenarios = [Scenario.model_validate(scenario) for scenario in request["scenarios"]]
            found = compare(
                scenarios, request["controllers"], replications=request["replications"], seed=request["seed"]
            )
            made[canonical(request)] = {"rows": [result.as_row() for result in found]}
        elif "replication" in request and canonical(request) not in made:
            scenario = Scenario.model_validate(request["scenario"])
            result, record = run(scenario, request["controller"], request["replication"], seed=request["seed"])
            figures = {name: result.as_row()[name] for name in UNITS}
            made[canonical(request)] = {"rows": [figures], "series": _digest(record.parquet())}
    return made


def _replay(arena: Arena, twin: str) -> tuple[list[Document], dict[int, int]]:
    """Every sample of a twin and the first one of each epoch, as the history answers."""
    samples: list[Document] = []
    with connect(arena.endpoint) as session:
        while True:
            replies = list(session.get(f"hrs/v1/{twin}/history?from={len(samples)}", timeout=30))
            answer = json.loads(replies[0].ok.payload.to_bytes())
            samples += answer["samples"]
            if answer["next"] >= answer["end"] or not answer["samples"]:
                return samples, {int(epoch): first for epoch, first in answer["epochs"].items()}


def _columns(http: httpx.Client, twin: str) -> Document:
    answer = _get(http, f"/v1/twins/{twin}/history?columns={','.join(NAMED)}").json()
    return {name: answer["columns"][name] for name in NAMED}


def _events(http: httpx.Client, twin: str) -> Iterator[Document]:
    path = f"/v1/twins/{twin}/events?limit=1000"
    while path:
        answer = _get(http, path)
        yield from answer.json()["items"]
        path = answer.links.get("next", {}).get("url", "")


def afterwards(arena: Arena) -> dict[str, str]:
    """What is wrong with the service and its store behind everything, by what was looked at."""
    wrong = {"readyz": "" if arena.ready() else "is not ready"}
    status = arena.stop_service()
    wrong["stop"] = "" if status == 0 else f"ended with status {status}"
    with open_database(arena.database_url) as database, database.read() as connection:
        if database.sqlite:
            said = connection.exec_driver_sql("PRAGMA integrity_check").scalar()
            wrong["integrity"] = "" if said == "ok" else str(said)
            broken = connection.exec_driver_sql("PRAGMA foreign_key_check").all()
            wrong["references"] = f"{len(broken)} rows refer to nothing" if broken else ""
    copy = arena.folder / "after.backup"
    wrong["backup"] = _failed("backup", copy, "--database", arena.given_url)
    wrong["restore"] = _failed("restore", copy, "--data", arena.folder / "restored")
    arena.start()
    until(arena.ready, "the service is not ready behind its next start")
    return wrong


def _failed(*arguments: object) -> str:
    """What `hrs` says where it fails."""
    done = run_hrs(*arguments)
    return "" if done.returncode == 0 else done.stderr
