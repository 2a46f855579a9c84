"""The thesis's examples of chapters 3 and 4 as systems, and its Table 3.3."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

from theory.errors import IllPosedError
from theory.system import NAMES, SwitchedSystem

TABLE_3_3_TAU = 3
"""Dwell time of Table 3.3 [samples]; the thesis never states it."""


@dataclass(frozen=True)
class Printed:
    """A cell of Table 3.3: the l2 gain for a delay and a lift."""

    delay: int
    lift: int
    gain: float


def example(name: str) -> SwitchedSystem:
    """The system of an example: `example_3_1`, `example_3_2`, `example_4_3` or `example_4_4`."""
    found = _data().get(name)
    if not isinstance(found, dict):
        raise IllPosedError("example", f"{name!r} is none of {', '.join(examples())}")
    return SwitchedSystem(**{key: found[key] for key in NAMES if key in found})


def examples() -> list[str]:
    """Names of the examples."""
    return [name for name in _data() if name.startswith("example")]


def table_3_3() -> list[Printed]:
    """The printed l2 gains."""
    return [Printed(**row) for row in _data()["table_3_3"]]


@cache
def _data() -> dict[str, Any]:
    return tomllib.loads((files("theory") / "data" / "examples.toml").read_text(encoding="utf-8"))
