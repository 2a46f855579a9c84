"""Refusal of input that an operation does not read: unknown query parameters, and a body where it takes none."""

from __future__ import annotations

from fastapi import Request
from fastapi.dependencies.utils import get_flat_params
from fastapi.params import ParamTypes
from fastapi.routing import APIRoute
from starlette.datastructures import Headers

from api.http.problems import invalid
from api.nearest import nearest

EMPTY_MAX = 64
"""A longer body is not empty, whatever spaces it holds [bytes]."""


def has_body(headers: Headers) -> bool:
    """Whether a request brings a body, or says that one may come."""
    return "transfer-encoding" in headers or headers.get("content-length", "0").strip("0") != ""


async def check_query(request: Request) -> None:
    """Refuse a request with a query parameter that its operation does not know; async, so that no thread is taken.

    Raises
    ------
    ProblemError
        422 `invalid`, which names each and what it may have meant.
    """
    if not request.query_params:
        return
    known = _known(request.scope["route"])
    none = "" if known else ": it takes none"
    unknown = [name for name in request.query_params if name not in known]
    if unknown:
        raise invalid([(name, f"is no parameter of this request{none}{nearest(name, known)}") for name in unknown])


async def check_unread(request: Request) -> None:
    """Refuse a request with a body that its operation does not read; `{}` holds nothing that could be ignored.

    Raises
    ------
    ProblemError
        422 `invalid`, which names the query parameters that there are.
    """
    route = request.scope["route"]
    reads_itself = "requestBody" in (route.openapi_extra or {})
    if route.body_field is not None or reads_itself or not has_body(request.headers):
        return
    content = await request.body()
    if len(content) <= EMPTY_MAX and b"".join(content.split()) in {b"", b"{}"}:
        return
    known = ", ".join(_known(route))
    raise invalid([("", f"this request takes no body{known and f'; parameters of its query are {known}'}")])


def _known(route: APIRoute) -> tuple[str, ...]:
    """Names of the query parameters of an operation, those of its dependencies among them."""
    parameters = get_flat_params(route.dependant)
    return tuple(each.alias for each in parameters if getattr(each.field_info, "in_", None) is ParamTypes.query)
