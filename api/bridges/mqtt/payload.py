"""Payloads of Sparkplug B 3.0: the few fields of its Protocol Buffers message that we tell or are told.

Numbers of fields and types are those of the specification (Eclipse Sparkplug 3.0, chapter 6.4).
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from typing import NamedTuple

INT32, INT64, DOUBLE, BOOLEAN, STRING = 3, 4, 10, 11, 12
"""Data types of metrics and properties."""

GOOD, BAD = 192, 0
"""Values of the property Quality."""

_VARINT, _FIXED64, _BYTES, _FIXED32 = 0, 1, 2, 5


class Metric(NamedTuple):
    """A metric of a payload; what is None is left out."""

    value: float | int | bool | str | None  # None: there is none, told as null
    datatype: int
    name: str | None = None  # at birth; later the alias stands for it
    alias: int | None = None
    timestamp: int | None = None  # [ms, Unix time]
    historical: bool = False
    quality: int | None = None
    unit: str | None = None  # property engUnit


def _varint(number: int) -> bytes:
    found = bytearray()
    number &= (1 << 64) - 1  # negative numbers as two's complement
    while number > 0x7F:
        found.append(number & 0x7F | 0x80)
        number >>= 7
    found.append(number)
    return bytes(found)


def _field(number: int, value: int | float | bytes | str) -> bytes:
    """A field: a whole number or boolean, a double, or text, bytes and messages."""
    if isinstance(value, float):
        return _varint(number << 3 | _FIXED64) + struct.pack("<d", value)
    if isinstance(value, int):
        return _varint(number << 3 | _VARINT) + _varint(int(value))
    content = value.encode() if isinstance(value, str) else value
    return _varint(number << 3 | _BYTES) + _varint(len(content)) + content


def _properties(metric: Metric) -> bytes:
    """The property set of a metric: names, then values in their order."""
    given = [("Quality", INT32, 3, metric.quality), ("engUnit", STRING, 8, metric.unit)]
    there = [(name, kind, place, value) for name, kind, place, value in given if value is not None]
    names = b"".join(_field(1, name) for name, *_ in there)
    return names + b"".join(_field(2, _field(1, kind) + _field(place, value)) for _, kind, place, value in there)


_VALUES = {INT32: 10, INT64: 11, DOUBLE: 13, BOOLEAN: 14, STRING: 15}
"""The field in which a metric of a type has its value."""


def _value(metric: Metric) -> bytes:
    if metric.value is None:
        return b""
    number = _VALUES[metric.datatype]
    if metric.datatype == DOUBLE:
        return _field(number, float(metric.value))
    return _field(number, metric.value if isinstance(metric.value, str) else int(metric.value))


def _encoded(metric: Metric) -> bytes:
    """A metric as a message."""
    heads = ((1, metric.name), (2, metric.alias), (3, metric.timestamp), (4, metric.datatype))
    found = b"".join(_field(number, value) for number, value in heads if value is not None)
    if metric.historical:
        found += _field(5, 1)
    if metric.value is None:
        found += _field(7, 1)
    properties = _properties(metric)
    if properties:
        found += _field(9, properties)
    return found + _value(metric)


def encode(metrics: Sequence[Metric], *, timestamp: int, seq: int | None) -> bytes:
    """A payload; `timestamp` is Unix time [ms], `seq` 0 to 255, None of a death."""
    found = _field(1, timestamp) + b"".join(_field(2, _encoded(metric)) for metric in metrics)
    return found if seq is None else found + _field(3, seq)


def _fields(content: bytes) -> Iterator[tuple[int, int | bytes]]:
    """Number and value of each field of a message: a whole number, or the bytes of anything else.

    Raises
    ------
    ValueError
        if it ends within one, or has a kind of field that there is not.
    """
    place = 0

    def varint() -> int:
        nonlocal place
        found = shift = 0
        while True:
            if place >= len(content) or shift > 63:
                raise ValueError("a number has no end")
            byte = content[place]
            found |= (byte & 0x7F) << shift
            place, shift = place + 1, shift + 7
            if byte < 0x80:
                return found

    lengths = {_FIXED64: 8, _FIXED32: 4}
    while place < len(content):
        head = varint()
        number, kind = head >> 3, head & 7
        if kind == _VARINT:
            yield number, varint()
            continue
        if kind != _BYTES and kind not in lengths:
            raise ValueError(f"field {number} has the wire type {kind}")
        length = varint() if kind == _BYTES else lengths[kind]
        if place + length > len(content):
            raise ValueError(f"field {number} is cut off")
        yield number, content[place : place + length]
        place += length


def decode(payload: bytes) -> list[Metric]:
    """The metrics of a payload: name, alias, data type and value; other fields of theirs are not read.

    Raises
    ------
    ValueError
        if it is no payload.
    """
    return [_decoded(part) for number, part in _fields(payload) if number == 2 and isinstance(part, bytes)]


def _decoded(content: bytes) -> Metric:
    fields = dict(_fields(content))
    name, alias, datatype = fields.get(1), fields.get(2), fields.get(4)
    value: float | int | bool | str | None = None
    for number, given in fields.items():
        if isinstance(given, int):
            value = bool(given) if number == 14 else given if number in (10, 11) else value
        elif (number == 12 and len(given) == 4) or (number == 13 and len(given) == 8):
            value = float(struct.unpack("<f" if number == 12 else "<d", given)[0])
        elif number == 15:
            value = given.decode()
    return Metric(
        value, datatype if isinstance(datatype, int) else 0, name.decode() if isinstance(name, bytes) else None,
        alias if isinstance(alias, int) else None,
    )  # fmt: skip
