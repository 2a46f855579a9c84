"""Lists in pages: an opaque cursor behind the last item, and a link to what follows (RFC 8288).

A cursor is the place of an item in the order of its list, not a count: what is added or removed meanwhile moves
nothing, and an index finds the place.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Callable, Sequence
from typing import Annotated, Any, TypeVar
from urllib.parse import urlencode

from fastapi import Depends, Query, Request
from pydantic import Field
from starlette.responses import Response

from station import InputError

LIMIT_MAX = 200
"""Most items in an answer: some 100 kB of runs."""

Limit = Annotated[int, Query(ge=1, le=LIMIT_MAX, description="Most items in an answer", examples=[50])]

Cursor = Annotated[
    str | None,
    Query(
        max_length=200,
        description="`next` of the page before: go on behind it",
        examples=["WzE3NjM3MTU2MDAsICJydW4tMSJd"],
    ),
]

Next = Annotated[
    str | None,
    Field(
        description="Give it as `cursor` to go on; null at the end. Also in the header Link, rel=next",
        examples=["WzE3NjM3MTU2MDAsICJydW4tMSJd"],
    ),
]

FAR = 2**62
"""Behind everything that is counted."""

Item = TypeVar("Item")

SortKey = tuple[Any, ...]
"""The place of an item in the order of its list."""


class Page:
    """The page of a list that a request asks for."""

    def __init__(self, request: Request, response: Response, limit: int, cursor: str | None) -> None:
        self._request = request
        self._response = response
        self.limit = limit
        self._cursor = cursor

    def behind(self, *kinds: type) -> SortKey | None:
        """The place to go on behind, made of values of these kinds.

        Raises
        ------
        InputError
            if the cursor is not one of this list.
        """
        if self._cursor is None:
            return None
        try:
            found = json.loads(base64.urlsafe_b64decode(self._cursor + "=" * (-len(self._cursor) % 4)))
        except ValueError:
            found = None
        fits = isinstance(found, list) and [type(value) for value in found] == list(kinds) and all(map(_held, found))
        if not fits:
            raise InputError(
                "query", [("cursor", f"must be `next` of a page of this list; given {self._cursor!r:.60}")]
            )
        return tuple(found)

    def turn(self, found: Sequence[Item], place: Callable[[Item], SortKey]) -> tuple[Sequence[Item], str | None]:
        """The items of this page and the cursor behind them, which is also set as a link.

        `found` has one item more than `limit` if there is a next page, for which there is no cursor otherwise.
        """
        items = found[: self.limit]
        if len(found) <= self.limit:
            return items, None
        cursor = base64.urlsafe_b64encode(json.dumps(place(items[-1])).encode()).decode().rstrip("=")
        query = [(name, value) for name, value in self._request.query_params.multi_items() if name not in _WHERE]
        link = f"{self._request.url.path}?{urlencode([*query, ('cursor', cursor)])}"
        self._response.headers["Link"] = f'<{link}>; rel="next"'
        return items, cursor


def _held(value: Any) -> bool:
    """Whether a database can compare with it: no endless number, no text that is none."""
    return value.isprintable() if isinstance(value, str) else abs(value) < FAR


async def paged(request: Request, response: Response, limit: Limit = 50, cursor: Cursor = None) -> Page:
    """A page of a list; async, as below, so that no thread is taken for it."""
    return Page(request, response, limit, cursor)


async def paged_twins(request: Request, response: Response, limit: Limit = LIMIT_MAX, cursor: Cursor = None) -> Page:
    """A page of twins: most services have fewer than fit."""
    return Page(request, response, limit, cursor)


EventLimit = Annotated[int, Query(ge=1, le=1000, description="Most events in an answer", examples=[100])]


async def paged_events(request: Request, response: Response, limit: EventLimit = 100, cursor: Cursor = None) -> Page:
    """A page of events, which are small."""
    return Page(request, response, limit, cursor)


_WHERE = ("cursor", "after")
"""The query parameters that say where a page begins."""

Paged = Annotated[Page, Depends(paged)]
"""Type of a route's argument that wants a page."""

PagedTwins = Annotated[Page, Depends(paged_twins)]
PagedEvents = Annotated[Page, Depends(paged_events)]
