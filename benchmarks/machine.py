"""The machine and the versions a measurement was made with."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from api.comparisons.service import cores

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
