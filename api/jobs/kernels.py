"""Compiled kernels of earlier sources of this installation: some 30 MB for all, and nobody else removes them."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator
from pathlib import Path

from station.kernel_cache import CACHE_FOLDER, folder_of, modules

KEPT_DAYS = 30.0
"""Kernels that nobody has read for so long are removed; at worst they are compiled once more [days]."""

_MARKS = "controllers"
"""Folder of the marks of compiled controllers."""


def remove_unused(current: Path = CACHE_FOLDER) -> Iterator[Path]:
    """Remove the kernels of earlier sources of this installation that nobody has read for long; gives each folder.

    Within the folder of this installation (`current`) that is the folder of a module whose sources have changed since;
    beside it, the folders of this installation by another version of Numba.
    """
    installation = current.name.rpartition("-")[0]
    kept = {_MARKS, *(folder_of(module).name for module in (*modules(), "others"))}
    beside = [folder for folder in current.parent.glob(f"{installation}-*") if installation and folder != current]
    inside = [folder for folder in current.glob("*") if folder.is_dir() and folder.name not in kept]
    before = time.time() - 86_400 * KEPT_DAYS
    for folder in sorted([*beside, *inside]):
        if _last_read(folder) < before:
            shutil.rmtree(folder, ignore_errors=True)
            yield folder


def _last_read(folder: Path) -> float:
    """When a file of it was last read or written [s, Unix time]."""
    files = [path.stat() for path in folder.rglob("*") if path.is_file()]
    return max((max(found.st_atime, found.st_mtime) for found in files), default=0.0)
