"""/v1/runs: submit a scenario with a controller, poll, read figures of merit and series."""

from __future__ import annotations

from http import HTTPStatus
from typing import Annotated

from fastapi import APIRouter, Path
from starlette.concurrency import run_in_threadpool
from starlette.responses import Response

from api.controllers.service import check, check_scenario
from api.http.authorization import requires
from api.http.bodies import JsonRoute
from api.http.dependencies import JobsDep, SettingsDep
from api.http.etags import ConditionalGet, ConditionalGetDep
from api.http.idempotency import IdempotentRequest, Keep
from api.http.pagination import Paged
from api.http.problems import conflict, not_found
from api.http.timeseries import SERIES_RESPONSES, Format, FormatParameter, SelectionDep
from api.jobs.endpoints import JobQueueDep, StateFilter, cancel, job_of, newest, remove
from api.packing import Kept
from api.runs.job import run_spec
from api.runs.kept import check_kept, series_answer, vehicles_answer
from api.runs.schemas import Run, RunPage, RunRequest, run_of
from api.scenarios.service import ScenariosDep
from api.scopes import Scope
from api.store.jobs import JobRepository
from api.store.records import Job, JobKind, JobState

router = APIRouter(prefix="/v1/runs", tags=["runs"], route_class=JsonRoute)

Id = Annotated[str, Path(max_length=40, description="Id of a run", examples=["run-019a7c3f2b10a1b2c3d4"])]


@router.post("", status_code=202, response_model=Run)
@requires(Scope.RUN)
def submit_run(
    request: RunRequest,
    scenarios: ScenariosDep,
    settings: SettingsDep,
    queue: JobQueueDep,
    idempotent: IdempotentRequest,
) -> Response:
    """Queue a run; its place is in `Location`."""

    def submit(keep: Keep[Job] | None) -> Job:
        scenario = scenarios.resolve(request.scenario)
        check_scenario(scenario, settings)
        check(request.controller, [scenario], settings)
        spec = run_spec(scenario, request.controller, request.replication, request.seed, request.record)
        return queue.submit(JobKind.RUN, spec, keep)

    return idempotent.answer(HTTPStatus.ACCEPTED, submit, lambda job: (f"/v1/runs/{job.id}", run_of(job, [])))


@router.get("")
def list_runs(jobs: JobsDep, page: Paged, state: StateFilter = None) -> RunPage:
    """Runs, the newest first."""
    found, cursor = newest(jobs, JobKind.RUN, state, page)
    rows = jobs.results_of([job.id for job in found])
    items = [run_of(job, rows.get(job.id, [])) for job in found]
    return RunPage(items=items, next=cursor)


@router.get("/{run_id}")
async def get_run(run_id: Id, jobs: JobsDep, conditional: ConditionalGetDep) -> Run:
    """Where a run stands and, when it is done, its figures of merit."""
    return await run_in_threadpool(
        _shown, jobs, run_id, conditional
    )  # one thread a request: a plain function takes two


@router.post("/{run_id}/cancel")
@requires(Scope.RUN)
def cancel_run(run_id: Id, jobs: JobsDep) -> Run:
    """End a run where it stands; one that has ended stays as it is."""
    cancel(jobs, JobKind.RUN, run_id)
    return _shown(jobs, run_id)


@router.delete("/{run_id}", status_code=204)
@requires(Scope.RUN)
def delete_run(run_id: Id, jobs: JobsDep) -> None:
    """Forget a run that has ended."""
    remove(jobs, JobKind.RUN, run_id)


@router.get("/{run_id}/series", responses=SERIES_RESPONSES)
def get_series(
    run_id: Id, jobs: JobsDep, conditional: ConditionalGetDep, chosen: SelectionDep, form: FormatParameter = Format.JSON
) -> Response:  # fmt: skip
    """The record of a run: every column each second, or what the query selects."""
    return series_answer(_record(jobs, run_id, conditional, Kept.FULL), conditional, chosen, form)


@router.get("/{run_id}/vehicles", responses=SERIES_RESPONSES)
def get_vehicles(
    run_id: Id, jobs: JobsDep, conditional: ConditionalGetDep, form: FormatParameter = Format.JSON
) -> Response:
    """The vehicles of a run, one a row: arrival, connection, end, pressures, hydrogen delivered."""
    return vehicles_answer(_record(jobs, run_id, conditional, Kept.VEHICLES), conditional, form)


def _shown(jobs: JobRepository, run_id: str, conditional: ConditionalGet | None = None) -> Run:
    found = jobs.get_with_result(run_id)
    if found is None or found[0].kind is not JobKind.RUN:
        raise not_found("run", run_id)
    if conditional is not None:
        conditional.ended(found[0])
    return run_of(*found)


def _record(jobs: JobRepository, run_id: str, conditional: ConditionalGet, wanted: Kept) -> bytes:
    """The stored record of a run that kept what is wanted of it."""
    job = job_of(jobs, JobKind.RUN, run_id)
    check_kept(job, wanted, Kept.FULL)
    if job.state is JobState.SUCCEEDED:
        conditional.ended(job)
    content = jobs.series(run_id)
    if content is None:
        raise conflict(f"run {run_id!r} is {job.state}; only one that succeeded has series")
    return content
