"""Media types of bodies that routes read besides JSON, as they declare them."""

from __future__ import annotations

from collections.abc import Iterable
from re import Pattern

from fastapi import APIRouter
from fastapi.routing import APIRoute


class BodyTypes:
    """The media types of `openapi_extra["requestBody"]` of the routes of some routers."""

    def __init__(self, routers: Iterable[APIRouter]) -> None:
        routes = [route for router in routers for route in router.routes if isinstance(route, APIRoute)]
        declared = [(route, frozenset(_content(route))) for route in routes]
        self._routes: list[tuple[Pattern[str], set[str], frozenset[str]]] = [
            (route.path_regex, set(route.methods or ()), content) for route, content in declared if content
        ]

    def of(self, method: str, path: str) -> frozenset[str]:
        """What the body of a request may be besides JSON."""
        fitting = (types for pattern, methods, types in self._routes if method in methods and pattern.match(path))
        return next(fitting, frozenset())


def _content(route: APIRoute) -> Iterable[str]:
    return (route.openapi_extra or {}).get("requestBody", {}).get("content", {})


def media_type(given: str) -> str:
    """The media type of a header `Content-Type`, without its parameters."""
    return given.partition(";")[0].strip().lower()
