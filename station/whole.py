"""Integers of strict models; light, since the command line imports it."""

from __future__ import annotations

from typing import Any

from pydantic import BeforeValidator


def _whole(given: Any) -> Any:
    return int(given) if isinstance(given, float) and given.is_integer() else given


WHOLE = BeforeValidator(_whole)
"""Of an integer of a strict model, last in its annotation: JSON has one kind of number, so 1.0 is an integer."""
