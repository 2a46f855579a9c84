"""Drills of twins as answers show them: a fault that was put in, and how it was found."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, Field, RootModel

from api.twins.schemas import Id
from station.faults.kinds import Fault

_S: dict[str, Any] = {"unit": "s"}

_Second = Annotated[float, Field(ge=0, json_schema_extra=_S)]

_Offset = Annotated[float, Field(ge=-1e9, le=1e9)]


class DrillOrder(RootModel[Fault]):
    """A fault to put in."""


class Drill(BaseModel):
    """A fault of a twin's plant, a sensor or a clock, and how another twin that follows it has found it."""

    fault: Annotated[
        dict[str, Any],
        Field(
            description="As it was put in; times are the twin's",
            examples=[{"kind": "leak", "buffer": "high", "rate_g_per_s": 1.0, "begin_s": 900.0, "end_s": 2700.0}],
        ),
    ]
    event: Annotated[str, Field(description="Name of the event that tells it", examples=["leak_high"])]
    begin_s: Annotated[_Second, Field(description="It is there from this second on", examples=[900.0])]
    end_s: Annotated[_Second | None, Field(description="Up to this one; null: for ever", examples=[2700.0])]
    size: Annotated[_Offset | None, Field(description="How large it is", examples=[1.0])]
    unit: Annotated[str | None, Field(description="Of its size", examples=["g/s"])]
    found: Annotated[
        bool | None, Field(description="Whether it was found; null where nobody was asked", examples=[True])
    ]
    delay_s: Annotated[
        _Offset | None, Field(description="From its begin until it was found", json_schema_extra=_S, examples=[95.0])
    ]
    begin_error_s: Annotated[
        _Offset | None,
        Field(description="Begin that was told, less the true one", json_schema_extra=_S, examples=[4.0]),
    ]
    size_error: Annotated[_Offset | None, Field(description="Size that was told, less the true one", examples=[0.02])]
    untold: Annotated[
        str | None,
        Field(
            description="Why it was not found: that twin can tell nothing of such a fault; null where it can",
            examples=["no tag tells temperature_high"],
        ),
    ]


class TwinDrills(BaseModel):
    """The drills of a twin, the oldest first."""

    twin: Id
    followed_by: Annotated[str | None, Field(description="Twin whose findings are scored", examples=["followed"])]
    items: Annotated[list[Drill], Field(description="Drills", examples=[[]])]
    false_events: Annotated[
        list[str], Field(description="Events that the other twin told and no fault explains", examples=[[]])
    ]
