"""/v1/runs: submit a scenario with a controller, poll, read figures of merit and series."""

from __future__ import annotations

from http import HTTPStatus
from typing import Annotated

from fastapi import APIRouter, Path
from starlette.concurrency import run_in_threadpool
from starlette.responses import Response

from api.controllers.service import check, check_scenario
from api.http.bodies import JsonRoute
from api.http.etags import Cached, CachedGet
from api.http.idempotency import Asked, Keep
from api.http.pagination import Paged
from api.http.problems import conflict, not_found
from api.http.timeseries import Format
from api.jobs.endpoints import StateFilter, cancel, job_of, newest, remove
from api.packing import Kept
from api.runs.kept import SERIES_RESPONSES, Chosen, Form, check_kept, series_answer, vehicles_answer
from api.runs.schemas import Run, RunPage, RunRequest, run_of
from api.server.services import Opened, Services
from api.store.records import Job, JobKind, JobState

router = APIRouter(prefix="/v1/runs", tags=["runs"], route_class=JsonRoute)

Id = Annotated[str, Path(max_length=40, description="Id of a run", examples=["run-019a7c3f2b10a1b2c3d4"])]


@router.post("", status_code=202, response_model=Run)
def submit_run(request: RunRequest, opened: Opened, asked_once: Asked) -> Response:
    """Queue a run; its place is in `Location`."""

    def submit(keep: Keep[Job] | None) -> Job:
        scenario = opened.scenarios.resolve(request.scenario)
        check_scenario(scenario, opened.settings)
        check(request.controller, [scenario], opened.settings)
        return opened.submit_run(scenario, request.controller, request.replication, request.seed, keep, request.record)

    return asked_once.answer(HTTPStatus.ACCEPTED, submit, lambda job: (f"/v1/runs/{job.id}", run_of(job, [])))


@router.get("")
def list_runs(opened: Opened, page: Paged, state: StateFilter = None) -> RunPage:
    """Runs, the newest first."""
    jobs, cursor = newest(opened, JobKind.RUN, state, page)
    rows = opened.jobs.results_of([job.id for job in jobs])
    items = [run_of(job, rows.get(job.id, [])) for job in jobs]
    return RunPage(items=items, next=cursor)


@router.get("/{run_id}")
async def get_run(run_id: Id, opened: Opened, cached: CachedGet) -> Run:
    """Where a run stands and, when it is done, its figures of merit."""
    return await run_in_threadpool(_shown, opened, run_id, cached)  # one thread a request: a plain function takes two


@router.post("/{run_id}/cancel")
def cancel_run(run_id: Id, opened: Opened) -> Run:
    """End a run where it stands; one that has ended stays as it is."""
    cancel(opened, JobKind.RUN, run_id)
    return _shown(opened, run_id)


@router.delete("/{run_id}", status_code=204)
def delete_run(run_id: Id, opened: Opened) -> None:
    """Forget a run that has ended."""
    remove(opened, JobKind.RUN, run_id)


@router.get("/{run_id}/series", responses=SERIES_RESPONSES)
def get_series(
    run_id: Id, opened: Opened, cached: CachedGet, chosen: Chosen, form: Form = Format.JSON
) -> Response:  # fmt: skip
    """The record of a run: every column each second, or what the query selects."""
    return series_answer(_record(opened, run_id, cached, Kept.FULL), cached, chosen, form)


@router.get("/{run_id}/vehicles", responses=SERIES_RESPONSES)
def get_vehicles(run_id: Id, opened: Opened, cached: CachedGet, form: Form = Format.JSON) -> Response:
    """The vehicles of a run, one a row: arrival, connection, end, pressures, hydrogen delivered."""
    return vehicles_answer(_record(opened, run_id, cached, Kept.VEHICLES), cached, form)


def _shown(opened: Services, run_id: str, cached: Cached | None = None) -> Run:
    found = opened.jobs.get_with_result(run_id)
    if found is None or found[0].kind is not JobKind.RUN:
        raise not_found("run", run_id)
    if cached is not None:
        cached.ended(found[0])
    return run_of(*found)


def _record(opened: Services, run_id: str, cached: Cached, wanted: Kept) -> bytes:
    """The stored record of a run that kept what is wanted of it."""
    job = job_of(opened, JobKind.RUN, run_id)
    check_kept(job, wanted, Kept.FULL)
    if job.state is JobState.SUCCEEDED:
        cached.ended(job)
    content = opened.jobs.series(run_id)
    if content is None:
        raise conflict(f"run {run_id!r} is {job.state}; only one that succeeded has series")
    return content
