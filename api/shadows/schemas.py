"""Shadows as answers show them: what controllers would have made of a twin's stretches of time, and of its days."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, Field

from api.forecasts.schemas import FutureFigure
from api.jobs.schemas import ControllerSpec, JobProblem
from api.store.records import JobState
from api.twins.shadow_schemas import ShadowRequest


class ShadowRun(BaseModel):
    """A controller over one stretch, from the state at its begin and with the vehicles that came."""

    controller: ControllerSpec
    wait_s: Annotated[
        FutureFigure,
        Field(description="Mean wait of the vehicles there were", json_schema_extra={"unit": "s"}, examples=[84.5]),
    ]
    vehicles: Annotated[int, Field(ge=0, description="At the station, or arrived since", examples=[8])]
    served: Annotated[int, Field(ge=0, description="That left with a full tank", examples=[7])]
    incomplete: Annotated[int, Field(ge=0, description="That left before", examples=[0])]
    waiting: Annotated[int, Field(ge=0, description="In the queue at the end", examples=[1])]
    energy_kwh: Annotated[
        FutureFigure | None,
        Field(description="Electric; null where none is told", json_schema_extra={"unit": "kWh"}, examples=[105.3]),
    ]
    cost_eur: Annotated[
        FutureFigure | None,
        Field(
            description="Of energy, and of stock that is missing at the end; null likewise",
            json_schema_extra={"unit": "EUR"}, examples=[34.8],
        ),
    ]  # fmt: skip
    score_eur: Annotated[
        FutureFigure,
        Field(
            description="Cost, waiting and vehicles that leave before they are full, at their prices",
            json_schema_extra={"unit": "EUR"}, examples=[51.1],
        ),
    ]  # fmt: skip


class ShadowStretch(BaseModel):
    """A stretch of a twin's time that is over."""

    from_s: Annotated[int, Field(ge=0, description="Its begin", json_schema_extra={"unit": "s"}, examples=[7200])]
    to_s: Annotated[int, Field(ge=0, description="Its end", json_schema_extra={"unit": "s"}, examples=[10_800])]
    state: Annotated[JobState, Field(description="Whether its runs are made", examples=["succeeded"])]
    problem: Annotated[JobProblem | None, Field(description="Why they are not", examples=[None])]
    acted: Annotated[
        bool,
        Field(
            description="Whether the first controller acted; else it is what the others are held against",
            examples=[True],
        ),
    ]
    changed: Annotated[bool, Field(description="Another controller decided before its end", examples=[False])]
    error_bar: Annotated[
        float | None,
        Field(
            ge=0,
            description="Largest distance of its run's pressures from those of the buffers, minute by minute: 0 where "
            "it is what happened to the last bit; null where who acted is not known",
            json_schema_extra={"unit": "bar"}, examples=[0.0],
        ),
    ]  # fmt: skip
    runs: Annotated[list[ShadowRun], Field(description="By controller, empty until they are made", examples=[[]])]


class ShadowSum(BaseModel):
    """What a controller would have made of a day, against the one that acted."""

    controller: ControllerSpec
    against: Annotated[list[ControllerSpec], Field(description="Who acted", examples=[["logic"]])]
    stretches: Annotated[int, Field(ge=1, description="Stretches that it has run", examples=[24])]
    better: Annotated[int, Field(ge=0, description="In which its score is less", examples=[19])]
    saves_eur: Annotated[
        FutureFigure | None,
        Field(
            description="Cost saved, each second counted once; null where none is told",
            json_schema_extra={"unit": "EUR"}, examples=[14.2],
        ),
    ]  # fmt: skip
    saves_score_eur: Annotated[
        FutureFigure, Field(description="The same of the score", json_schema_extra={"unit": "EUR"}, examples=[11.9])
    ]
    waits_s: Annotated[
        FutureFigure, Field(description="Wait added for each vehicle", json_schema_extra={"unit": "s"}, examples=[20.0])
    ]
    loses: Annotated[
        FutureFigure,
        Field(
            description="Vehicles added to those that leave before they are full, each second counted once",
            json_schema_extra={"unit": "vehicles"}, examples=[0.0],
        ),
    ]  # fmt: skip
    words: Annotated[
        str,
        Field(
            description="The same in words",
            examples=["minlp1 would have cost 14.20 EUR less and had 20 s more of waiting a vehicle than logic"],
        ),
    ]  # fmt: skip


class ShadowDay(BaseModel):
    """A day of 86 400 s from the twin's start; a stretch belongs to the day in which it begins."""

    day: Annotated[int, Field(ge=0, description="Number of the day", json_schema_extra={"unit": "index"}, examples=[0])]
    sums: Annotated[list[ShadowSum], Field(description="The controller that saves most first", examples=[[]])]


class TwinShadow(BaseModel):
    """The shadows of a twin."""

    twin: Annotated[str, Field(description="Id of the twin", examples=["demo"])]
    settings: Annotated[ShadowRequest | None, Field(description="Null where nothing is compared now", examples=[None])]
    lasting: Annotated[
        int, Field(ge=0, description="Stretches that are not over", json_schema_extra={"unit": "1"}, examples=[4])
    ]
    left_out: Annotated[
        int,
        Field(
            ge=0, description="Stretches left out since more were over than could be run",
            json_schema_extra={"unit": "1"}, examples=[0],
        ),
    ]  # fmt: skip
    days: Annotated[list[ShadowDay], Field(description="The newest first", examples=[[]])]
    stretches: Annotated[list[ShadowStretch], Field(description="Those kept, the newest first", examples=[[]])]
