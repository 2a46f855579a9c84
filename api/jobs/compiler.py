"""Kernels are compiled beside the service: it answers at once, and controllers become usable one after the other."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence

from controllers.registry import leave_compiling, uncompiled
from station.kernel_cache import CACHE_FOLDER


class Compiler:
    """`hrs compile` in a process of its own, where something is left to compile."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None

    def start(self, first: Sequence[str] = ()) -> list[str]:
        """Begin, with some controllers before the others; gives the names of those that are not ready."""
        missing = uncompiled(first)
        if missing:
            command = [sys.executable, "-c", "from api.cli.main import main; main()", "compile", *first]
            # The folder may be this process's own, where no cache of the user's can be written.
            variables = {**os.environ, "NUMBA_CACHE_DIR": str(CACHE_FOLDER)}
            self._process = subprocess.Popen(command, stdout=subprocess.DEVNULL, env=variables)
            leave_compiling(self.at_work)
        return missing

    def at_work(self) -> bool:
        """Whether it is still compiling."""
        return self._process is not None and self._process.poll() is None

    def close(self) -> None:
        """Stop; what is compiled stays."""
        if self._process is not None:
            self._process.terminate()
            self._process.wait()
