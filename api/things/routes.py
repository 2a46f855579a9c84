"""/v1/twins/{twin_id}/thing: a twin described for the Web of Things."""

from __future__ import annotations

from typing import Any

import orjson
from fastapi import APIRouter, Request
from starlette.responses import Response

from api.http.bodies import JsonRoute
from api.http.dependencies import SettingsDep
from api.things.description import MEDIA_TYPE, Place, describe
from api.twins.routes import TwinId, TwinsDep

router = APIRouter(prefix="/v1/twins", tags=["twins"], route_class=JsonRoute)

_ANSWER: dict[int | str, dict[str, Any]] = {
    200: {"description": "A Thing Description 1.1 (W3C)", "content": {MEDIA_TYPE: {"schema": {"type": "object"}}}}
}


@router.get("/{twin_id}/thing", response_class=Response, responses=_ANSWER)
def get_thing(twin_id: TwinId, twins: TwinsDep, settings: SettingsDep, request: Request) -> Response:
    """The Thing Description of a twin: what can be read, done and heard, and how."""
    state = twins.state(twin_id).model_dump(mode="json")
    place = Place(
        str(request.base_url), settings.zenoh_connect or settings.zenoh_listen, keys_required=settings.keys_required
    )
    return Response(orjson.dumps(describe(state, request.app.openapi(), place)), media_type=MEDIA_TYPE)
