"""/v1/certificates: ask about a switched system; poll; read the proof, or check one."""

from __future__ import annotations

import json
from http import HTTPStatus
from typing import Annotated, Any

from fastapi import APIRouter, Body, Depends, Path, Request
from pydantic import BaseModel, Field
from starlette.responses import Response

from api.certificates.job import certificate_spec
from api.certificates.questions import Question
from api.certificates.schemas import CertificateJob, CertificatePage, certificate_of
from api.http.authorization import requires
from api.http.bodies import JsonRoute
from api.http.dependencies import JobsDep
from api.http.disconnection import Disconnected
from api.http.etags import ConditionalGet, ConditionalGetDep
from api.http.idempotency import IdempotentRequest, Keep
from api.http.pagination import Paged
from api.http.problems import conflict, not_found
from api.jobs.endpoints import ChecksDep, JobQueueDep, StateFilter, cancel, newest, remove
from api.scopes import Scope
from api.store.jobs import JobRepository
from api.store.records import Job, JobKind

router = APIRouter(prefix="/v1/certificates", tags=["certificates"], route_class=JsonRoute)

Id = Annotated[
    str, Path(max_length=40, description="Id of a certificate", examples=["certificate-019a7c3f2b10a1b2c3d4"])
]


class Verification(BaseModel):
    """The checker's verdict on a document."""

    verified: Annotated[
        bool, Field(description="Whether every inequality holds and every signal is covered", examples=[True])
    ]
    claim: Annotated[
        str, Field(description="What is proved, or why nothing is", examples=["for every admissible signal: ..."])
    ]
    inequalities: Annotated[
        int,
        Field(
            ge=0, description="Inequalities proved, in rational arithmetic; none in a certificate of service",
            examples=[12],
        ),
    ] = 0  # fmt: skip


@router.post("", status_code=202, response_model=CertificateJob)
@requires(Scope.RUN)
def submit_certificate(question: Question, queue: JobQueueDep, idempotent: IdempotentRequest) -> Response:
    """Queue a question; its place is in `Location`. An ill-posed one, or one too large, is refused at once."""
    from api.certificates import service

    def submit(keep: Keep[Job] | None) -> Job:
        service.check(question)
        return queue.submit(JobKind.CERTIFICATE, certificate_spec(question), keep)

    return idempotent.answer(
        HTTPStatus.ACCEPTED, submit, lambda job: (f"/v1/certificates/{job.id}", certificate_of(job, []))
    )


async def _content(request: Request) -> bytes:
    """The body as it came."""
    return await request.body()


@router.post("/verify")
@requires(Scope.READ)
def verify_certificate(
    document: Annotated[
        dict[str, Any], Body(description="A certificate document", examples=[{"format": "hrs-certificate"}])
    ],
    content: Annotated[bytes, Depends(_content)],
    checks: ChecksDep,
    client: Disconnected,
) -> Verification:
    """Check a document of either kind: exactly, without a solver, and without trust in its words.

    One about a switched system is proved in rational arithmetic; a certificate of service is computed anew, which takes
    seconds. It is checked in a process with limits of time and memory; beyond them (422 `too-large`) nothing is said
    of it.
    """
    return Verification.model_validate(checks.certificate(document, content, client))


@router.get("")
def list_certificates(jobs: JobsDep, page: Paged, state: StateFilter = None) -> CertificatePage:
    """Questions, the newest first; answers without their documents."""
    found, cursor = newest(jobs, JobKind.CERTIFICATE, state, page)
    rows = jobs.results_of([job.id for job in found])
    items = [certificate_of(job, rows.get(job.id, []), whole=False) for job in found]
    return CertificatePage(items=items, next=cursor)


@router.get("/{certificate_id}")
def get_certificate(certificate_id: Id, jobs: JobsDep, conditional: ConditionalGetDep) -> CertificateJob:
    """Where a question stands and, when it is done, its answer with the document."""
    return _shown(certificate_id, jobs, conditional)


def _shown(certificate_id: str, jobs: JobRepository, conditional: ConditionalGet | None = None) -> CertificateJob:
    found = jobs.get_with_result(certificate_id)
    if found is None or found[0].kind is not JobKind.CERTIFICATE:
        raise not_found("certificate", certificate_id)
    if conditional is not None:
        conditional.ended(found[0])
    return certificate_of(*found)


@router.get(
    "/{certificate_id}/document",
    responses={200: {"description": "The document", "content": {"application/json": {"schema": {"type": "object"}}}}},
)
def get_document(certificate_id: Id, jobs: JobsDep, conditional: ConditionalGetDep) -> Response:
    """The certificate (or counterproof) alone: what `hrs verify` reads."""
    found = _shown(certificate_id, jobs, conditional).answer
    if found is None or found.document is None:
        raise conflict(f"certificate {certificate_id!r} has no document")
    return Response(json.dumps(found.document) + "\n", media_type="application/json", headers=conditional.headers)


@router.post("/{certificate_id}/cancel")
@requires(Scope.RUN)
def cancel_certificate(certificate_id: Id, jobs: JobsDep) -> CertificateJob:
    """End a question where it stands; one that has ended stays as it is."""
    cancel(jobs, JobKind.CERTIFICATE, certificate_id)
    return _shown(certificate_id, jobs)


@router.delete("/{certificate_id}", status_code=204)
@requires(Scope.RUN)
def delete_certificate(certificate_id: Id, jobs: JobsDep) -> None:
    """Forget a question that has ended."""
    remove(jobs, JobKind.CERTIFICATE, certificate_id)
