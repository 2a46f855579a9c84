"""Admission of requests: the host that one names, the key that it carries, the size of its body."""

from __future__ import annotations

import re
from collections.abc import Collection
from http import HTTPStatus

from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from api.http.authorization import RequiredScopes
from api.http.body_types import BodyTypes, media_type
from api.http.origins import SAFE_METHODS, check_origin
from api.http.problems import ProblemError, problem_from
from api.http.rate_limits import RateLimiter
from api.http.unread_input import has_body
from api.scopes import allows
from api.settings import Settings, is_loopback
from api.store.keys import KeyRepository

OPEN_PATHS = ("/", "/docs", "/openapi.json", "/livez", "/readyz")
"""The page, like the files below OPEN_FOLDER, holds no data: a browser must load it before it can ask for a key.

Who looks whether the service is there carries no key.
"""

OPEN_FOLDER = "/static/"


BODIES_BYTES_MAX = 256_000_000
"""Bodies in memory at once: 64 of the largest. Each is bounded, but thousands of connections may bring one each."""

RETRY_S = 2
"""When to come again with a body [s]."""


def is_open(path: str) -> bool:
    """Whether a path is answered without a key."""
    return path in OPEN_PATHS or path.startswith(OPEN_FOLDER)


_PORT = re.compile(r":[0-9]*$")

_JSON = re.compile(r"application/([a-z0-9.+-]+\+)?json\s*(;.*)?", re.IGNORECASE)


class AuthenticationMiddleware:
    """ASGI middleware in front of every request."""

    def __init__(
        self, app: ASGIApp, settings: Settings, keys: KeyRepository, limits: RateLimiter, required: RequiredScopes,
        body_types: BodyTypes,
    ) -> None:  # fmt: skip
        self._body_types = body_types
        self._limits = limits
        self._required = required
        self._held = 0  # of all bodies that are in memory [bytes]; the event loop alone counts
        self._held_max = max(BODIES_BYTES_MAX, settings.body_bytes_max)
        self._app = app
        self._settings = settings
        self._keys = keys

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let a request through, or answer a problem."""
        if scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})  # there are none
            return
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        try:
            _check_host(headers)
            if not (scope["method"] in SAFE_METHODS and is_open(scope["path"])):
                check_origin(scope["method"], headers, self._settings.allowed_origins)
            scope["hrs_owner"] = await self._admit(scope, headers)
            self._check_size(headers.get("content-length", "0"))
            _check_type(headers, self._body_types.of(scope["method"], scope["path"]))
        except Exception as error:  # noqa: BLE001  # whatever it is, nobody gets in
            await problem_from(error).response()(scope, receive, send)
            return
        body = _Body()
        try:
            await self._app(scope, self._counted(receive, body), send)
        finally:
            self._held -= body.size

    async def _admit(self, scope: Scope, headers: Headers) -> str:
        """Whose key it is; empty where none is needed."""
        if not self._settings.keys_required:
            host = _PORT.sub("", headers.get("host", ""))
            if not is_loopback(host):  # a page elsewhere that has renamed itself to this address
                raise ProblemError(
                    HTTPStatus.MISDIRECTED_REQUEST, "host", "Wrong host",
                    f"only a loopback name is served; given the Host {host!r:.100}",
                )  # fmt: skip
            return ""
        if is_open(scope["path"]):
            return ""
        scheme, _, key = headers.get("authorization", "").partition(" ")
        held = await run_in_threadpool(self._keys.valid, key.strip()) if scheme.lower() == "bearer" else None
        if held is None:
            self._limits.take("", scope)
            raise ProblemError(
                HTTPStatus.UNAUTHORIZED,
                "key",
                "Key needed",
                "send `Authorization: Bearer KEY`; `hrs keys create` makes one",
            )
        wanted = self._required.of(scope["method"], scope["path"])
        if not allows(held.scopes, wanted):
            self._limits.take(held.name, scope)
            may = ", ".join(held.scopes)
            raise ProblemError(
                HTTPStatus.FORBIDDEN, "scope", "Not with this key", f"this needs the scope {wanted}; the key has {may}"
            )
        return held.name

    def _check_size(self, size: str) -> None:
        if not (size.isascii() and size.isdigit()) or int(size) > self._settings.body_bytes_max:
            raise self._too_large()

    def _too_large(self) -> HTTPException:
        limit = self._settings.body_bytes_max
        return HTTPException(413, f"a body must not exceed {limit} bytes (setting body_bytes_max)")

    def _counted(self, receive: Receive, body: _Body) -> Receive:
        async def counting() -> Message:
            message = await receive()
            size = len(message.get("body", b""))
            body.size += size
            self._held += size
            if body.size > self._settings.body_bytes_max:  # sent in pieces, without a length
                raise self._too_large()
            if self._held > self._held_max:
                raise ProblemError(
                    HTTPStatus.SERVICE_UNAVAILABLE, "busy", "Too busy",
                    f"bodies of {self._held_max} bytes are being read at once, and no more", retry_after_s=RETRY_S,
                )  # fmt: skip
            return message

        return counting


class _Body:
    """The part of a request's body that is in memory until it is answered."""

    size = 0  # [bytes]


def _check_host(headers: Headers) -> None:
    """A request names one host: of two, a proxy may have looked at the other (RFC 9112, 3.2)."""
    given = len(headers.getlist("host"))
    if given > 1:
        raise ProblemError(
            HTTPStatus.BAD_REQUEST, "malformed", "Malformed request", f"there must be one Host; given {given}"
        )


def _check_type(headers: Headers, others: Collection[str]) -> None:
    """A body must be JSON that calls itself JSON, or what its route declares: no form of another page can send that."""
    given = headers.get("content-type", "")
    if has_body(headers) and not _JSON.fullmatch(given) and media_type(given) not in others:
        taken = ", ".join(sorted(others)) or "application/json"
        raise ProblemError(
            HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "media-type", "Body is not JSON",
            f"a body must have the Content-Type {taken}; given {given!r:.100}",
        )  # fmt: skip
