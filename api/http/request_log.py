"""Every request: its id, its line in the log, its place in the metrics, and an answer whatever is raised."""

from __future__ import annotations

import logging
import re
import secrets
import time

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from api.http.origins import isolated
from api.http.problems import problem_from
from api.metrics import ServiceMetrics

log = logging.getLogger(__name__)

_SANE = re.compile(r"[A-Za-z0-9._:/+=-]{1,128}")
"""Ids of askers that can do no harm in a log."""


def new_request_id() -> str:
    """An id for a request that brings none."""
    return secrets.token_hex(8)


def accepted_request_id(asked: str) -> str:
    """The asker's id where it can do no harm in a log, else a new one; no line says so, however many come."""
    return asked if _SANE.fullmatch(asked) else new_request_id()


class RequestLogMiddleware:
    """ASGI middleware around everything but the request's id; a stream passes through it piece by piece."""

    def __init__(self, app: ASGIApp, metrics: ServiceMetrics, *, access_log: bool) -> None:
        self._app = app
        self._metrics = metrics
        self._access_log = access_log

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, count and log; other than requests are passed on."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        began = time.perf_counter()
        status = 0

        async def tagged(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                message["headers"] = isolated(list(message.get("headers", ())))
                self._told(scope, status, time.perf_counter() - began)
            await send(message)

        try:
            await self._app(scope, receive, tagged)
        except Exception as error:
            if status:
                raise  # too late for another answer
            await problem_from(error).response()(scope, receive, tagged)

    def _told(self, scope: Scope, status: int, seconds: float) -> None:
        method, route = scope["method"], route_of(scope)
        self._metrics.answered(method, route, status, seconds)
        if self._access_log:
            fields = {"method": method, "route": route, "status": status, "seconds": round(seconds, 6)}
            sent = scope.get("raw_path") or scope["path"].encode()  # still escaped: no line of its own in a log
            log.info("%s %s %d", method, sent.decode("latin-1"), status, extra=fields)


def route_of(scope: Scope) -> str:
    """Template of the route that answered, so that there are no more names than routes."""
    path = getattr(scope.get("route"), "path", None)
    if path is not None:
        return str(path)
    return "/static" if scope["path"].startswith("/static/") else "(none)"
