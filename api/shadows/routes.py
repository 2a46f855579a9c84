"""/v1/twins/{twin_id}/shadow: who is held against the controller that acts, and what they would have made of it."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query

from api.controllers.service import check
from api.forecasts.service import check_forecast
from api.http.authorization import requires
from api.http.bodies import JsonRoute
from api.http.dependencies import JobsDep, SettingsDep
from api.scopes import Scope
from api.shadows.schemas import TwinShadow
from api.shadows.service import shadow_of
from api.twins.routes import TwinId, TwinsDep
from api.twins.schemas import Source
from api.twins.shadow_schemas import ShadowRequest
from station import InputError

router = APIRouter(prefix="/v1/twins", tags=["twins"], route_class=JsonRoute)

SHOWN = 24
"""Stretches that are shown, unless more are asked for."""


@router.get("/{twin_id}/shadow")
def get_shadow(
    twin_id: TwinId, twins: TwinsDep, jobs: JobsDep,
    limit: Annotated[int, Query(ge=0, le=200, description="Most stretches shown, the newest", examples=[24])] = SHOWN,
) -> TwinShadow:  # fmt: skip
    """What each shadow would have made of the stretches that are over, and of days, against the one that acted."""
    return shadow_of(twins, jobs, twin_id, limit)


@router.put("/{twin_id}/shadow")
@requires(Scope.OPERATE)
def put_shadow(
    twin_id: TwinId, request: ShadowRequest, twins: TwinsDep, jobs: JobsDep, settings: SettingsDep
) -> TwinShadow:
    """Hold controllers against the one that acts from the next stretch on; answered when it is stored."""
    known = twins.state(twin_id)
    scenario = twins.scenario(twin_id)
    acting = [(known.controller, "controller")] if known.source is Source.SIMULATED else []
    asked = [(name, f"controllers.{place}") for place, name in enumerate(request.controllers)]
    if known.source is Source.MEASURED and len(request.controllers) == 1:
        reason = "must be at least two where a twin follows measurements: who acts there is not known"
        raise InputError("request", [("controllers", f"{reason}, and the others are held against the first")])
    for name, field in (*acting, *asked):
        check(name, [scenario], settings, field)
        check_forecast(name, scenario, field)
    twins.set_shadow(twin_id, request)
    return shadow_of(twins, jobs, twin_id, SHOWN)


@router.delete("/{twin_id}/shadow")
@requires(Scope.OPERATE)
def delete_shadow(twin_id: TwinId, twins: TwinsDep, jobs: JobsDep) -> TwinShadow:
    """Hold nobody against the one that acts any more; what was found stays."""
    twins.set_shadow(twin_id, None)
    return shadow_of(twins, jobs, twin_id, SHOWN)
