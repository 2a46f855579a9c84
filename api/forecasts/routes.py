"""/v1/forecasts: ask a live twin what controllers will make of the time to come; poll; read what was found."""

from __future__ import annotations

import time
from http import HTTPStatus
from typing import Annotated

from fastapi import APIRouter, Depends, Path
from starlette.responses import Response

from api.controllers.service import check
from api.forecasts.job import forecast_spec
from api.forecasts.schemas import Forecast, ForecastFaults, ForecastPage, ForecastRequest
from api.forecasts.service import announced, came_of, check_forecast, contenders, forecast_of, mended
from api.http.authorization import requires
from api.http.bodies import JsonRoute
from api.http.dependencies import JobsDep, SettingsDep, provided
from api.http.idempotency import IdempotentRequest, Keep
from api.http.pagination import Paged
from api.jobs.endpoints import JobQueueDep, StateFilter, cancel, job_of, newest, remove
from api.scenarios.service import ScenariosDep
from api.scopes import Scope
from api.store.jobs import JobRepository
from api.store.records import Job, JobKind, JobState
from api.twins.routes import TwinId
from api.twins.service import Twins

router = APIRouter(prefix="/v1", tags=["forecasts"], route_class=JsonRoute)

AT_ONCE_S = 1.5
"""A forecast that is done within this is answered at once [s]."""

ASK_S = 0.02
"""How often it is asked for meanwhile [s]."""

Id = Annotated[str, Path(max_length=40, description="Id of a forecast", examples=["forecast-019a7c3f2b10a1b2c3d4"])]

TwinsDep = Annotated[Twins, Depends(provided(Twins))]


@router.post(
    "/twins/{twin_id}/forecasts", status_code=202, response_model=Forecast,
    responses={200: {"model": Forecast, "description": "Done at once"}},
)  # fmt: skip
@requires(Scope.RUN)
def submit_forecast(
    twin_id: TwinId, request: ForecastRequest, twins: TwinsDep, scenarios: ScenariosDep, settings: SettingsDep,
    queue: JobQueueDep, jobs: JobsDep, idempotent: IdempotentRequest,
) -> Response:  # fmt: skip
    """Fork a live twin into futures that all controllers share; its place is in `Location`.

    A short one is answered whole (200), a longer one where it stands (202). Vehicles and the twin's state are the
    same for each controller, so that differences owe nothing to luck.
    """

    def submit(keep: Keep[Job] | None) -> Job:
        law = None if request.law is None else scenarios.resolve(request.law, "law")
        found = twins.fork(twin_id)
        known = mended(found) if request.faults is ForecastFaults.MENDED else found
        names = contenders(known, request)
        for name in names:
            asked_for = name in request.controllers
            field = f"controllers.{request.controllers.index(name)}" if asked_for else "controller"
            check(name, [known.scenario], settings, field)
            check_forecast(name, known.scenario, field)
        asked = {
            **request.model_dump(mode="json", exclude={"controllers", "announced", "law", "faults"}),
            "law": None if law is None else law.model_dump(mode="json"),
            "mended": known is not found,
            "doubt": found.doubt,
        }
        fork = announced(known, request)
        spec = forecast_spec(
            twin_id,
            known.scenario,
            known.replication,
            fork,
            names,
            known.memory,
            known.seen,
            known.events,
            known.spread,
            asked,
        )
        return queue.submit(JobKind.FORECAST, spec, keep)

    def shown(job: Job) -> tuple[str, Forecast]:
        return f"/v1/forecasts/{job.id}", forecast_of(job)

    answer = idempotent.answer(HTTPStatus.ACCEPTED, submit, shown)
    return _at_once(answer, jobs)


def _at_once(answer: Response, jobs: JobRepository) -> Response:
    """The answer, or what was found where that is there soon."""
    place = answer.headers.get("location", "")
    until = time.monotonic() + AT_ONCE_S
    while place and time.monotonic() < until:
        job = jobs.get(place.rpartition("/")[2])
        if job is None or job.state in (JobState.FAILED, JobState.CANCELLED):
            return answer
        if job.state is JobState.SUCCEEDED:
            body = forecast_of(job, jobs.results(job.id)).model_dump_json()
            headers = {name: value for name, value in answer.headers.items() if name != "content-length"}
            return Response(body, HTTPStatus.OK, headers)
        time.sleep(ASK_S)
    return answer


@router.get("/forecasts")
def list_forecasts(jobs: JobsDep, page: Paged, state: StateFilter = None) -> ForecastPage:
    """Forecasts of every twin, the newest first, without their answers."""
    found, cursor = newest(jobs, JobKind.FORECAST, state, page)
    return ForecastPage(items=[forecast_of(job) for job in found], next=cursor)


@router.get("/forecasts/{forecast_id}")
def get_forecast(forecast_id: Id, jobs: JobsDep, twins: TwinsDep) -> Forecast:
    """Where a forecast stands, what was found, and what has come of it since."""
    job = job_of(jobs, JobKind.FORECAST, forecast_id)
    rows = jobs.results(job.id)
    came = came_of(twins, job, job.summary["events"], rows) if job.state is JobState.SUCCEEDED else None
    return forecast_of(job, rows, came)


@router.post("/forecasts/{forecast_id}/cancel")
@requires(Scope.RUN)
def cancel_forecast(forecast_id: Id, jobs: JobsDep) -> Forecast:
    """End a forecast where it stands; one that has ended stays as it is."""
    cancel(jobs, JobKind.FORECAST, forecast_id)
    return forecast_of(job_of(jobs, JobKind.FORECAST, forecast_id))


@router.delete("/forecasts/{forecast_id}", status_code=204)
@requires(Scope.RUN)
def delete_forecast(forecast_id: Id, jobs: JobsDep) -> None:
    """Forget a forecast that has ended."""
    remove(jobs, JobKind.FORECAST, forecast_id)
