"""/v1/twins/{twin_id}: measurements of a real station come in, estimates go out."""

from __future__ import annotations

from functools import partial
from http import HTTPStatus
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request
from starlette.concurrency import run_in_threadpool
from starlette.responses import Response

from api.http.authorization import requires
from api.http.bodies import SMALL
from api.http.problems import ProblemError
from api.measurements.formats import MEDIA_TYPES
from api.scopes import Scope
from api.twins.estimates import estimate_of
from api.twins.measurement_schemas import SEQUENCE_MAX, SOURCE_PATTERN, Estimate, MeasurementSources, StoredBatch
from api.twins.routes import TwinId, TwinsDep

router = APIRouter(prefix="/v1/twins", tags=["twins"])

_ROWS: dict[str, Any] = {
    "description": "Rows of `tag`, `time`, `value` and `quality`: objects of a JSON list or a line each, or columns",
    "required": True,
    "content": {
        media: {"schema": {"type": "array", "items": {"type": "object"}} if media.endswith("/json") else {}}
        for media in MEDIA_TYPES
    },
}

_STORED: dict[int | str, dict[str, Any]] = {
    200: {"model": StoredBatch, "description": "Stored before: the same source, sequence and content"},
    202: {"model": StoredBatch, "description": "Stored; followed soon"},
}


@router.post(
    "/{twin_id}/measurements", status_code=202, responses=_STORED, openapi_extra={"requestBody": _ROWS},
    response_model=StoredBatch,
)  # fmt: skip
@requires(Scope.MEASURE)
async def send_measurements(
    twin_id: TwinId, twins: TwinsDep, request: Request,
    source: Annotated[
        str, Query(pattern=SOURCE_PATTERN, description="Who sends them", examples=["gateway-1"])
    ],
    sequence: Annotated[
        int, Query(ge=0, le=SEQUENCE_MAX, description="Their number as the sender counts, each once", examples=[360])
    ],
) -> Response:  # fmt: skip
    """Store measurements of a measured twin; sent again with the same source and sequence they count once."""
    packed = request.headers.get("content-encoding", "identity")
    if packed.strip().lower() != "identity":
        detail = f"Content-Encoding must be left out: measurements are sent unpacked; given {packed!r:.100}"
        raise ProblemError(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "media-type", "Unsupported media type", detail)
    body = await request.body()
    media = request.headers.get("content-type", "")
    reading = partial(twins.read_batch, twin_id, body, media)
    if len(body) <= SMALL:
        batch = await run_in_threadpool(reading)
    else:
        async with request.app.state.large_bodies:
            batch = await run_in_threadpool(reading)
    answer = await run_in_threadpool(twins.store_batch, twin_id, source, sequence, batch)
    status = HTTPStatus.OK if answer.repeated else HTTPStatus.ACCEPTED
    return Response(answer.model_dump_json(), status, media_type="application/json")


@router.get("/{twin_id}/measurements")
def get_measurements(twin_id: TwinId, twins: TwinsDep) -> MeasurementSources:
    """The newest measurements that each source has sent: where a sender goes on that has forgotten it."""
    return twins.sources(twin_id)


@router.get("/{twin_id}/estimate")
def get_estimate(twin_id: TwinId, twins: TwinsDep) -> Estimate:
    """The newest second that a measured twin has followed: estimates, readings, and what was detected."""
    return estimate_of(twins, twin_id)
