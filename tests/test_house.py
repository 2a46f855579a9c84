"""The house plan holds: imports run downward, and the repository speaks of the product alone."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

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
