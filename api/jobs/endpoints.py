"""Functions and dependencies that the routes of all kinds of jobs share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

from fastapi import Depends, Query

from api.http.dependencies import provided
from api.http.pagination import Page
from api.http.problems import conflict, not_found
from api.jobs.checks import Checks
from api.jobs.job_queue import JobQueue
from api.store.jobs import JobRepository
from api.store.records import Job, JobKind, JobState

StateFilter = Annotated[JobState | None, Query(description="Only jobs in this state", examples=["running"])]

JobQueueDep = Annotated[JobQueue, Depends(provided(JobQueue))]
ChecksDep = Annotated[Checks, Depends(provided(Checks))]


def newest(jobs: JobRepository, kind: JobKind, state: JobState | None, page: Page) -> tuple[Sequence[Job], str | None]:
    """The jobs of a page, the newest first, and the cursor behind them."""
    found = jobs.newest(kind, state=state, behind=page.behind(float, str), limit=page.limit + 1)
    return page.turn(found, lambda job: (job.created, job.id))


def job_of(jobs: JobRepository, kind: JobKind, job_id: str) -> Job:
    """The job of that kind with that id; NotFound if there is none."""
    job = jobs.get(job_id)
    if job is None or job.kind is not kind:
        raise not_found(kind.value, job_id)
    return job


def cancel(jobs: JobRepository, kind: JobKind, job_id: str) -> None:
    """End a job where it stands; one that has ended stays as it is."""
    jobs.cancel(job_of(jobs, kind, job_id).id)


def remove(jobs: JobRepository, kind: JobKind, job_id: str) -> None:
    """Forget a job that has ended; Conflict otherwise."""
    job = job_of(jobs, kind, job_id)
    if not job.state.final:
        raise conflict(f"{job.kind} {job.id!r} is {job.state}; cancel it first")
    jobs.remove(job.id)
