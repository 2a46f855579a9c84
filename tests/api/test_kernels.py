"""Kernels of earlier versions are removed when nobody has read them for long, and no others."""

from __future__ import annotations

import os
import time

import pytest

from api.jobs.kernels import remove_unused
from station.kernel_cache import folder_of

DAY = 86_400


@pytest.fixture
def folder(tmp_path):
    """`folder("kernels-x", sources, days)`: kernels that were read so many days ago."""

    def make(name, sources, days):
        file = tmp_path / name / sources / "loop.run.nbc"
        for each in (file, tmp_path / name / "controllers" / "logic"):
            each.parent.mkdir(parents=True, exist_ok=True)
            each.touch()
            os.utime(each, (time.time() - days * DAY, time.time() - 90 * DAY))
        return tmp_path / name

    return make


def test_what_is_old_and_ours_is_removed(folder):
    now = folder("kernels-ours-1.0", folder_of("station.step").name, 40)
    old = folder("kernels-ours-1.0", "station.step-before", 31)
    read = folder("kernels-ours-1.0", "station.shield-before", 29)
    version = folder("kernels-ours-0.9", "station.step-before", 31)
    kept = [read, now, folder("kernels-others-1.0", "station.step-before", 31)]
    assert list(remove_unused(now)) == [version, old / "station.step-before"]
    assert not version.exists()
    assert {path.name for path in now.glob("station*")} == {folder_of("station.step").name, "station.shield-before"}
    assert all((each / "controllers" / "logic").exists() for each in kept)


def test_an_installation_without_kernels_removes_none(folder, tmp_path):
    folder("kernels-old-1.0", "station_1", 31)
    assert list(remove_unused(tmp_path / "kernels-none-1.0")) == []
