"""Twins as answers show them: what each does, where it stands, and what came of its day."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, Field

from api.http.pagination import Next
from api.jobs.schemas import ControllerSpec
from api.scenarios.schemas import Seed
from api.twins.schemas import Id, Second, Source, Speed, TwinStateName
from station.alarm_rules import Priority
from station.live import AtEnd


class AlarmCounts(BaseModel):
    """How many alarms of a twin are shown."""

    announced: Annotated[int, Field(ge=0, description="Alarms shown now", examples=[1])]
    unacknowledged: Annotated[int, Field(ge=0, description="Of which nobody has acknowledged", examples=[1])]
    highest: Annotated[
        Priority | None,
        Field(description="The highest priority among them; null where there is none", examples=["low"]),
    ]


class TwinToday(BaseModel):
    """Some figures of the running day of a twin; all of them are at `/v1/twins/{id}/days`."""

    vehicles_served: Annotated[int, Field(ge=0, description="Left with a full tank", examples=[39])]
    vehicles_incomplete: Annotated[int, Field(ge=0, description="Left before", examples=[0])]
    wait_mean_s: Annotated[
        float | None, Field(ge=0, description="Mean wait", json_schema_extra={"unit": "s"}, examples=[84.5])
    ]
    delivered_kg: Annotated[
        float, Field(ge=0, description="Dispensed", json_schema_extra={"unit": "kg"}, examples=[177.1])
    ]
    energy_kwh: Annotated[
        float | None, Field(ge=0, description="Electric", json_schema_extra={"unit": "kWh"}, examples=[310.2])
    ]
    eur_per_kg: Annotated[
        float | None,
        Field(ge=0, description="Cost, by a tariff", json_schema_extra={"unit": "EUR/kg"}, examples=[0.49]),
    ]


class TwinState(BaseModel):
    """A twin and where it stands."""

    id: Id
    state: Annotated[TwinStateName, Field(description="What it does", examples=["running"])]
    scenario: Annotated[str, Field(description="Name of its scenario", examples=["S1"])]
    station: Annotated[str, Field(description="Name of its station", examples=["thesis-fit"])]
    source: Annotated[Source, Field(description="Where its seconds come from", examples=["simulated"])]
    controller: ControllerSpec
    service: Annotated[
        Literal["certified", "uncertified"],
        Field(description="Whether a verified certificate of service belongs to it", examples=["uncertified"]),
    ]
    speed: Speed
    at_end: Annotated[AtEnd, Field(description="What it does when its vehicles are served", examples=["repeat"])]
    replication: Annotated[int, Field(ge=0, description="First replication", examples=[0])]
    seed: Seed
    calibration: Annotated[
        str | None,
        Field(description="Calibration that found the station it was moved to; null before", examples=[None]),
    ]
    of: Annotated[
        str | None, Field(description="Twin that a replay plays, or with whose state it began", examples=[None])
    ]
    at_s: Annotated[Second | None, Field(description="Second at which it began with that state", examples=[None])]
    from_s: Annotated[Second | None, Field(description="First second that a replay plays", examples=[None])]
    to_s: Annotated[Second | None, Field(description="Last second that a replay plays", examples=[None])]
    layout: Annotated[
        str,
        Field(
            description="Which columns its samples have: `measured` those of what is followed, else those of a plant",
            examples=["thesis"],
        ),
    ]
    epoch: Annotated[int, Field(ge=0, description="Counts its starts: a restart of the service adds one", examples=[1])]
    samples: Annotated[
        int, Field(ge=0, description="Seconds simulated", json_schema_extra={"unit": "samples"}, examples=[3600])
    ]
    events: Annotated[int, Field(ge=0, description="Events told", json_schema_extra={"unit": "events"}, examples=[42])]
    alarms: Annotated[
        AlarmCounts | None,
        Field(description="Alarms that are shown; null of a replay, and of one that has ended", examples=[None]),
    ]
    today: Annotated[
        TwinToday | None,
        Field(description="Figures of its running day; null where it is not simulated here", examples=[None]),
    ]
    newest_sent: Annotated[
        float | None,
        Field(
            ge=0, description="When its newest sample was told here (Unix time); null where none was since it started",
            json_schema_extra={"unit": "s"}, examples=[1795252800.25],
        ),
    ]  # fmt: skip
    created: Annotated[str, Field(description="Started (UTC, ISO 8601)", examples=["2026-11-21T09:00:00.250000Z"])]
    values: Annotated[
        dict[str, float | None] | None,
        Field(
            description="Its newest sample by column; null before the first. Units as in /history",
            examples=[{"time": 3599.0, "pressure_high": 812.3, "outlet_high": 1, "vehicle": 3, "queue_length": 1}],
        ),
    ]
    ticks_late: Annotated[
        int,
        Field(
            ge=0,
            description="Ticks over 0.1 s late in this epoch",
            json_schema_extra={"unit": "ticks"},
            examples=[0],
        ),
    ]
    lateness_max_s: Annotated[
        float,
        Field(ge=0, description="Latest tick of this epoch", json_schema_extra={"unit": "s"}, examples=[0.003]),
    ]


class TwinPage(BaseModel):
    """Twins, the oldest first."""

    items: Annotated[list[TwinState], Field(description="Twins", examples=[[]])]
    next: Next
    complete: Annotated[
        bool,
        Field(description="False while the database does not answer: these are the twins in memory", examples=[True]),
    ] = True
