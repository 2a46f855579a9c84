"""JSON bodies: structure checked before parsing, parsed and validated beside the event loop, a large one at a time."""

from __future__ import annotations

import asyncio
import json
import re
from collections import Counter
from collections.abc import Callable, Coroutine
from functools import partial
from typing import Any

import numpy as np
from fastapi import Request
from fastapi.routing import APIRoute
from pydantic import TypeAdapter, ValidationError
from starlette.concurrency import run_in_threadpool
from starlette.responses import Response

from api.http.dependencies import part_of
from api.http.problems import ERRORS_LISTED, field_message, field_path, invalid
from api.settings import Settings
from station.texts import half_characters

SMALL = 16_384
"""Bodies up to this size are read in the event loop, which takes less than 10 ms whatever they hold [bytes]."""

ERRORS_LOOKED_AT = 10_000
"""Errors that pydantic is asked to describe: it describes all or none, at 3 us each in one call."""

_STRING = re.compile(rb'"[^"\\]*+(?:\\.[^"\\]*+)*+"?', re.DOTALL)
"""A string, or the rest of the body where its end is missing; never looked at twice."""


class JsonRoute(APIRoute):
    """A route whose JSON body keeps nobody else waiting.

    pydantic and json work without letting other threads run, so what they are given is bounded first; and only one
    large body is read at a time, so that the event loop and live twins get the interpreter in between.
    """

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """The framework's handler, given a request whose body is read."""
        handle = super().get_route_handler()
        if self.body_field is None:
            return handle
        kind = self.body_field.field_info.rebuild_annotation()
        adapter: TypeAdapter[Any] = TypeAdapter(kind)

        async def read_then_handle(request: Request) -> Response:
            body = await request.body()
            if not body:
                return await handle(request)
            reading = partial(read, body, kind, adapter, part_of(request, Settings))
            if len(body) <= SMALL:
                value = reading()
            else:
                async with request.app.state.large_bodies:
                    value = await run_in_threadpool(reading)
            return await handle(_Read(request, value))

        return read_then_handle


class _Read(Request):
    """A request whose body has been parsed and validated."""

    def __init__(self, request: Request, value: Any) -> None:
        super().__init__(request.scope, request.receive)
        self._body = getattr(request, "_body", b"")  # as the request itself keeps it
        self._value = value

    async def json(self) -> Any:
        """The validated body, which validates again at no cost."""
        return self._value


def lane() -> asyncio.Semaphore:
    """The semaphore `app.state.large_bodies`: held while a large body is read."""
    return asyncio.Semaphore(1)


def read(body: bytes, kind: Any, adapter: TypeAdapter[Any], settings: Settings) -> Any:
    """The validated value of a JSON body, of the type that `adapter` adapts.

    Raises
    ------
    ProblemError
        422 `invalid` where it is no JSON, has a key twice or half a character in a text, is beyond a limit of
        `settings`, or refused by `adapter`.
    """
    check_structure(body, settings)
    value = _parsed(body, settings.body_keys_max)
    try:
        return adapter.validate_python(value)
    except ValidationError as error:
        count = error.error_count()
        items = error.errors(include_url=False) if count <= ERRORS_LOOKED_AT else []
        described = [(field_path(item["loc"]), field_message(item, kind)) for item in items[:ERRORS_LISTED]]
        raise invalid(described, count) from None


def _whole(text: str) -> int:
    """A whole number: thousands of digits take some 70 us, and other threads run in between."""
    return int(text)


def _parsed(body: bytes, keys_max: int) -> Any:
    def checked(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        if len(pairs) > keys_max:
            raise _beyond("keys in an object", len(pairs), keys_max, "body_keys_max")
        found = dict(pairs)
        if len(found) < len(pairs):
            counts = Counter(name for name, _ in pairs)
            raise invalid([(name, "stands twice in an object") for name, count in counts.items() if count > 1])
        return found

    try:
        text = body.decode(json.detect_encoding(body))
        value = json.loads(text, object_pairs_hook=checked, parse_int=_whole)
    except json.JSONDecodeError as error:
        raise invalid([("", f"is not JSON: {error.msg} at character {error.pos}")]) from None
    except ValueError as error:  # no text, or a number of thousands of digits
        raise invalid([("", f"is not JSON: {error}")]) from None
    if halves := half_characters(text, value):
        raise invalid(halves)
    return value


def _nothing(_string: re.Match[bytes]) -> bytes:
    """In place of a string: other threads run between two of them."""
    return b""


def check_structure(body: bytes, settings: Settings) -> None:
    """Refuse a JSON text that holds too many values, or holds them too deep; takes 10 ms a megabyte at most.

    Raises
    ------
    ProblemError
        422 `invalid`.
    """
    opening = body.count(b"[") + body.count(b"{")
    values = 1 + opening + body.count(b",")  # at most: an empty list counts as two
    if values <= settings.body_values_max and opening <= settings.body_depth_max:
        return
    bare = _STRING.sub(_nothing, body)
    opening = bare.count(b"[") + bare.count(b"{")
    values = 1 + opening + bare.count(b",")
    if values > settings.body_values_max:
        raise _beyond("values", values, settings.body_values_max, "body_values_max")
    signs = np.frombuffer(bare, np.uint8)
    steps = np.isin(signs, [ord("["), ord("{")]).astype(np.int8) - np.isin(signs, [ord("]"), ord("}")])
    depth = int(steps.cumsum(dtype=np.int64).max(initial=0))
    if depth > settings.body_depth_max:
        raise _beyond("levels", depth, settings.body_depth_max, "body_depth_max")


def _beyond(what: str, given: int, limit: int, setting: str) -> Exception:
    return invalid([("", f"a body may hold at most {limit} {what} (setting {setting}); given {given}")])
