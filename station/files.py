"""Files of scenarios, stations and traces as text and as tables of fields."""

from __future__ import annotations

import json
import tomllib
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

from station.errors import InputError
from station.texts import half_characters

FILE_MAX = 8_000_000
"""Largest scenario or trace file read [bytes]: COUNT_MAX vehicles take a tenth of it."""


def read_text(path: Traversable | Path) -> str:
    """The text of a file.

    Raises
    ------
    InputError
        if it cannot be read, is too large, or is no UTF-8.
    """
    try:
        with path.open("rb") as stream:
            content = stream.read(FILE_MAX + 1)
        if len(content) > FILE_MAX:
            raise InputError(str(path), [("", f"must not exceed {FILE_MAX:,} bytes")])
        return content.decode("utf-8-sig")
    except OSError as error:
        raise InputError(str(path), [("", f"cannot be read: {error.strerror}")]) from None
    except UnicodeDecodeError:
        raise InputError(str(path), [("", "is not UTF-8 text")]) from None
    except ValueError as error:  # no file can have that name: it has a NUL, or half a character
        raise InputError(str(path), [("", f"cannot be read: {error}")]) from None


def parse_file(path: Traversable | Path, source: str) -> dict[str, Any]:
    """The fields of a TOML or JSON file; `source` is what errors call it.

    Raises
    ------
    InputError
        if it cannot be read or parsed, or is no table of fields.
    """
    text = read_text(path)
    try:
        given = json.loads(text) if path.name.endswith(".json") else tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # a number of thousands of digits is a plain ValueError
        raise InputError(source, [("", f"cannot be parsed: {error}")]) from None
    if halves := half_characters(text, given):
        raise InputError(source, halves)
    if not isinstance(given, dict):
        raise InputError(source, [("", "must be a table of fields")])
    return given
