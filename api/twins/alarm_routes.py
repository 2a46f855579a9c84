"""/v1/twins/{twin_id}/alarms: what is wrong, and who has seen it."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Path, Query, Request

from api.http.authorization import requires
from api.http.bodies import JsonRoute
from api.scopes import Scope
from api.twins.alarm_schemas import AlarmOrder, TwinAlarm, TwinAlarms
from api.twins.routes import TwinId, TwinsDep
from station.alarm_rules import NAME_MAX

router = APIRouter(prefix="/v1/twins", tags=["twins"], route_class=JsonRoute)

LOCAL = "local"
"""Who did it where no key is needed: somebody at this machine."""

AlarmName = Annotated[str, Path(max_length=NAME_MAX, description="Name of an alarm", examples=["wait_long"])]


@router.get("/{twin_id}/alarms")
def get_alarms(
    twin_id: TwinId, twins: TwinsDep,
    every: Annotated[  # noqa: FBT002  # FastAPI gives it by name
        bool, Query(alias="all", description="Those whose condition does not hold, too", examples=[False])
    ] = False,
) -> TwinAlarms:  # fmt: skip
    """The alarms of a live twin that are shown, shelved, suppressed or out of service, the most urgent first."""
    return twins.alarms(twin_id, every=every)


@router.post("/{twin_id}/alarms/{name}")
@requires(Scope.OPERATE)
def act_on_alarm(
    twin_id: TwinId, name: AlarmName, order: AlarmOrder, twins: TwinsDep, request: Request
) -> TwinAlarm:  # fmt: skip
    """Acknowledge an alarm, shelve it, take it out of service, or take that back; answered when it is stored."""
    return twins.alarm(twin_id, name, order.root, request.scope.get("hrs_owner") or LOCAL)
