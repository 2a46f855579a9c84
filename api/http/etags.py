"""Conditional requests (RFC 9110): ETag, If-None-Match and If-Match.

What has ended never changes: its tag comes from its id, so that a reader who has it costs no query for the content.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from http import HTTPStatus
from importlib.metadata import version
from typing import Annotated

from fastapi import Depends, FastAPI, Header, Request
from starlette.responses import Response

from api.http.problems import ProblemError
from api.store.records import Job

_RELEASE = version("hrs-twin")
"""Another version may answer otherwise."""

_CACHE = {"Cache-Control": "private, no-cache"}
"""A cached response is validated with every request."""

IfNoneMatch = Annotated[
    str | None,
    Header(
        description="ETag of the answer you have: 304 without a body if it still holds", examples=['"3c1a-90fe8d1b"']
    ),
]
IfMatch = Annotated[
    str | None,
    Header(
        description="ETag of what is changed, as you know it: 412 if somebody has changed it since",
        examples=['"3c1a-90fe8d1b"'],
    ),
]


IfNoneMatchAny = Annotated[
    str | None,
    Header(alias="If-None-Match", description="`*`: 412 if there is one already", examples=["*"]),
]


class NotModified(Exception):  # noqa: N818  # as in HTTP 304
    """The asker has the answer."""

    def __init__(self, headers: dict[str, str]) -> None:
        super().__init__("unchanged")
        self.headers = headers


class ConditionalGet:
    """A GET whose asker may have the answer; `headers` go out with it."""

    def __init__(self, request: Request, response: Response, held: str | None) -> None:
        self._url = f"{request.url.path}?{request.url.query}"
        self._response = response
        self._held = held
        self.headers: dict[str, str] = {}

    def ended(self, job: Job) -> None:
        """The answer holds for ever if the job has ended. Raises Unchanged for who has it."""
        if job.state.final:
            self.tag(digest_of(job.id, job.state, str(job.finished), self._url))

    def tagged(self, answer: Response) -> Response:
        """An answer with the headers."""
        answer.headers.update(self.headers)
        return answer

    def tag(self, tag: str) -> None:
        """The answer has this tag. Raises Unchanged for who has it."""
        self.headers = {"ETag": f'"{tag}"', **_CACHE}
        self._response.headers.update(self.headers)
        if self._held is not None and _names(tags_of(self._held), tag):
            raise NotModified(self.headers)


class Preconditions:
    """Preconditions of replacing or removing a resource (RFC 9110, 13.1)."""

    def __init__(self, if_match: str | None, if_none_match: str | None) -> None:
        self._if_match = if_match
        self._if_none_match = if_none_match

    def check(self, what: str, tag: str | None) -> None:
        """Raise a problem unless they hold for a thing with this tag, None where there is none."""
        if self._if_match is not None and (tag is None or not _names(tags_of(self._if_match, strong=True), tag)):
            raise changed_since(what)
        if self._if_none_match is not None and tag is not None and _names(tags_of(self._if_none_match), tag):
            raise ProblemError(
                HTTPStatus.PRECONDITION_FAILED, "changed", "There already",
                f"{what} is there, which If-None-Match rules out", errors=[("If-None-Match", "names what is there")],
            )  # fmt: skip


def _names(held: Iterator[str], tag: str) -> bool:
    return any(each in {"*", tag} for each in held)


def changed_since(what: str) -> ProblemError:
    """The problem of a request whose If-Match does not hold for a thing."""
    return ProblemError(
        HTTPStatus.PRECONDITION_FAILED, "changed", "Changed since", f"{what} is not as If-Match says: read it again",
        errors=[("If-Match", "names another state")],
    )  # fmt: skip


def digest_of(*parts: str) -> str:
    """The tag of an answer that these parts, and this release, decide."""
    return digest(_RELEASE, *parts)


def digest(*parts: str) -> str:
    """A digest of texts."""
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:32]


def tags_of(header: str, *, strong: bool = False) -> Iterator[str]:
    """The tags a header names; `*`, whatever there is, only where it stands alone and without quotes."""
    if header.strip() == "*":
        yield "*"
        return
    for given in header.split(","):
        tag = given.strip()
        if tag.startswith("W/"):
            if strong:
                continue
            tag = tag.removeprefix("W/")
        if tag.strip('"') != "*":
            yield tag.strip('"')


def install(app: FastAPI) -> None:
    """Answer who has the answer."""

    async def answer(_request: Request, error: Exception) -> Response:
        return Response(status_code=HTTPStatus.NOT_MODIFIED, headers=getattr(error, "headers", {}))

    app.add_exception_handler(NotModified, answer)


async def conditional_get(request: Request, response: Response, if_none_match: IfNoneMatch = None) -> ConditionalGet:
    """A request as a GET whose asker may have the answer; async, as below, so that no thread is taken for it."""
    return ConditionalGet(request, response, if_none_match)


async def preconditions(if_match: IfMatch = None, if_none_match: IfNoneMatchAny = None) -> Preconditions:
    """A request as one that replaces or makes a thing."""
    return Preconditions(if_match, if_none_match)


async def match(if_match: IfMatch = None) -> Preconditions:
    """A request as one that removes a thing."""
    return Preconditions(if_match, None)


ConditionalGetDep = Annotated[ConditionalGet, Depends(conditional_get)]
ReplacementPreconditions = Annotated[Preconditions, Depends(preconditions)]
RemovalPreconditions = Annotated[Preconditions, Depends(match)]
