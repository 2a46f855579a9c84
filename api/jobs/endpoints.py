"""What the routes of runs, comparisons and certificates share: they are all jobs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

from fastapi import Query

from api.http.pagination import Page
from api.http.problems import conflict, not_found
from api.server.services import Services
from api.store.records import Job, JobKind, JobState

StateFilter = Annotated[JobState | None, Query(description="Only jobs in this state", examples=["running"])]


def newest(opened: Services, kind: JobKind, state: JobState | None, page: Page) -> tuple[Sequence[Job], str | None]:
    """The jobs of a page, the newest first, and the cursor behind them."""
    found = opened.jobs.newest(kind, state=state, behind=page.behind(float, str), limit=page.limit + 1)
    return page.turn(found, lambda job: (job.created, job.id))


def job_of(opened: Services, kind: JobKind, job_id: str) -> Job:
    """The job of that kind with that id; NotFound if there is none."""
    job = opened.jobs.get(job_id)
    if job is None or job.kind is not kind:
        raise not_found(kind.value, job_id)
    return job


def cancel(opened: Services, kind: JobKind, job_id: str) -> None:
    """End a job where it stands; one that has ended stays as it is."""
    opened.jobs.cancel(job_of(opened, kind, job_id).id)


def remove(opened: Services, kind: JobKind, job_id: str) -> None:
    """Forget a job that has ended; Conflict otherwise."""
    job = job_of(opened, kind, job_id)
    if not job.state.final:
        raise conflict(f"{job.kind} {job.id!r} is {job.state}; cancel it first")
    opened.jobs.remove(job.id)
