"""`hrs compare` as a user starts it: from the shell with compiled kernels at hand, and the very first time."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator

from benchmarks.measure import Bar, Row, repeated

_COMMAND = (sys.executable, "-c", "from api.cli.main import main; main()", "compare")

WARM_BAR = Bar("at most", 3.0)  # seconds
FIRST_BAR = Bar("at most", 40.0)  # seconds


def _compare(environment: dict[str, str]) -> None:
    """Run the default comparison in a process of its own, its output thrown away."""
    subprocess.run(_COMMAND, env=environment, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def warm(repeats: int) -> Iterator[Row]:
    """`hrs compare` with its kernels compiled before; wall clock."""
    environment = dict(os.environ)
    _compare(environment)
    yield Row("hrs compare from the shell, kernels cached (wall)", repeated(lambda: _compare(environment), repeats),
              "s", WARM_BAR)  # fmt: skip


def first() -> Iterator[Row]:
    """`hrs compare` where no kernel was ever compiled; wall clock."""
    with tempfile.TemporaryDirectory() as empty:
        environment = {key: value for key, value in os.environ.items() if key != "NUMBA_CACHE_DIR"}
        environment["XDG_CACHE_HOME"] = empty
        seconds = repeated(lambda: _compare(environment), 1)
    yield Row("hrs compare from the shell, the first time (wall)", seconds, "s", FIRST_BAR)
