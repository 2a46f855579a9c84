"""Events of twins as answers show them."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, Field

from api.http.pagination import Next
from api.twins.schemas import Id


class TwinEvent(BaseModel):
    """Something that happened to a twin."""

    version: Annotated[int, Field(ge=1, description="Of this document", examples=[1])]
    twin: Id
    epoch: Annotated[int, Field(ge=1, description="Start of the twin it belongs to", examples=[1])]
    seq: Annotated[int, Field(ge=0, description="Number among the twin's events", examples=[7])]
    sent: Annotated[
        float, Field(ge=0, description="Unix time", json_schema_extra={"unit": "s"}, examples=[1795252800.25])
    ]
    time: Annotated[float, Field(ge=0, description="Simulated", json_schema_extra={"unit": "s"}, examples=[250.0])]
    kind: Annotated[str, Field(description="What happened", examples=["fill_start"])]
    details: Annotated[
        dict[str, Any], Field(description="Figures of it", examples=[{"vehicle": 1, "pressure_bar": 137.3}])
    ]


class EventPage(BaseModel):
    """Events in order."""

    items: Annotated[list[TwinEvent], Field(description="Events", examples=[[]])]
    after: Annotated[int, Field(ge=-1, description="Number of the last; as `after` it goes on behind", examples=[7])]
    next: Next
