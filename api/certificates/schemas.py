"""Questions about switched systems as jobs, and how answers show them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

from pydantic import BaseModel, Field

from api.certificates.questions import Answer, Ask
from api.http.pagination import Next
from api.jobs.schemas import JobStatus, status_of
from api.store.records import Job, JobState


class CertificateJob(JobStatus):
    """A question and, when it is done, its answer."""

    ask: Annotated[Ask, Field(description="What was asked", examples=["stability"])]
    modes: Annotated[int, Field(ge=1, description="Number of modes", examples=[2])]
    states: Annotated[int, Field(ge=1, description="Number of states", examples=[2])]
    constraint: Annotated[str, Field(description="Kind of constraint", examples=["persistent"])]
    answer: Annotated[
        Answer | None,
        Field(description="Null until done", examples=[{"certified": True, "claim": "...", "seconds": 0.1}]),
    ]


class CertificatePage(BaseModel):
    """Questions, the newest first; their answers without documents."""

    items: Annotated[list[CertificateJob], Field(description="Questions", examples=[[]])]
    next: Next


def certificate_of(job: Job, rows: Sequence[dict[str, Any]], *, whole: bool = True) -> CertificateJob:
    """A stored question as answers show it; `rows` hold the answer, if there is one."""
    done = job.state is JobState.SUCCEEDED and bool(rows)
    answer = Answer(**rows[0]) if done else None
    if answer is not None and not whole:
        answer.document = None
    about = job.summary
    return CertificateJob(
        **status_of(job), ask=about["ask"], modes=about["modes"], states=about["states"],
        constraint=about["constraint"], answer=answer,
    )  # fmt: skip
