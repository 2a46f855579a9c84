"""Errors as RFC 9457 problem documents, whatever raised them."""

from __future__ import annotations

import json
import logging
from collections.abc import Mapping, Sequence
from http import HTTPStatus
from types import MappingProxyType
from typing import Annotated, Any

from asgi_correlation_id.context import correlation_id
from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from pydantic import BaseModel, Field, ValidationError
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect
from starlette.responses import Response
from starlette.routing import compile_path

from api.nearest import fields_beside, nearest
from api.store.database import SilentStoreError, StoreError
from api.store.records import CapacityError, Conflict, NotDurableYet, StoreFull
from controllers.registry import UncompiledError
from station import InputError, StationError

log = logging.getLogger(__name__)

MEDIA_TYPE = "application/problem+json"

_URN = "urn:hrs-twin:problem:"

ERRORS_LISTED = 20
"""Wrong fields that a problem lists; its detail says how many there are."""

FIELD_MAX, MESSAGE_MAX, DETAIL_MAX = 120, 300, 1000
"""Longest path, message and detail [characters]: written as JSON, all of a problem is at most 64 kB."""

_KINDS = {
    HTTPStatus.BAD_REQUEST: ("malformed", "Malformed request"),
    HTTPStatus.NOT_FOUND: ("not-found", "Not found"),
    HTTPStatus.METHOD_NOT_ALLOWED: ("method", "Method not allowed"),
    HTTPStatus.REQUEST_ENTITY_TOO_LARGE: ("body-too-large", "Body too large"),
}
"""Kind and title of what the framework refuses by itself."""


class FieldProblem(BaseModel):
    """The error of one field."""

    field: Annotated[str, Field(description="Path of the field, or empty", examples=["arrivals.count"])]
    message: Annotated[
        str,
        Field(description="Limit and value given", examples=["Input should be greater than or equal to 1; given 0"]),
    ]


class Problem(BaseModel):
    """An RFC 9457 problem document."""

    type: Annotated[str, Field(description="What kind of problem", examples=[_URN + "invalid"])]
    title: Annotated[str, Field(description="The kind in words", examples=["Invalid request"])]
    status: Annotated[int, Field(ge=400, le=599, description="HTTP status", examples=[422])]
    detail: Annotated[str, Field(description="What happened", examples=["1 field is wrong"])] = ""
    errors: Annotated[
        list[FieldProblem],
        Field(
            description="Wrong fields, one by one",
            examples=[[{"field": "arrivals.count", "message": "Input should be greater than or equal to 1; given 0"}]],
        ),
    ] = []
    request_id: Annotated[
        str,
        Field(
            description="Id of the request, as in its header X-Request-ID and in the log", examples=["8f14e45fceea167a"]
        ),
    ] = ""


class ProblemError(Exception):
    """Raised where a request ends in a problem."""

    def __init__(
        self, status: HTTPStatus, kind: str, title: str, detail: str = "", *, errors: Sequence[tuple[str, str]] = (),
        retry_after_s: int | None = None, headers: Mapping[str, str] = MappingProxyType({}),
    ) -> None:  # fmt: skip
        super().__init__(detail or title)
        self.retry_after_s = retry_after_s
        self.headers = headers
        self.problem = Problem(
            type=_URN + kind,
            title=title,
            status=status,
            detail=short(detail, DETAIL_MAX),
            errors=[
                FieldProblem(field=short(field, FIELD_MAX), message=short(message, MESSAGE_MAX))
                for field, message in errors[:ERRORS_LISTED]
            ],
        )

    def response(self) -> Response:
        """As it goes out."""
        headers = dict(self.headers)
        if self.retry_after_s is not None:
            headers["Retry-After"] = str(self.retry_after_s)
        if self.problem.status == HTTPStatus.UNAUTHORIZED:
            headers["WWW-Authenticate"] = "Bearer"
        return Response(self.document(), self.problem.status, headers=headers, media_type=MEDIA_TYPE)

    def document(self) -> bytes:
        """The problem document as JSON, with the id of the request that is being answered."""
        told = self.problem.model_copy(update={"request_id": correlation_id.get() or ""})
        return told.model_dump_json(exclude_defaults=True).encode()


def short(text: str, length: int) -> str:
    """A text of at most `length` characters that can be written as UTF-8."""
    cut = text if len(text) <= length else text[: length - 3] + "..."
    return cut.encode("utf-8", "replace").decode()


def not_found(what: str, name: str, known: Sequence[str] = ()) -> ProblemError:
    """Nothing has that name."""
    hint = f"; there are {', '.join(known)}" if known else ""
    return ProblemError(HTTPStatus.NOT_FOUND, "not-found", "Not found", f"no {what} is called {name!r}{hint}")


def conflict(detail: str) -> ProblemError:
    """The request does not fit the state of things."""
    return ProblemError(HTTPStatus.CONFLICT, "conflict", "Conflict", detail)


def invalid(errors: Sequence[tuple[str, str]], count: int | None = None) -> ProblemError:
    """Fields are wrong: `count` of them, where not all are given."""
    count = len(errors) if count is None else count
    listed = min(len(errors), ERRORS_LISTED)
    more = "" if count == listed else f"; {listed or 'none'} of them {'is' if listed == 1 else 'are'} listed"
    detail = f"{count} field{' is' if count == 1 else 's are'} wrong{more}"
    return ProblemError(HTTPStatus.UNPROCESSABLE_ENTITY, "invalid", "Invalid request", detail, errors=errors)


def problem_from(error: Exception) -> ProblemError:
    """The problem an error of any room stands for."""
    match error:
        case ProblemError():
            return error
        case InputError():
            return invalid(error.problems)
        case StoreError() | NotDurableYet() | UncompiledError():
            return _unavailable(error)
        case StationError():
            return invalid([("", str(error))])
        case Conflict():
            return conflict(str(error))
        case CapacityError():
            return ProblemError(HTTPStatus.TOO_MANY_REQUESTS, "full", "Too many", str(error), retry_after_s=10)
        case StoreFull():
            return ProblemError(
                HTTPStatus.INSUFFICIENT_STORAGE, "store-full", "Store full",
                f"{error}; forget what is not needed, or raise the limit", retry_after_s=60,
            )  # fmt: skip
        case RequestValidationError() | ClientDisconnect() | HTTPException():
            return _of_the_framework(error)
    log.error("a request failed", exc_info=error)
    return ProblemError(HTTPStatus.INTERNAL_SERVER_ERROR, "internal", "Internal error", "the service's log says more")


def _of_the_framework(error: RequestValidationError | ClientDisconnect | HTTPException) -> ProblemError:
    match error:
        case RequestValidationError():
            found = error.errors()
            listed = [(field_path(item["loc"]), field_message(item)) for item in found[:ERRORS_LISTED]]
            return invalid(listed, len(found))
        case ClientDisconnect():
            return ProblemError(HTTPStatus.BAD_REQUEST, *_KINDS[HTTPStatus.BAD_REQUEST], "the client has gone")
        case HTTPException():
            status = HTTPStatus(error.status_code)
            kind, title = _KINDS.get(status, ("http", status.phrase))
            return ProblemError(status, kind, title, "" if error.detail == status.phrase else str(error.detail))


def _unavailable(error: StoreError | NotDurableYet | UncompiledError) -> ProblemError:
    match error:
        case StoreError():
            # That the store is silent is logged once, not for each request of the hundreds a second it may meet.
            log.log(logging.DEBUG if isinstance(error, SilentStoreError) else logging.ERROR, "%s", error)
            return ProblemError(
                HTTPStatus.SERVICE_UNAVAILABLE, "unavailable", "Database unavailable", "try again", retry_after_s=5
            )  # fmt: skip
        case NotDurableYet():
            return ProblemError(
                HTTPStatus.SERVICE_UNAVAILABLE, "not-stored", "Done, but not stored yet",
                "the twin has obeyed, and forgets it if the service dies before the database takes it", retry_after_s=1,
            )  # fmt: skip
        case UncompiledError():
            return ProblemError(
                HTTPStatus.SERVICE_UNAVAILABLE, "compiling", "Being compiled", str(error), retry_after_s=10
            )  # fmt: skip


def install(app: FastAPI) -> None:
    """Answer every error of `app` with a problem document."""

    async def answer(request: Request, error: Exception) -> Response:
        problem = problem_from(error)
        if problem.problem.status == HTTPStatus.METHOD_NOT_ALLOWED:
            problem.headers = {"Allow": ", ".join(await run_in_threadpool(_allowed, request))}
        return problem.response()

    for kind in (
        StationError,
        ProblemError,
        Conflict,
        CapacityError,
        NotDurableYet,
        StoreFull,
        RequestValidationError,
        HTTPException,
        Exception,
    ):
        app.add_exception_handler(kind, answer)


def _allowed(request: Request) -> list[str]:
    """Methods of a request's path: the framework names those of one route only. What is in no document can be read."""
    paths, asked = request.app.openapi()["paths"], request.url.path
    named = [paths[asked]] if asked in paths else None  # `/verify` is no certificate's id
    fitting = named or [methods for path, methods in paths.items() if compile_path(path)[0].match(asked)]
    return sorted({method.upper() for methods in fitting for method in methods}) or ["GET", "HEAD"]


def input_error(source: str, error: ValidationError, kind: Any = None) -> InputError:
    """The problems pydantic found in JSON input, each with field path, limit and value given; `kind` as below."""
    return InputError(source, [(field_path(item["loc"]), field_message(item, kind)) for item in error.errors()])


def field_path(location: Sequence[int | str]) -> str:
    """The field as the user wrote it: without `body` and the names of alternatives."""
    places = [str(part) for part in location if part not in ("body", "header", "query", "path")]
    return ".".join(places)


def field_message(item: Mapping[str, Any], kind: Any = None) -> str:
    """The error of a field, as pydantic found it, and the value given as JSON writes it.

    Of a field that nothing has also the nearest one, where `kind`, the type of the whole document, is given.
    """
    text = str(item["msg"]).removeprefix("Value error, ")
    given = item.get("input")
    if isinstance(given, str):
        given = given[:200]
    near = nearest(str(item["loc"][-1]), fields_beside(kind, item["loc"])) if item["type"] == "extra_forbidden" else ""
    if item["type"] in ("missing", "value_error", "json_invalid") or isinstance(given, dict | list):
        return text + near
    return f"{text}; given {in_json(given):.200}{near}"


def in_json(value: Any) -> str:
    """A value as JSON writes it; one that JSON has not, as Python does."""
    try:
        return json.dumps(value, ensure_ascii=False)
    except (TypeError, ValueError):
        return repr(value)
