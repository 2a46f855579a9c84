"""Names that nothing has, and the nearest that something has: what a slip of the pen meant."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator, Sequence
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel

NAME_MAX = 100
"""Characters of a name that are compared: what is longer was no slip of the pen."""


def nearest(name: str, known: Iterable[str]) -> str:
    """`; the nearest is ...`, to stand behind what is said of an unknown name; empty where nothing is known."""
    near = difflib.get_close_matches(name[:NAME_MAX], list(known), 1, 0.0)
    return f"; the nearest is {near[0]}" if near else ""


def fields_beside(kind: Any, location: Sequence[int | str]) -> set[str]:
    """Names of the fields that might stand where a field of a document is that nothing has.

    Parameters
    ----------
    kind
        Type of the whole document, as pydantic takes it.
    location
        Path of the unknown field as pydantic says it: names of alternatives of a union stand in it, too.
    """
    kinds = list(_alternatives(kind))
    for part in location[:-1]:
        inner = [found for each in kinds for found in _within(each, part)]
        kinds = inner or [each for each in kinds if _is_called(each, part)] or kinds
    return {name for each in kinds if _is_model(each) for name in each.model_fields}


def _alternatives(kind: Any) -> Iterator[Any]:
    origin = get_origin(kind)
    if origin is Annotated:
        yield from _alternatives(get_args(kind)[0])
    elif origin in (Union, UnionType):
        for each in get_args(kind):
            yield from _alternatives(each)
    else:
        yield kind


def _within(kind: Any, part: int | str) -> Iterator[Any]:
    """Types of what stands at a place in a value of this type."""
    if _is_model(kind):
        if part in kind.model_fields:
            yield from _alternatives(kind.model_fields[str(part)].annotation)
    elif isinstance(part, int) and get_origin(kind) in (list, tuple):
        for each in get_args(kind):
            yield from _alternatives(each)
    elif get_origin(kind) is dict:
        yield from _alternatives(get_args(kind)[1])


def _is_called(kind: Any, part: int | str) -> bool:
    """Whether an alternative of a union has this name: that of its class, or the tag that one of its fields holds."""
    if not _is_model(kind):
        return False
    annotations = (field.annotation for field in kind.model_fields.values())
    tags = [tag for each in annotations if get_origin(each) is Literal for tag in get_args(each)]
    return part in (kind.__name__, *tags)


def _is_model(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, BaseModel)
