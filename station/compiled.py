"""How station code is compiled: one decorator for shared formulas, one for kernels, one cache for both."""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba.extending import register_jitable

F = TypeVar("F", bound=Callable[..., Any])

_ROOMS = ("station", "controllers")


def _fingerprint() -> str:
    """Hash of every source file that kernels are made from, and of the compiler's version."""
    digest = hashlib.sha256(numba.__version__.encode())
    top = Path(__file__).resolve().parent.parent
    for room in _ROOMS:
        for source in sorted((top / room).rglob("*.py")):
            digest.update(source.read_bytes())
    return digest.hexdigest()[:16]


def _cache_folder() -> Path:
    """Folder of the compiled kernels of exactly these sources.

    Numba checks only the file a kernel stands in, not the files of the formulas it calls, so a changed
    formula would go unnoticed; a folder per fingerprint makes a stale kernel impossible.
    """
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    if not os.access(base if base.exists() else base.parent, os.W_OK):
        base = Path(tempfile.gettempdir())
    return base / "hrs-twin" / f"kernels-{_fingerprint()}"


CACHE_FOLDER = Path(os.environ.get("NUMBA_CACHE_DIR") or _cache_folder())
numba.config.CACHE_DIR = str(CACHE_FOLDER)


def is_compiled() -> bool:
    """Whether kernels of these sources lie in the cache, so that a run starts at once."""
    return CACHE_FOLDER.exists()


def formula(function: F) -> F:
    """A formula every engine shares: called from Python, traced by CasADi and Pyomo, inlined by kernels."""
    return cast(F, register_jitable(function))


def kernel(function: F) -> F:
    """A compiled function that kernels call; strict IEEE arithmetic, free of the interpreter lock."""
    return cast(F, numba.njit(cache=True, nogil=True, error_model="numpy")(function))


def inlined(function: F) -> F:
    """A kernel that becomes part of its caller, for functions that take a whole run: its arrays are not copied."""
    return cast(F, numba.njit(inline="always", error_model="numpy")(function))


def entry(signature: Any) -> Callable[[F], F]:
    """A kernel that Python calls: compiled for one signature when the module is imported, then cached."""

    def compile_once(function: F) -> F:
        return cast(F, numba.njit(signature, cache=True, nogil=True, error_model="numpy")(function))

    return compile_once


def callback(signature: Any) -> Callable[[F], F]:
    """A kernel handed to another kernel as a function pointer."""

    def compile_once(function: F) -> F:
        return cast(F, numba.cfunc(signature, cache=True, error_model="numpy")(function))

    return compile_once
