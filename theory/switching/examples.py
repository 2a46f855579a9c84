"""The switched systems of the thesis's examples in chapters 3 and 4, and the l2 gains of Table 3.3."""

from __future__ import annotations

from dataclasses import dataclass

from theory.errors import IllPosedError
from theory.example_data import data
from theory.switching.language import ArbitrarySwitching, LabelledGraph, Language
from theory.switching.system import NAMES, SwitchedSystem

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
    found = data().get(name)
    if not isinstance(found, dict):
        raise IllPosedError("example", f"{name!r} is none of {', '.join(examples())}")
    return SwitchedSystem(**{key: found[key] for key in NAMES if key in found})


def examples() -> list[str]:
    """Names of the examples."""
    return [name for name in data() if name.startswith("example")]


@dataclass(frozen=True)
class Radius:
    """A published joint or constrained spectral radius."""

    name: str
    value: float
    system: SwitchedSystem
    language: Language


def radii() -> list[Radius]:
    """Published joint and constrained spectral radii, with their systems and languages."""
    found = []
    for row in data()["radii"]:
        system = SwitchedSystem(A=row["A"])
        free = "edges" not in row
        language = ArbitrarySwitching(modes=system.modes) if free else LabelledGraph(row["edges"], modes=system.modes)
        found.append(Radius(row["name"], row["value"], system, language))
    return found


def table_3_3() -> list[Printed]:
    """The printed l2 gains."""
    return [Printed(**row) for row in data()["table_3_3"]]
