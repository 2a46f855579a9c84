"""Large answers in pieces, each made while other threads may run and sent when the client has taken the last."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import orjson
from starlette.responses import Response, StreamingResponse

ROWS = 8_192
"""Figures of a column in a piece: some 150 kB of JSON, written in a millisecond."""

OBJECTS = 500
"""Objects of a list in a piece."""

BYTES = 262_144
"""Bytes of a file in a piece."""

WHOLE = 1_000_000
"""An answer up to this size is sent whole, with its length [bytes]."""


def answer(pieces: Iterable[bytes], media_type: str, headers: Mapping[str, str] | None = None) -> Response:
    """The pieces as an answer; made as they are sent, by threads of the pool, where they are many."""
    rest = iter(pieces)
    first: list[bytes] = []
    size = 0
    for piece in rest:
        first.append(piece)
        size += len(piece)
        if size > WHOLE:
            return StreamingResponse(_both(first, rest), media_type=media_type, headers=headers)
    return Response(b"".join(first), media_type=media_type, headers=dict(headers or {}))


def _both(first: list[bytes], rest: Iterator[bytes]) -> Iterator[bytes]:
    yield from first
    yield from rest


def slices(content: memoryview) -> Iterator[bytes]:
    """Bytes that are there."""
    for begin in range(0, len(content), BYTES):
        yield content[begin : begin + BYTES].tobytes()


def columns(about: Mapping[str, Any], table: Mapping[str, np.ndarray]) -> Iterator[bytes]:
    """A JSON object of `about` and, under `columns`, a list for each column; NaN is null."""
    yield orjson.dumps(dict(about))[:-1] + (b',"columns":{' if about else b'"columns":{')
    for number, (name, values) in enumerate(table.items()):
        yield (b"," if number else b"") + orjson.dumps(name) + b":["
        for begin in range(0, len(values), ROWS):
            part = np.ascontiguousarray(values[begin : begin + ROWS])
            written = orjson.dumps(part, option=orjson.OPT_SERIALIZE_NUMPY)[1:-1]
            yield b"," + written if begin else written
        yield b"]"
    yield b"}}"


def objects(about: Mapping[str, Any], name: str, rows: Sequence[Any]) -> Iterator[bytes]:
    """A JSON object of `about` and, under `name`, the rows."""
    yield orjson.dumps(dict(about))[:-1] + b"," + orjson.dumps(name) + b":["
    for begin in range(0, len(rows), OBJECTS):
        written = orjson.dumps(rows[begin : begin + OBJECTS])[1:-1]
        yield b"," + written if begin else written
    yield b"]}"
