"""Texts of JSON documents that can be written: half a character, a surrogate without its other half, cannot."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import islice
from typing import Any

_ESCAPED = re.compile(r"\\u[dD][89a-fA-F]")
"""In a JSON text a pair of such escapes is one character, and whole."""

_LONE = re.compile("[\ud800-\udfff]")

_NAMED_MAX = 20
"""Places named at once."""

Place = tuple[str | int, ...]


def half_characters(text: str, document: Any) -> list[tuple[str, str]]:
    """(field, what is wrong) of texts and keys with half a character in the `document` that a JSON `text` holds."""
    if _ESCAPED.search(text) is None and _writable(text):
        return []
    message = "cannot be read: half a character (a lone surrogate) is no text; given"
    halves = islice(_halves(document), _NAMED_MAX)
    return [(shown(".".join(map(str, place))), f'{message} "{shown(of[:200])}"') for place, of in halves]


def _writable(text: str) -> bool:
    """Whether a text has no lone surrogate: a millisecond a million characters, a fiftieth of a search for one."""
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True


def shown(text: str) -> str:
    r"""A text that can be written: what cannot as an escape, like \ud800."""
    return text.encode("utf-8", "backslashreplace").decode()


def _halves(document: Any) -> Iterator[tuple[Place, str]]:
    """Every text or key with half a character, with its place."""
    waiting: list[tuple[Place, Any]] = [((), document)]
    while waiting:
        place, value = waiting.pop()
        if isinstance(value, str):
            if _LONE.search(value):
                yield place, value
        elif isinstance(value, dict):
            yield from (((*place, key), key) for key in value if _LONE.search(key))
            waiting += [((*place, key), below) for key, below in value.items() if isinstance(below, str | dict | list)]
        elif isinstance(value, list):
            waiting += [
                ((*place, row), below) for row, below in enumerate(value) if isinstance(below, str | dict | list)
            ]
