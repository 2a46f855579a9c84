"""The scope that a request needs, as its route declares it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from re import Pattern
from typing import Any, TypeVar

from fastapi import APIRouter
from fastapi.routing import APIRoute

from api.http.origins import SAFE_METHODS
from api.scopes import Scope

_F = TypeVar("_F", bound=Callable[..., Any])

_ATTRIBUTE = "required_scope"


def requires(scope: Scope) -> Callable[[_F], _F]:
    """Declare the scope that a route needs; stands below the route's own decorator.

    A route that only reads needs none of this: without a declaration it needs `Scope.READ`.
    """

    def declare(endpoint: _F) -> _F:
        setattr(endpoint, _ATTRIBUTE, scope)
        return endpoint

    return declare


class RequiredScopes:
    """The scopes that the routes of some routers need, in the order in which requests are matched to them.

    Raises
    ------
    TypeError
        where a route whose method may change something declares no scope.
    """

    def __init__(self, routers: Iterable[APIRouter]) -> None:
        routes = [route for router in routers for route in router.routes if isinstance(route, APIRoute)]
        self._routes: list[tuple[Pattern[str], set[str], Scope]] = [
            (route.path_regex, set(route.methods or ()), _declared(route)) for route in routes
        ]

    def of(self, method: str, path: str) -> Scope:
        """The scope of a request; what no route answers needs none but reading, and finds nothing."""
        wanted = "GET" if method == "HEAD" else method
        matching = (scope for pattern, methods, scope in self._routes if wanted in methods and pattern.match(path))
        return next(matching, Scope.READ)


def _declared(route: APIRoute) -> Scope:
    scope: Scope | None = getattr(route.endpoint, _ATTRIBUTE, None)
    if scope is None and not set(route.methods or ()) <= SAFE_METHODS:
        raise TypeError(f"{route.name} declares no scope: put @requires(Scope....) below its route decorator")
    return scope or Scope.READ
