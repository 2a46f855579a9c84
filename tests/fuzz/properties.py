"""A property that is fuzzed: what is drawn, and what must hold of it; for tests, and for `python -m tests.fuzz`."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

CASE_MAX_S = 60.0
"""No case takes longer on the slowest machine [s]; the slowest seen takes a hundredth."""

MEMORY_MAX_MB = 1000.0
"""A process grows by no more over all its cases [MB]."""


@dataclass
class Property:
    """`check(drawn)` raises where `drawn` finds a defect."""

    name: str
    drawn: st.SearchStrategy[Any]
    check: Callable[[Any], None]

    def run(self, cases: int, number: int | None = None) -> int:
        """Check it on that many cases, the same each time unless a seed says which; how many there were."""
        tried, grown = 0, _memory_mb()

        def checked(value: Any) -> None:
            nonlocal tried
            tried += 1
            began = time.monotonic()
            self.check(value)
            assert time.monotonic() - began < CASE_MAX_S
            assert _memory_mb() - grown < MEMORY_MAX_MB

        test = settings(
            max_examples=cases, deadline=None, derandomize=number is None, database=None,
            phases=(Phase.generate, Phase.shrink), suppress_health_check=list(HealthCheck),
        )(given(self.drawn)(checked))  # fmt: skip
        if number is not None:
            test = seed(number)(test)
        test()
        return tried


def _memory_mb() -> float:
    """What this process holds [MB]."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
