"""Kernels of earlier versions are removed when nobody has read them for long, and no others."""

from __future__ import annotations

import os
import time

import pytest

from api.jobs.kernels import remove_unused

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
    now = folder("kernels-now", "station_1", 40)
    old = folder("kernels-old", "station_1", 31)
    kept = [folder("kernels-read", "station_1", 29), folder("kernels-others", "station_2", 31), now]
    kept.append(folder("models-old", "station_1", 31))
    assert list(remove_unused(now)) == [old]
    assert not old.exists()
    assert all((each / "controllers" / "logic").exists() for each in kept)


def test_an_installation_without_kernels_removes_none(folder, tmp_path):
    folder("kernels-old", "station_1", 31)
    assert list(remove_unused(tmp_path / "kernels-none")) == []
