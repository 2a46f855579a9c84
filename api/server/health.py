"""/livez, /readyz and /metrics: what probes and Prometheus ask."""

from __future__ import annotations

import time
from http import HTTPStatus
from typing import Annotated, Literal

from fastapi import APIRouter, Request
from prometheus_client.exposition import choose_encoder
from pydantic import BaseModel, Field
from starlette.responses import Response

from api.http.problems import ProblemError
from api.server.services import ServicesDep
from api.store.size import StoreRoom

_BYTES = {"unit": "bytes"}

router = APIRouter(tags=["operations"])


class Alive(BaseModel):
    """The process answers."""

    status: Annotated[Literal["alive"], Field(description="It is", examples=["alive"])] = "alive"
    sent: Annotated[
        float, Field(ge=0, description="Unix time", json_schema_extra={"unit": "s"}, examples=[1795252800.25])
    ]


class Room(BaseModel):
    """The room that the store takes, and may take."""

    bytes: Annotated[
        int | None,
        Field(
            ge=0,
            description="Taken; null while the store does not say",
            json_schema_extra=_BYTES,
            examples=[73_400_320],
        ),
    ]
    bytes_max: Annotated[
        int | None,
        Field(ge=0, description="Setting store_bytes_max", json_schema_extra=_BYTES, examples=[10_000_000_000]),
    ]
    disk_free_bytes: Annotated[
        int | None,
        Field(
            ge=0, description="Left on its disk; null where the database is another machine's",
            json_schema_extra=_BYTES, examples=[20_000_000_000],
        ),
    ]  # fmt: skip
    full: Annotated[
        bool, Field(description="Whether new jobs and twins are refused (507); all else goes on", examples=[False])
    ]


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
    store: Annotated[
        Room,
        Field(
            description="Room in the store",
            examples=[{"bytes": 73_400_320, "bytes_max": None, "disk_free_bytes": 20_000_000_000, "full": False}],
        ),
    ]


@router.get("/livez")
async def get_alive() -> Alive:
    """Whether the process answers; asks nothing else. Open without a key."""
    return Alive(sent=time.time())


@router.get("/readyz")
async def get_ready(opened: ServicesDep) -> Ready:
    """Whether database, migrations, zenoh session and worker processes are there; else 503 naming those that are not.

    Open without a key.
    """
    failed = await opened.threads.run(True, opened.readiness.failures)
    if failed:
        raise ProblemError(
            HTTPStatus.SERVICE_UNAVAILABLE, "not-ready", "Not ready", f"not ready: {', '.join(failed)}",
            errors=list(failed.items()), retry_after_s=1,
        )  # fmt: skip
    room = await opened.threads.run(True, _room, opened.room)
    return Ready(checks=dict.fromkeys(opened.readiness.names, "ok"), store=room)


def _room(found: StoreRoom) -> Room:
    size = found.size()
    return Room(
        bytes=size.used if size else None, bytes_max=found.used_max,
        disk_free_bytes=size.disk_free if size else None, full=bool(found.full()),
    )  # fmt: skip


@router.get(
    "/metrics",
    responses={
        200: {"description": "Prometheus text format", "content": {"text/plain": {"schema": {"type": "string"}}}}
    },
    response_class=Response,
)
async def get_metrics(request: Request, opened: ServicesDep) -> Response:
    """The service's measures of itself, for Prometheus; needs a key where keys are needed."""
    encode, media_type = choose_encoder(request.headers.get("accept", ""))
    content = await opened.threads.run(True, encode, opened.metrics.registry)
    return Response(content, media_type=media_type)
