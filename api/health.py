"""/livez, /readyz and /metrics: what probes and Prometheus ask."""

from __future__ import annotations

from http import HTTPStatus
from typing import Annotated, Literal

from fastapi import APIRouter, Request
from prometheus_client.exposition import choose_encoder
from pydantic import BaseModel, Field
from starlette.concurrency import run_in_threadpool
from starlette.responses import Response

from api.problems import ProblemError
from api.services import Opened

router = APIRouter(tags=["operations"])


class Alive(BaseModel):
    """The process answers."""

    status: Annotated[Literal["alive"], Field(description="It is", examples=["alive"])] = "alive"


class Ready(BaseModel):
    """Everything the service depends on works."""

    status: Annotated[Literal["ready"], Field(description="It is", examples=["ready"])] = "ready"
    checks: Annotated[
        dict[str, Literal["ok"]],
        Field(
            description="What was looked at",
            examples=[dict.fromkeys(("database", "migrations", "zenoh", "workers"), "ok")],
        ),
    ]


@router.get("/livez")
async def get_alive() -> Alive:
    """Whether the process answers; asks nothing else. Open without a key."""
    return Alive()


@router.get("/readyz")
async def get_ready(opened: Opened) -> Ready:
    """Whether database, migrations, zenoh session and worker processes are there; else 503 naming those that are not.

    Open without a key.
    """
    failed = await run_in_threadpool(opened.readiness.failures)
    if failed:
        raise ProblemError(
            HTTPStatus.SERVICE_UNAVAILABLE, "not-ready", "Not ready", f"not ready: {', '.join(failed)}",
            errors=list(failed.items()), retry_after_s=1,
        )  # fmt: skip
    return Ready(checks=dict.fromkeys(opened.readiness.names, "ok"))


@router.get(
    "/metrics",
    responses={
        200: {"description": "Prometheus text format", "content": {"text/plain": {"schema": {"type": "string"}}}}
    },
    response_class=Response,
)
def get_metrics(request: Request, opened: Opened) -> Response:
    """What the service measures of itself, for Prometheus; needs a key where keys are needed."""
    encode, media_type = choose_encoder(request.headers.get("accept", ""))
    return Response(encode(opened.metrics.registry), media_type=media_type)
