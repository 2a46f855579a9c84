"""The registry of controllers, and which of them are compiled: that takes minutes, once for a version."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

from station.errors import StationError
from station.kernel_cache import CACHE_FOLDER, fingerprint

log = logging.getLogger(__name__)

ENTRY_POINTS = "hrs.controllers"
"""Group of entry points that name controllers; any installed package can add one."""

THESIS_CONTROLLERS = ("logic", "minlp1", "minlp2", "minlp3")
"""The controllers that the thesis compares: compiled and preloaded before all others."""

FALLBACK = "logic"
"""Who is asked where the shield closes a valve or a deadline passes."""


@cache
def controllers() -> dict[str, EntryPoint]:
    """The controllers that are installed, by name; looked up once a process: it reads every package's metadata."""
    return {point.name: point for point in sorted(entry_points(group=ENTRY_POINTS), key=lambda point: point.name)}


class UncompiledError(StationError):
    """The kernels of a controller are still being compiled by another process."""


_COMPILED = CACHE_FOLDER / "controllers"
"""Folder with an empty file for each controller whose kernels, as their sources are now, are in the cache."""


def _mark(name: str) -> Path:
    """The file of a controller: named after the sources of its kernels."""
    return _COMPILED / f"{name}-{fingerprint(controllers()[name].module)}"


def is_compiled(name: str) -> bool:
    """Whether the kernels of an installed controller are in the cache."""
    return _mark(name).exists()


_at_work: Callable[[], bool] = lambda: False  # noqa: E731


def leave_compiling(at_work: Callable[[], bool]) -> None:
    """From now on this process compiles nothing as long as `at_work()`: another one does."""
    global _at_work  # noqa: PLW0603  # a process has one compiler
    _at_work = at_work


def uncompiled(first: Sequence[str] = ()) -> list[str]:
    """Controllers whose kernels are not in the cache, some of them before the others."""
    missing = [name for name in controllers() if not is_compiled(name)]
    return sorted(missing, key=lambda name: name not in first)


def compile_all(first: Sequence[str] = ()) -> Iterator[str]:
    """Compile the kernels of each controller that lacks them, some minutes in all; gives the name of each when done."""
    for name in uncompiled(first):
        with _alone():
            if name in uncompiled():
                _try_to_load(name)
                _mark(name).touch()
        yield name


@contextmanager
def _alone() -> Iterator[None]:
    """While nobody else on this machine compiles: two would do the same work twice."""
    _COMPILED.mkdir(parents=True, exist_ok=True)
    with (_COMPILED / ".lock").open("w") as lock:
        with suppress(ImportError):  # an operating system without such locks
            import fcntl

            fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def load_all() -> None:
    """Load every controller that is compiled, so that later nobody waits for an import: some 2 s in a process."""
    for name in controllers():
        if is_ready(name):
            _try_to_load(name)


def is_ready(name: str) -> bool:
    """Whether no other process is compiling a controller's kernels."""
    return not _at_work() or is_compiled(name)


def load(name: str) -> Any:
    """Constructor of an installed controller.

    Raises
    ------
    UncompiledError
        while another process compiles its kernels.
    """
    if not is_ready(name):
        raise UncompiledError(f"controller {name} is being compiled, once for this version; try again in a minute")
    return controllers()[name].load()


def _try_to_load(name: str) -> None:
    try:
        load(name)
    except ImportError:
        log.exception("controller %s cannot be loaded", name)
    except UncompiledError:
        log.warning("controller %s is not compiled yet", name)
