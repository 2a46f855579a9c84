"""Conditional requests (RFC 9110): ETag, If-None-Match and If-Match.

What has ended never changes: its tag comes from its id, so that a reader who has it costs no query for the content. A
twin's tag has two parts: what can be changed about it, and all it shows. If-None-Match compares both, to the last
sample; If-Match compares the first, since a twin that runs has another sample every second, which nobody changed.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from http import HTTPStatus
from importlib.metadata import version
from typing import Annotated

from fastapi import Depends, FastAPI, Header, Request
from starlette.responses import Response

from api.problems import ProblemError
from api.store.records import Job
from api.twins.schemas import TwinState

_RELEASE = version("hrs-twin")
"""Another version may answer otherwise."""

_CACHE = {"Cache-Control": "private, no-cache"}
"""Whoever keeps an answer asks each time whether it still holds."""

IfNoneMatch = Annotated[
    str | None,
    Header(
        description="ETag of the answer you have: 304 without a body if it still holds", examples=['"3c1a-90fe8d1b"']
    ),
]
IfMatch = Annotated[
    str | None,
    Header(
        description="ETag of the twin as you know it: 412 if somebody has changed it since",
        examples=['"3c1a-90fe8d1b"'],
    ),
]


class Unchanged(Exception):  # noqa: N818  # as in HTTP 304
    """The asker has the answer."""

    def __init__(self, headers: dict[str, str]) -> None:
        super().__init__("unchanged")
        self.headers = headers


class Cached:
    """A GET whose asker may have the answer; `headers` go out with it."""

    def __init__(self, request: Request, response: Response, held: str | None) -> None:
        self._url = f"{request.url.path}?{request.url.query}"
        self._response = response
        self._held = held
        self.headers: dict[str, str] = {}

    def ended(self, job: Job) -> None:
        """The answer holds for ever if the job has ended. Raises Unchanged for who has it."""
        if job.state.final:
            self._tag(_digest(_RELEASE, job.id, job.state, str(job.finished), self._url))

    def twin(self, state: TwinState) -> None:
        """The answer is this twin. Raises Unchanged for who has it."""
        self._tag(twin_tag(state))

    def tagged(self, answer: Response) -> Response:
        """An answer with the headers."""
        answer.headers.update(self.headers)
        return answer

    def _tag(self, tag: str) -> None:
        self.headers = {"ETag": f'"{tag}"', **_CACHE}
        self._response.headers.update(self.headers)
        if self._held is not None and any(held in {"*", tag} for held in _tags(self._held)):
            raise Unchanged(self.headers)


class Expected:
    """A request that changes a twin, perhaps only as its asker knows it."""

    def __init__(self, response: Response, held: str | None) -> None:
        self._response = response
        self._held = held

    def check(self, state: TwinState) -> None:
        """Raise a problem if the asker knows another."""
        if self._held is None:
            return
        changeable = twin_tag(state).partition("-")[0]
        if not any(held == "*" or held.partition("-")[0] == changeable for held in _tags(self._held, strong=True)):
            raise ProblemError(
                HTTPStatus.PRECONDITION_FAILED, "changed", "Changed since",
                f"twin {state.id!r} is not as If-Match says: read it again",
                errors=[("If-Match", "names another state")],
            )  # fmt: skip

    def now(self, state: TwinState) -> TwinState:
        """The twin as it is now, with its tag."""
        self._response.headers["ETag"] = f'"{twin_tag(state)}"'
        return state


def twin_tag(state: TwinState) -> str:
    """What can be changed about a twin, and all it shows, as digests."""
    changeable = _digest(state.created, state.state, state.controller, str(state.speed), state.service)
    return f"{changeable[:16]}-{_digest(state.model_dump_json())[:16]}"


def _digest(*parts: str) -> str:
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:32]


def _tags(header: str, *, strong: bool = False) -> Iterator[str]:
    for given in header.split(","):
        tag = given.strip()
        if tag.startswith("W/"):
            if strong:
                continue
            tag = tag.removeprefix("W/")
        yield tag.strip('"')


def install(app: FastAPI) -> None:
    """Answer who has the answer."""

    async def answer(_request: Request, error: Exception) -> Response:
        return Response(status_code=HTTPStatus.NOT_MODIFIED, headers=getattr(error, "headers", {}))

    app.add_exception_handler(Unchanged, answer)


async def cached(request: Request, response: Response, if_none_match: IfNoneMatch = None) -> Cached:
    """A request as a GET whose asker may have the answer; async, as below, so that no thread is taken for it."""
    return Cached(request, response, if_none_match)


async def expected(response: Response, if_match: IfMatch = None) -> Expected:
    """A request as one that changes a twin."""
    return Expected(response, if_match)


CachedGet = Annotated[Cached, Depends(cached)]
ExpectedState = Annotated[Expected, Depends(expected)]
