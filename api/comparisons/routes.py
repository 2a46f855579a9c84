"""/v1/comparisons: submit scenarios x controllers x replications; progress, tables, results."""

from __future__ import annotations

from collections.abc import Sequence
from http import HTTPStatus
from typing import Annotated, Any

from fastapi import APIRouter, Path, Query
from starlette.responses import HTMLResponse, Response

from api.comparisons import service
from api.comparisons.export import csv_of, parquet_of
from api.comparisons.job import comparison_spec
from api.comparisons.schemas import (
    Comparison,
    ComparisonFigures,
    ComparisonPage,
    ComparisonRequest,
    ComparisonResults,
    ComparisonTable,
    comparison_of,
    figures_of,
    table_of,
)
from api.comparisons.service import done_of
from api.comparisons.summary import summaries
from api.comparisons.tables import tables, verdict
from api.controllers.service import check, check_scenario
from api.http import pieces
from api.http.authorization import requires
from api.http.bodies import JsonRoute
from api.http.dependencies import JobsDep, SettingsDep
from api.http.etags import ConditionalGet, ConditionalGetDep
from api.http.idempotency import IdempotentRequest, Keep
from api.http.pagination import Paged
from api.http.problems import conflict, not_found
from api.http.timeseries import MEDIA, SERIES_RESPONSES, Format, FormatParameter, SelectionDep
from api.jobs.endpoints import JobQueueDep, StateFilter, cancel, job_of, newest, remove
from api.packing import Kept
from api.runs.kept import check_kept, series_answer, vehicles_answer
from api.runs.service import Result
from api.scenarios.service import ScenariosDep
from api.scopes import Scope
from api.settings import Settings
from api.store.jobs import JobRepository
from api.store.records import Job, JobKind
from station import InputError, Scenario
from station.metrics import units_of

router = APIRouter(prefix="/v1/comparisons", tags=["comparisons"], route_class=JsonRoute)

Id = Annotated[str, Path(max_length=40, description="Id of a comparison", examples=["comparison-019a7c3f2b10a1b2c3d4"])]
Number = Annotated[
    int,
    Path(
        ge=0, le=2**31 - 1, description="Number of a run, from 0: scenarios, then controllers, then replications",
        examples=[0],
    ),
]  # fmt: skip

_FILES: dict[int | str, dict[str, Any]] = {
    200: {
        "content": {
            "text/csv": {"schema": {"type": "string"}},
            MEDIA[Format.PARQUET]: {"schema": {"type": "string", "format": "binary"}},
        }
    }
}


@router.post("", status_code=202, response_model=Comparison)
@requires(Scope.RUN)
def submit_comparison(
    request: ComparisonRequest,
    stored: ScenariosDep,
    settings: SettingsDep,
    queue: JobQueueDep,
    idempotent: IdempotentRequest,
) -> Response:
    """Queue a comparison; its place is in `Location`."""

    def submit(keep: Keep[Job] | None) -> Job:
        scenarios = [stored.resolve(given, f"scenarios.{number}") for number, given in enumerate(request.scenarios)]
        check_request(request, scenarios, settings)
        spec = comparison_spec(scenarios, request.controllers, request.replications, request.seed, request.record)
        return queue.submit(JobKind.COMPARISON, spec, keep)

    return idempotent.answer(HTTPStatus.ACCEPTED, submit, lambda job: (f"/v1/comparisons/{job.id}", comparison_of(job)))


@router.get("")
def list_comparisons(jobs: JobsDep, page: Paged, state: StateFilter = None) -> ComparisonPage:
    """Comparisons, the newest first."""
    found, cursor = newest(jobs, JobKind.COMPARISON, state, page)
    return ComparisonPage(items=[comparison_of(job) for job in found], next=cursor)


@router.get("/{comparison_id}")
def get_comparison(comparison_id: Id, jobs: JobsDep, conditional: ConditionalGetDep) -> Comparison:
    """How far a comparison has come."""
    job = job_of(jobs, JobKind.COMPARISON, comparison_id)
    conditional.ended(job)
    return comparison_of(job)


@router.post("/{comparison_id}/cancel")
@requires(Scope.RUN)
def cancel_comparison(comparison_id: Id, jobs: JobsDep) -> Comparison:
    """End a comparison where it stands; its results so far stay."""
    cancel(jobs, JobKind.COMPARISON, comparison_id)
    return comparison_of(job_of(jobs, JobKind.COMPARISON, comparison_id))


@router.delete("/{comparison_id}", status_code=204)
@requires(Scope.RUN)
def delete_comparison(comparison_id: Id, jobs: JobsDep) -> None:
    """Forget a comparison that has ended."""
    remove(jobs, JobKind.COMPARISON, comparison_id)


@router.get("/{comparison_id}/results", responses=_FILES, response_model=ComparisonResults)
def get_results(
    comparison_id: Id,
    jobs: JobsDep,
    conditional: ConditionalGetDep,
    form: Annotated[Format, Query(alias="format", description="What to answer", examples=["csv"])] = Format.JSON,
) -> Response:
    """The figures of merit of every run done so far, one row a run."""
    job = job_of(jobs, JobKind.COMPARISON, comparison_id)
    conditional.ended(job)
    rows = jobs.results(job.id)
    if form is Format.JSON:
        return pieces.answer(
            pieces.objects({"units": units_of(rows)}, "results", rows), MEDIA[form], conditional.headers
        )
    content = csv_of(rows).encode() if form is Format.CSV else parquet_of(rows)
    return pieces.answer(pieces.slices(memoryview(content)), MEDIA[form], conditional.headers)


@router.get("/{comparison_id}/table")
def get_table(comparison_id: Id, jobs: JobsDep, conditional: ConditionalGetDep) -> ComparisonTable:
    """The runs done so far as tables: means, spread, the thesis's figures beside ours."""
    scenarios, results = _done(jobs, comparison_id, conditional)
    return table_of(tables(scenarios, results), verdict(scenarios, results))


@router.get("/{comparison_id}/figures")
def get_figures(comparison_id: Id, jobs: JobsDep, conditional: ConditionalGetDep) -> ComparisonFigures:
    """The runs done so far in numbers: mean and spread of every figure, the thesis's beside them."""
    return figures_of(summaries(*_done(jobs, comparison_id, conditional)))


@router.get("/{comparison_id}/scenarios")
def get_scenarios(comparison_id: Id, jobs: JobsDep, conditional: ConditionalGetDep) -> list[Scenario]:
    """The scenarios of a comparison, whole: to run one of them alone, or a changed one."""
    return _done(jobs, comparison_id, conditional)[0]


@router.get("/{comparison_id}/runs/{number}/series", responses=SERIES_RESPONSES)
def get_run_series(
    comparison_id: Id, number: Number, jobs: JobsDep, conditional: ConditionalGetDep, chosen: SelectionDep,
    form: FormatParameter = Format.JSON,
) -> Response:  # fmt: skip
    """The record of one run: every column each second, or what the query selects."""
    return series_answer(_record(jobs, comparison_id, number, conditional, Kept.FULL), conditional, chosen, form)


@router.get("/{comparison_id}/runs/{number}/vehicles", responses=SERIES_RESPONSES)
def get_run_vehicles(
    comparison_id: Id, number: Number, jobs: JobsDep, conditional: ConditionalGetDep,
    form: FormatParameter = Format.JSON,
) -> Response:  # fmt: skip
    """The vehicles of one run, one a row: arrival, connection, end, pressures, hydrogen delivered."""
    return vehicles_answer(_record(jobs, comparison_id, number, conditional, Kept.VEHICLES), conditional, form)


@router.get("/{comparison_id}/report", response_class=HTMLResponse)
def get_report(comparison_id: Id, jobs: JobsDep, conditional: ConditionalGetDep) -> HTMLResponse:
    """The runs done so far as one self-contained page, the same that `hrs compare --html` writes."""
    from api.comparisons import report  # it draws: slow to import
    from api.pictures import REPORT_HEADERS

    scenarios, results = _done(jobs, comparison_id, conditional)
    if not results:
        raise conflict(f"comparison {comparison_id!r} has no result yet")
    return HTMLResponse(
        report.html(scenarios, results, tables(scenarios, results)), headers=REPORT_HEADERS | conditional.headers
    )


def _record(jobs: JobRepository, comparison_id: str, number: int, conditional: ConditionalGet, wanted: Kept) -> bytes:
    """The stored record of one run of a comparison that kept what is wanted of it."""
    job = job_of(jobs, JobKind.COMPARISON, comparison_id)
    check_kept(job, wanted, Kept.NONE)
    if number >= job.runs:
        raise not_found(f"run of comparison {comparison_id!r}", str(number))
    content = jobs.record(comparison_id, number)
    if content is None:
        raise conflict(f"comparison {comparison_id!r} is {job.state} and has not done its run {number}")
    conditional.ended(job)
    return content


def _done(jobs: JobRepository, comparison_id: str, conditional: ConditionalGet) -> tuple[list[Scenario], list[Result]]:
    job = job_of(jobs, JobKind.COMPARISON, comparison_id)
    conditional.ended(job)
    return done_of(job, jobs)


def check_request(request: ComparisonRequest, scenarios: Sequence[Scenario], settings: Settings) -> None:
    """Raise InputError unless the comparison can run and lies within the service's limits."""
    if request.replications > settings.replications_max:
        limit = f"must be at most {settings.replications_max} (setting replications_max)"
        raise InputError("request", [("replications", f"{limit}; given {request.replications}")])
    each = (service.replications_of(scenario, request.replications) for scenario in scenarios)
    runs = len(request.controllers) * sum(each)
    if request.record is not Kept.NONE and runs > settings.records_max:
        limit = f"a comparison of more than {settings.records_max} runs (setting records_max) keeps no records"
        raise InputError("request", [("record", f"{limit}; given {request.record} of {runs}")])
    if runs > settings.runs_max:
        limit = f"scenarios x controllers x replications must be at most {settings.runs_max} (setting runs_max)"
        raise InputError("request", [("replications", f"{limit}; given {runs}")])
    for number, scenario in enumerate(scenarios):
        check_scenario(scenario, settings, f"scenarios.{number}")
    for number, controller in enumerate(request.controllers):
        check(controller, scenarios, settings, f"controllers.{number}")
    service.check(scenarios, request.controllers, request.replications, request.seed)
