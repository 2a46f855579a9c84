"""Documents that nobody meant: edits of good ones, values of wrong types, and texts broken as files break."""

from __future__ import annotations

import copy
import json
import math
from collections.abc import Callable
from typing import Any

from hypothesis import strategies as st

HUGE = (10**30, -(10**30), 10**400, 2**63, -(2**63) - 1, 1e308, -1e308, 5e-324, math.inf, -math.inf, math.nan)
"""Numbers beyond what fields, floats and integers of a database hold."""

TEXTS = (
    "",
    "S1",
    "thesis-fit",
    "nan",
    "1e999",
    "\x00",
    "\ud800",
    "é" * 100,
    "x" * 10_000,
    "../../etc/passwd",
    "9" * 5000,
)

scalars = (
    st.none() | st.booleans() | st.integers() | st.floats() | st.sampled_from(HUGE) | st.sampled_from(TEXTS)
    | st.text(max_size=12)
)  # fmt: skip

values = st.recursive(
    scalars,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=6), inner, max_size=3),
    max_leaves=6,
)
"""Any JSON value."""


def _places(document: Any) -> list[tuple[Any, ...]]:
    """Paths of everything in a document, itself first."""
    found: list[tuple[Any, ...]] = [()]
    items: Any = document.items() if isinstance(document, dict) else ()
    for key, value in enumerate(document) if isinstance(document, list) else items:
        found += [(key, *path) for path in _places(value)]
    return found


def _edited(draw: Callable[[Any], Any], value: Any) -> Any:
    """A value like another, but not it: near it where it is a number."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return draw(values)
    near = [value + 1, value - 1, -value, value * 10, [value], math.nan]
    if abs(value) < 2**64:
        near += [float(value), str(value), math.nextafter(value, math.inf)]
    return draw(st.sampled_from(near) | scalars)


@st.composite
def mutated(draw: Callable[[Any], Any], document: Any, most: int = 3) -> Any:
    """A document with one to `most` edits: another value, a field less, a field more, an entry twice."""
    made = copy.deepcopy(document)
    for _ in range(draw(st.integers(1, most))):
        *where, last = draw(st.sampled_from([path for path in _places(made) if path] or [("field",)]))
        holder = made
        for key in where:
            holder = holder[key]
        edit = draw(st.sampled_from(("value", "less", "more", "twice")))
        if edit == "less" and len(holder) > 1:
            del holder[last]
        elif edit == "more" and isinstance(holder, dict):
            holder[draw(st.text(max_size=8))] = draw(values)
        elif edit == "twice" and isinstance(holder, list):
            holder.insert(last, copy.deepcopy(holder[last]))
        elif isinstance(holder, list) or last in holder:
            holder[last] = _edited(draw, holder[last])
    return made


def as_json(document: Any) -> bytes:
    """As Python writes it: Infinity, NaN and lone surrogates included."""
    return json.dumps(document).encode()


def as_toml(document: Any) -> bytes:
    """A table as TOML; what TOML lacks (null) is left out."""
    return "\n".join(f"{_key(key)} = {_toml(value)}" for key, value in document.items() if value is not None).encode(
        "utf-8", "surrogatepass"
    )


def _key(name: Any) -> str:
    return json.dumps(str(name), ensure_ascii=False)


def _toml(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_key(k)} = {_toml(v)}" for k, v in value.items() if v is not None) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(_toml(item) for item in value if item is not None) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int) and abs(value) > 2**64:
        return hex(value) if value > 0 else "0"  # a number of any length, in a text that is
    return repr(value) if isinstance(value, int | float) else json.dumps(str(value), ensure_ascii=False)


@st.composite
def broken(draw: Callable[[Any], Any], content: bytes) -> bytes:
    """A file as it comes out of bad hands: cut, changed, doubled, in another encoding, nested, or not a text at all."""
    how = draw(st.sampled_from(("cut", "bytes", "twice", "encoding", "nested", "digits", "garbage", "zip")))
    place = draw(st.integers(0, max(0, len(content) - 1)))
    match how:
        case "cut":
            return content[:place]
        case "bytes":
            return content[:place] + draw(st.binary(min_size=1, max_size=8)) + content[place + 1 :]
        case "twice":
            return content + b"\n" + content
        case "encoding":
            name = draw(st.sampled_from(("utf-16", "utf-32", "utf-8-sig", "utf-7", "cp500")))
            return content.decode("utf-8", "replace").encode(name, "replace")
        case "nested":
            depth, bracket = draw(st.sampled_from((50, 2000, 100_000))), draw(st.sampled_from((b"[", b'{"a":', b"a=[")))
            return bracket * depth
        case "digits":
            return content.replace(b": 1", b": " + b"1" * draw(st.sampled_from((20, 400, 5000))))
        case "zip":
            return b"PK\x03\x04" + content
    return draw(st.binary(max_size=400))
