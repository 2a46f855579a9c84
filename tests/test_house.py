"""The house plan holds: imports run downward, and the repository speaks of the product alone."""

from __future__ import annotations

import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def test_imports_run_downward():
    tool = Path(sys.executable).with_name("lint-imports")
    done = subprocess.run([tool], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


def test_constants_stand_in_data_and_settings_only():
    """No figure of a preset is written in code a second time."""
    figures = set()
    for preset in (ROOT / "station" / "data" / "presets").glob("*.toml"):
        figures |= set(re.findall(r"\d+\.\d{6,}", preset.read_text()))
    assert len(figures) > 50
    for source in ROOT.glob("[sca]*/**/*.py"):
        assert not figures & set(re.findall(r"\d+\.\d{6,}", source.read_text())), source


@pytest.mark.parametrize("name", ["station", "theory"])
def test_every_name_of_a_room_is_there(name):
    room = import_module(name)
    assert {exported for exported in room.__all__ if getattr(room, exported) is None} == set()
    assert not hasattr(room, "nothing")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("module", "heavy"),
    [
        ("theory.checker", ("numpy", "scipy", "clarabel")),
        ("api.cli.main", ("numba", "scipy", "fastapi", "sqlalchemy")),
        ("api.certificates.questions", ("numba", "scipy", "fastapi", "sqlalchemy")),
        ("api.cli.serve", ("scipy.optimize", "scipy.stats", "casadi", "pyomo", "matplotlib")),
    ],
)
def test_nobody_waits_for_what_is_not_needed(module, heavy):
    """What takes long to import is imported where it is used."""
    code = f"import sys, {module}; print(*sorted(set({heavy!r}) & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.split() == []
