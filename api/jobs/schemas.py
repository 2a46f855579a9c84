"""Jobs as answers show them, whatever they compute."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any

from pydantic import BaseModel, Field

from api.http.problems import FieldProblem
from api.moments import moment
from api.store.records import Job, JobState

ControllerSpec = Annotated[
    str,
    Field(
        min_length=1,
        max_length=200,
        description="Name, options behind colons: see /v1/controllers",
        examples=["minlp1:horizon=2"],
    ),
]


class FailedRun(BaseModel):
    """Which run of a comparison failed."""

    scenario: Annotated[str, Field(description="Name of the scenario", examples=["S1"])]
    controller: ControllerSpec
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


def status_of(job: Job) -> dict[str, Any]:
    """The fields every job shows."""
    return {
        "id": job.id, "state": job.state, "created": moment(job.created), "started": moment(job.started),
        "finished": moment(job.finished), "problem": job.error,
    }  # fmt: skip
