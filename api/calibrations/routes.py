"""/v1/calibrations: calibrate the station of a measured twin; poll; move the twin to what was found."""

from __future__ import annotations

from http import HTTPStatus
from typing import Annotated

from fastapi import APIRouter, Path
from starlette.responses import Response

from api.calibrations.schemas import Calibration, CalibrationPage, CalibrationRequest, StationMove, calibration_of
from api.calibrations.service import accepted_station, calibration_spec, check_shape
from api.http.authorization import requires
from api.http.bodies import JsonRoute
from api.http.dependencies import JobsDep, SettingsDep
from api.http.etags import ConditionalGet, ConditionalGetDep
from api.http.idempotency import IdempotentRequest, Keep
from api.http.pagination import Paged
from api.http.problems import not_found
from api.jobs.endpoints import JobQueueDep, StateFilter, cancel, newest, remove
from api.scopes import Scope
from api.store.jobs import JobRepository
from api.store.records import Job, JobKind
from api.twins.etag import TwinPreconditionDep
from api.twins.routes import TwinId, TwinsDep
from api.twins.state_schemas import TwinState

router = APIRouter(prefix="/v1", tags=["calibrations"], route_class=JsonRoute)

Id = Annotated[
    str, Path(max_length=40, description="Id of a calibration", examples=["calibration-019a7c3f2b10a1b2c3d4"])
]


@router.post("/calibrations", status_code=202, response_model=Calibration)
@requires(Scope.RUN)
def submit_calibration(
    request: CalibrationRequest,
    twins: TwinsDep,
    settings: SettingsDep,
    queue: JobQueueDep,
    idempotent: IdempotentRequest,
) -> Response:
    """Queue a calibration; its place is in `Location`. Its seconds are copied: they change no more."""

    def submit(keep: Keep[Job] | None) -> Job:
        return queue.submit(JobKind.CALIBRATION, calibration_spec(twins, request, settings), keep)

    return idempotent.answer(
        HTTPStatus.ACCEPTED, submit, lambda job: (f"/v1/calibrations/{job.id}", calibration_of(job, []))
    )


@router.get("/calibrations")
def list_calibrations(jobs: JobsDep, page: Paged, state: StateFilter = None) -> CalibrationPage:
    """Calibrations, the newest first; their results without stations."""
    found, cursor = newest(jobs, JobKind.CALIBRATION, state, page)
    rows = jobs.results_of([job.id for job in found])
    items = [calibration_of(job, rows.get(job.id, []), whole=False) for job in found]
    return CalibrationPage(items=items, next=cursor)


@router.get("/calibrations/{calibration_id}")
def get_calibration(calibration_id: Id, jobs: JobsDep, conditional: ConditionalGetDep) -> Calibration:
    """How far a calibration is and, when it is done, what it found."""
    return _shown(calibration_id, jobs, conditional)


def _shown(calibration_id: str, jobs: JobRepository, conditional: ConditionalGet | None = None) -> Calibration:
    found = jobs.get_with_result(calibration_id)
    if found is None or found[0].kind is not JobKind.CALIBRATION:
        raise not_found("calibration", calibration_id)
    if conditional is not None:
        conditional.ended(found[0])
    return calibration_of(*found)


@router.post("/twins/{twin_id}/station")
@requires(Scope.OPERATE)
def move_twin(
    twin_id: TwinId, move: StationMove, twins: TwinsDep, jobs: JobsDep, expected: TwinPreconditionDep
) -> TwinState:  # fmt: skip
    """Let a measured twin follow with the station that a calibration found, from the next second on.

    Filter and detection begin anew with it; the next estimates come after a minute.
    """
    known = twins.measured(twin_id).request.followed_station
    station, parameters = accepted_station(jobs, move.calibration)
    check_shape(known, station, parameters)
    return expected.now(twins.move(twin_id, station, move.calibration, expected.check))


@router.post("/calibrations/{calibration_id}/cancel")
@requires(Scope.RUN)
def cancel_calibration(calibration_id: Id, jobs: JobsDep) -> Calibration:
    """End a calibration where it stands; one that has ended stays as it is."""
    cancel(jobs, JobKind.CALIBRATION, calibration_id)
    return _shown(calibration_id, jobs)


@router.delete("/calibrations/{calibration_id}", status_code=204)
@requires(Scope.RUN)
def delete_calibration(calibration_id: Id, jobs: JobsDep) -> None:
    """Forget a calibration that has ended, with its measurements; a twin that was moved to its station keeps that."""
    remove(jobs, JobKind.CALIBRATION, calibration_id)
