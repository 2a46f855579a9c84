"""Compiled kernels of earlier versions of this installation: each takes some 30 MB, and nobody else removes them."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator
from pathlib import Path

from station.compiled import CACHE_FOLDER

KEPT_DAYS = 30.0
"""Kernels that nobody has read for so long are removed; at worst they are compiled once more [days]."""


def remove_unused(current: Path = CACHE_FOLDER) -> Iterator[Path]:
    """Remove the kernels of earlier sources of this installation that nobody has read for long; gives each folder.

    A folder of kernels is named after its sources. Inside, Numba names a folder after each folder of sources, so those
    of another installation share no name with ours.
    """
    ours = _sources(current)
    before = time.time() - 86_400 * KEPT_DAYS
    for folder in sorted(current.parent.glob("kernels-*")):
        if folder != current and ours & _sources(folder) and _last_read(folder) < before:
            shutil.rmtree(folder, ignore_errors=True)
            yield folder


def _sources(folder: Path) -> set[str]:
    """Names of the folders inside, but for the one that is named the same everywhere."""
    return {path.name for path in folder.glob("*_*") if path.is_dir()}


def _last_read(folder: Path) -> float:
    """When a file of it was last read or written [s, Unix time]."""
    files = [path.stat() for path in folder.rglob("*") if path.is_file()]
    return max((max(found.st_atime, found.st_mtime) for found in files), default=0.0)
