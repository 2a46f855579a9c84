"""Runs as requests order them and answers show them."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import Annotated, Any

from pydantic import BaseModel, Field

from api.http.pagination import Next
from api.http.problems import FieldProblem
from api.http.strict import Body
from api.moments import moment
from api.packing import Kept
from api.scenarios.schemas import ScenarioInput
from api.store.records import Job, JobState
from station.metrics import UNITS
from station.whole import WHOLE

Seed = Annotated[int, Field(ge=0, le=2**63 - 1, description="Seed of replications from 1 on", examples=[0]), WHOLE]
Replication = Annotated[
    int,
    Field(ge=0, le=1_000_000, description="0 is the law's quantile pattern, others are drawn", examples=[0]),
    WHOLE,
]
Controller = Annotated[
    str,
    Field(
        min_length=1,
        max_length=200,
        description="Name, options behind colons: see /v1/controllers",
        examples=["minlp1:horizon=2"],
    ),
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
    controller: Controller = "logic"
    replication: Replication = 0
    seed: Seed = 0
    record: Keeping = Kept.FULL


class FailedRun(BaseModel):
    """Which run of a comparison failed."""

    scenario: Annotated[str, Field(description="Name of the scenario", examples=["S1"])]
    controller: Controller
    replication: Annotated[int, Field(ge=0, description="Replication", examples=[0])]


class JobProblem(BaseModel):
    """Why a job failed."""

    title: Annotated[str, Field(description="Kind of failure", examples=["ControllerError"])]
    detail: Annotated[str, Field(description="What happened", examples=["controller 'mine' failed at 12 s"])] = ""
    errors: Annotated[list[FieldProblem], Field(description="Wrong fields", examples=[[]])] = []
    run: Annotated[
        FailedRun | None,
        Field(
            description="Of a comparison, the run that failed and ended it",
            examples=[{"scenario": "S1", "controller": "mine", "replication": 0}],
        ),
    ] = None


class JobStatus(BaseModel):
    """Where a job stands."""

    id: Annotated[str, Field(description="Id; later jobs have later ids", examples=["run-019a7c3f2b10a1b2c3d4"])]
    state: Annotated[JobState, Field(description="The last three are final", examples=["succeeded"])]
    created: Annotated[datetime, Field(description="Submitted (UTC)", examples=["2026-11-21T09:00:00Z"])]
    started: Annotated[datetime | None, Field(description="First work (UTC)", examples=["2026-11-21T09:00:01Z"])]
    finished: Annotated[datetime | None, Field(description="End (UTC)", examples=["2026-11-21T09:00:02Z"])]
    problem: Annotated[
        JobProblem | None, Field(description="Why it failed", examples=[{"title": "ControllerError", "detail": "..."}])
    ]


class Run(JobStatus):
    """A run and, when it is done, its figures of merit."""

    scenario: Annotated[str, Field(description="Name of the scenario", examples=["S1"])]
    station: Annotated[str, Field(description="Name of the station", examples=["thesis-fit"])]
    controller: Controller
    replication: Annotated[int, Field(ge=0, description="Replication", examples=[0])]
    seed: Seed
    record: Keeping
    metrics: Annotated[
        dict[str, float | None] | None,
        Field(
            description="Figures of merit by name; null until done, and where one is not finite",
            json_schema_extra={"units": UNITS},
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


class SeriesTable(BaseModel):
    """Series, column by column."""

    units: Annotated[
        dict[str, str], Field(description="Unit of each column", examples=[{"time": "s", "pressure_high": "bar"}])
    ]
    columns: Annotated[
        dict[str, list[float | None]],
        Field(
            description="Figures, one a row; null where there is none (no vehicle connected)",
            examples=[{"time": [0, 1], "pressure_high": [886.77, 884.68]}],
        ),
    ]


def status_of(job: Job) -> dict[str, Any]:
    """The fields every job shows."""
    return {
        "id": job.id, "state": job.state, "created": moment(job.created), "started": moment(job.started),
        "finished": moment(job.finished), "problem": job.error,
    }  # fmt: skip


def run_of(job: Job, rows: Sequence[dict[str, Any]]) -> Run:
    """A stored run as answers show it; `rows` are its results so far."""
    about = job.about
    done = job.state is JobState.SUCCEEDED
    return Run(
        **status_of(job),
        scenario=about["scenario"],
        station=about["station"],
        controller=about["controller"],
        replication=about["replication"],
        seed=about["seed"],
        metrics={name: rows[0][name] for name in UNITS} if done and rows else None,
        record=Kept(about.get("record", Kept.FULL)),
        series=f"/v1/runs/{job.id}/series" if done and about.get("record", Kept.FULL) == Kept.FULL else None,
    )
