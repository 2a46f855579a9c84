"""The machine and the versions a measurement was made with."""

from __future__ import annotations

import os
import platform
import time
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from api.jobs.cores import cores

PACKAGES = {"numba": "numba", "numpy": "numpy", "Pyomo": "pyomo", "SCIP": "pyscipopt", "CasADi": "casadi"}
"""What is shown, and the package whose version it is."""


def cpu_model() -> str:
    """The processor's name, as the kernel gives it."""
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def machine() -> dict[str, str]:
    """Processor, cores, system and versions, each as text."""
    found = {
        "CPU": cpu_model(),
        "cores": str(cores()),
        "system": f"{platform.system()} {platform.machine()}",
        "Python": platform.python_version(),
    }
    for name, package in PACKAGES.items():
        try:
            found[name] = f"{_scip()} (PySCIPOpt {version(package)})" if name == "SCIP" else version(package)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found


def _scip() -> str:
    """SCIP's own version, which is not PySCIPOpt's."""
    import pyscipopt  # slow to import

    model = pyscipopt.Model()
    return f"{model.getMajorVersion()}.{model.getMinorVersion()}.{model.getTechVersion()}"


class Neighbours:
    """How much of the machine other processes take while something is measured."""

    def __init__(self) -> None:
        self._began = self._now()

    @staticmethod
    def _now() -> tuple[float, float, float]:
        """Wall clock, CPU time of the whole machine where it can be read, and of this process with its children [s]."""
        times = os.times()
        own = times.user + times.system + times.children_user + times.children_system
        try:
            user, nice, system = Path("/proc/stat").read_text().split()[1:4]
            whole = (int(user) + int(nice) + int(system)) / os.sysconf("SC_CLK_TCK")
        except OSError:
            whole = own
        return time.monotonic(), whole, own

    def share(self) -> float:
        """Cores that other processes kept busy on average since this was made; 0 where that cannot be told."""
        wall, whole, own = (now - then for now, then in zip(self._now(), self._began, strict=True))
        return max(0.0, whole - own) / wall if wall > 0 else 0.0
