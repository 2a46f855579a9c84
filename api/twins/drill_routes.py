"""/v1/twins/{twin_id}/drills: faults are put into a simulated station, and it is seen how they are found."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query

from api.http.authorization import requires
from api.http.bodies import JsonRoute
from api.scopes import Scope
from api.twins.drill_schemas import DrillOrder, TwinDrills
from api.twins.routes import TwinId, TwinsDep

router = APIRouter(prefix="/v1/twins", tags=["twins"], route_class=JsonRoute)


@router.get("/{twin_id}/drills")
def get_drills(
    twin_id: TwinId, twins: TwinsDep,
    followed_by: Annotated[
        str | None,
        Query(max_length=32, description="A twin that follows it, whose findings are scored", examples=["followed"]),
    ] = None,
) -> TwinDrills:  # fmt: skip
    """The faults that a simulated twin's station has had and has: of its scenario first, then its drills."""
    return twins.drills(twin_id, followed_by)


@router.post("/{twin_id}/drills")
@requires(Scope.OPERATE)
def start_drill(
    twin_id: TwinId, order: DrillOrder, twins: TwinsDep
) -> TwinDrills:  # fmt: skip
    """Put a fault into the plant, a sensor or the clock of a live simulated twin; answered when it is stored.

    Faults of sensors and clocks change what is measured of it, not what it does and tells.
    """
    return twins.drill(twin_id, order.root)


@router.delete("/{twin_id}/drills")
@requires(Scope.OPERATE)
def end_drills(twin_id: TwinId, twins: TwinsDep) -> TwinDrills:
    """End the drills that last, and forget those to come; those that are over stay."""
    return twins.end_drills(twin_id)
