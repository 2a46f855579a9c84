"""A measured row: every repeat kept, its median and range, and the bar it is held against."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal


@dataclass(frozen=True)
class Bar:
    """What a row must reach."""

    kind: Literal["at most", "at least"]
    value: float

    def holds(self, measured: float) -> bool:
        """Whether `measured` reaches it."""
        return measured <= self.value if self.kind == "at most" else measured >= self.value


@dataclass(frozen=True)
class Row:
    """One thing measured, with all its repeats in `unit`."""

    what: str
    repeats: tuple[float, ...]
    unit: str
    bar: Bar | None = None

    @property
    def median(self) -> float:
        """Median of the repeats, which is what the bar is held against."""
        return statistics.median(self.repeats)

    @property
    def ok(self) -> bool | None:
        """Whether the bar is reached; None where there is none."""
        return None if self.bar is None else self.bar.holds(self.median)

    def as_dict(self) -> dict[str, Any]:
        """The row for JSON."""
        bar = None if self.bar is None else {self.bar.kind: self.bar.value}
        return {"what": self.what, "unit": self.unit, "median": self.median, "repeats": list(self.repeats),
                "bar": bar, "ok": self.ok}  # fmt: skip


def number(value: float) -> str:
    """Three significant digits, and no exponent where none is needed."""
    return f"{value:,.0f}".replace(",", " ") if abs(value) >= 100 else f"{value:.3g}"


def cells(row: Row) -> tuple[str, str, str, str]:
    """The row as text: what, median with range, bar, ok."""
    unit = "" if row.unit == "1" else f" {row.unit}"
    measured = f"{number(row.median)}{unit}"
    if len(row.repeats) > 1:
        measured += f" ({number(min(row.repeats))} to {number(max(row.repeats))})"
    bar = "" if row.bar is None else f"{'<=' if row.bar.kind == 'at most' else '>='} {row.bar.value:g}{unit}"
    return row.what, measured, bar, "" if row.ok is None else "yes" if row.ok else "NO"


def repeated(
    action: Callable[[], object], repeats: int, clock: Callable[[], float] = time.perf_counter
) -> tuple[float, ...]:
    """Seconds by `clock` of each of `repeats` calls."""
    found = []
    for _ in range(repeats):
        before = clock()
        action()
        found.append(clock() - before)
    return tuple(found)
