"""Kernels called from Python every second: the types of their arguments are looked up once.

Numba looks up the types of nested tuples that hold a function pointer anew in each call, which costs five times what
the second itself does.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, ParamSpec, TypeVar

from station.compiled import numba_type

G = ParamSpec("G")
R = TypeVar("R")


class EntryPoint(Generic[G, R]):
    """An `entry` kernel for arguments of the types that it is first called with, by position.

    Later calls must have arguments of those types: an array of another layout, or a plant of another class, needs
    another EntryPoint.
    """

    def __init__(self, kernel: Callable[G, R]) -> None:
        self._kernel: Any = kernel
        self._found: Callable[..., R] | None = None

    def __call__(self, *given: G.args, **_none: G.kwargs) -> R:
        """What the kernel answers.

        Raises
        ------
        TypeError
            if the kernel was compiled for no arguments of these types.
        """
        if self._found is None:
            types = tuple(map(numba_type, given))
            if types not in self._kernel.overloads:
                raise TypeError(f"{self._kernel.__name__} is compiled for no arguments of the types {types}")
            self._found = self._kernel.overloads[types].entry_point
        return self._found(*given)
