"""Runs as requests order them and answers show them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

from pydantic import BaseModel, Field

from api.http.pagination import Next
from api.http.strict import Body
from api.jobs.schemas import ControllerSpec, JobStatus, status_of
from api.packing import Kept
from api.scenarios.schemas import ScenarioInput, Seed
from api.store.records import Job, JobState
from station.costs import COST_UNITS
from station.metrics import UNITS, units_of
from station.whole import WHOLE

Replication = Annotated[
    int,
    Field(ge=0, le=1_000_000, description="0 is the law's quantile pattern, others are drawn", examples=[0]),
    WHOLE,
]
Keeping = Annotated[
    Kept,
    Field(
        strict=False,
        description="What of its record is stored beside its figures: every second and vehicles (`full`), the table "
        "of vehicles alone, or neither",
        examples=["full"],
    ),
]

_EXAMPLE = {"t_total": 846.0, "t_comp": 1517.0, "t_dis": 1695.0, "delivered": 23.9}


class RunRequest(Body):
    """A controller on one replication of a scenario."""

    scenario: ScenarioInput
    controller: ControllerSpec = "logic"
    replication: Replication = 0
    seed: Seed = 0
    record: Keeping = Kept.FULL


class Run(JobStatus):
    """A run and, when it is done, its figures of merit."""

    scenario: Annotated[str, Field(description="Name of the scenario", examples=["S1"])]
    station: Annotated[str, Field(description="Name of the station", examples=["thesis-fit"])]
    controller: ControllerSpec
    replication: Annotated[int, Field(ge=0, description="Replication", examples=[0])]
    seed: Seed
    record: Keeping
    metrics: Annotated[
        dict[str, float | None] | None,
        Field(
            description="Figures of merit by name; null until done, where one is not finite; money by a tariff",
            json_schema_extra={"units": UNITS | COST_UNITS},
            examples=[_EXAMPLE],
        ),
    ]
    series: Annotated[
        str | None,
        Field(
            description="Where its series are, when done and kept",
            examples=["/v1/runs/run-019a7c3f2b10a1b2c3d4/series"],
        ),
    ]


class RunPage(BaseModel):
    """Runs, the newest first."""

    items: Annotated[list[Run], Field(description="Runs", examples=[[]])]
    next: Next


def run_of(job: Job, rows: Sequence[dict[str, Any]]) -> Run:
    """A stored run as answers show it; `rows` are its results so far."""
    about = job.summary
    done = job.state is JobState.SUCCEEDED
    return Run(
        **status_of(job),
        scenario=about["scenario"],
        station=about["station"],
        controller=about["controller"],
        replication=about["replication"],
        seed=about["seed"],
        metrics={name: rows[0][name] for name in units_of(rows)} if done and rows else None,
        record=Kept(about.get("record", Kept.FULL)),
        series=f"/v1/runs/{job.id}/series" if done and about.get("record", Kept.FULL) == Kept.FULL else None,
    )
