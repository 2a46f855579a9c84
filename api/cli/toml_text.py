"""A table of fields as TOML text; the standard library reads TOML and does not write it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any


def toml_text(given: Mapping[str, Any]) -> str:
    """TOML of texts, numbers, lists and tables; a key whose value is none of these is an error.

    Raises
    ------
    TypeError
        if TOML has no such value.
    """
    return "\n".join(_lines(given, "")).strip() + "\n"


def _lines(given: Mapping[str, Any], path: str) -> list[str]:
    tables = {key: value for key, value in given.items() if isinstance(value, Mapping)}
    lines = [f"{_key(key)} = {_value(value)}" for key, value in given.items() if key not in tables]
    if path and (lines or not tables):
        lines = ["", f"[{path}]", *lines]
    for key, value in tables.items():
        lines += _lines(value, f"{path}.{_key(key)}" if path else _key(key))
    return lines


def _key(name: str) -> str:
    return name if name.isascii() and name.replace("_", "").replace("-", "").isalnum() else json.dumps(name)


def _value(value: Any) -> str:
    if isinstance(value, bool | str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, list | tuple):
        return f"[{', '.join(_value(each) for each in value)}]"
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_key(key)} = {_value(each)}" for key, each in value.items()) + " }"
    raise TypeError(f"TOML has no {type(value).__name__}")
