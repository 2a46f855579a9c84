"""The REST application: routes, problems, the guard, and the service it opens and closes."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from importlib.metadata import version

import orjson
from asgi_correlation_id import CorrelationIdMiddleware
from fastapi import Depends, FastAPI, Request
from starlette.concurrency import run_in_threadpool
from starlette.responses import Response

from api.calibrations.routes import router as calibrations
from api.certificates.routes import router as certificates
from api.comparisons.routes import router as comparisons
from api.controllers.routes import router as controllers
from api.forecasts.routes import router as forecasts
from api.http import etags, problems
from api.http.arrivals import ArrivalMiddleware
from api.http.authentication import AuthenticationMiddleware, is_open
from api.http.authorization import RequiredScopes
from api.http.bodies import lane
from api.http.body_types import BodyTypes
from api.http.dependencies import provide
from api.http.rate_limits import RateLimiter, RateLimitMiddleware
from api.http.request_log import RequestLogMiddleware, accepted_request_id, new_request_id
from api.http.unread_input import check_query, check_unread
from api.keys.routes import router as keys
from api.page import routes as page
from api.runs.routes import router as runs
from api.scenarios.routes import router as scenarios
from api.server import openapi
from api.server.health import router as health
from api.server.services import Services
from api.settings import Settings
from api.shadows.routes import router as shadows
from api.things.routes import router as things
from api.twins.alarm_routes import router as alarms
from api.twins.drill_routes import router as drills
from api.twins.figure_routes import router as figures
from api.twins.measurement_routes import router as measurements
from api.twins.note_routes import router as notes
from api.twins.routes import router as twins

RESOURCES = (
    scenarios, controllers, runs, comparisons, twins, alarms, drills, figures, notes, measurements, calibrations,
    forecasts, shadows, certificates, keys, things,
)  # fmt: skip
"""Routers of all resources; each route that changes something declares the scope it needs."""


def create_app(settings: Settings) -> FastAPI:
    """The application for these settings; it opens its service when it is started."""
    opened = Services(settings)

    @asynccontextmanager
    async def lifespan(_app: FastAPI) -> AsyncIterator[None]:
        opened.open()
        try:
            yield
        finally:
            opened.close()

    app = FastAPI(
        title="hrs-twin",
        version=version("hrs-twin"),
        lifespan=lifespan,
        openapi_url=None,
        docs_url=None,
        redoc_url=None,
        generate_unique_id_function=lambda route: route.name,
    )
    app.state.services = opened
    provide(app, opened.parts())
    app.state.large_bodies = lane()
    for router in RESOURCES:
        app.include_router(router, dependencies=[Depends(check_query), Depends(check_unread)])
    app.include_router(health)  # probes may ask with parameters of their own
    page.install(app)
    problems.install(app)
    etags.install(app)
    limits = RateLimiter(settings)
    app.add_middleware(RateLimitMiddleware, limits=limits, open_to_all=is_open)
    required = RequiredScopes((*RESOURCES, health))
    app.add_middleware(
        AuthenticationMiddleware, settings=settings, keys=opened.keys, limits=limits, required=required,
        body_types=BodyTypes(RESOURCES),
    )  # fmt: skip
    app.add_middleware(ArrivalMiddleware)
    app.add_middleware(RequestLogMiddleware, metrics=opened.metrics, access_log=settings.access_log)
    app.add_middleware(
        CorrelationIdMiddleware, header_name="X-Request-ID", update_request_header=False,
        generator=new_request_id, validator=None, transformer=accepted_request_id,
    )  # fmt: skip
    app.add_route("/openapi.json", _document, include_in_schema=False)
    app.openapi = lambda: openapi.document(app, keys_required=settings.keys_required)  # type: ignore[method-assign]
    return app


async def _document(request: Request) -> Response:
    """The OpenAPI document, written once."""
    kept: bytes | None = getattr(request.app.state, "openapi_json", None)
    if kept is None:
        document = await run_in_threadpool(request.app.openapi)  # half a second of work, for the first who asks
        kept = request.app.state.openapi_json = orjson.dumps(document)
    return Response(kept, media_type="application/json")
