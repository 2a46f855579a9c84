"""How our kernels are compiled: formulas shared by every engine, kernels, and what stands for others in them."""

from __future__ import annotations

import inspect
import logging
from collections.abc import Callable
from functools import cache, cached_property
from types import FunctionType
from typing import Any, TypeVar, cast

import numba
from numba.core.registry import CPUDispatcher
from numba.extending import overload, register_jitable

from station import kernel_cache

log = logging.getLogger(__name__)

F = TypeVar("F", bound=Callable[..., Any])

kernel_cache.install()


def numba_type(value: Any) -> Any:
    """The Numba type of a value, for signatures."""
    typeof: Callable[[Any], Any] = numba.typeof
    return typeof(value)


def formula(function: F) -> F:
    """A formula every engine shares: called from Python, traced by CasADi and Pyomo, inlined by kernels."""
    register_jitable(function)
    return function


_jit: Any = numba.jit
"""Numba's decorator; it takes options that its own types leave out."""

_KERNEL: dict[str, Any] = {"nopython": True, "nogil": True, "error_model": "numpy", "_nrt": True}
"""Numba's options of each kernel: free of the interpreter lock, strict IEEE arithmetic, references counted.

The last is said since a kernel else takes it from the first that calls it.
"""

_UNCOUNTED: dict[str, Any] = {"_nrt": False}
"""Numba's own option: no references are counted. A function that makes an array is then refused."""


_MERGED: Any = {**_KERNEL, **_UNCOUNTED, "forceinline": True}


def merged(function: F) -> F:
    """A formula that the compiler must merge into its callers, uncounted like `inlined`; Python calls it as it is."""
    register_jitable(**_MERGED)(function)
    return function


def specialised(choose: Callable[[type[Any]], Any]) -> Callable[[F], F]:
    """A function that stands for others: the one of its name, of what `choose` gives for the class of `plant`.

    Where a kernel calls it the choice is made once, when that kernel is compiled for a class of NamedTuples, and the
    function chosen is merged into the kernel. It must have the same arguments, by name. Python calls the function
    itself, which may choose likewise.
    """

    def register(function: F) -> F:
        signature = inspect.signature(function)
        place = list(signature.parameters).index("plant")

        def pick(*given: Any) -> Any:
            return getattr(choose(given[place].instance_class), function.__name__)

        vars(pick)["__signature__"] = signature
        overload(function, jit_options=_MERGED, strict=False)(pick)  # annotations may differ
        return function

    return register


class _InnerKernel(CPUDispatcher):
    """A kernel that kernels call.

    Numba makes wrappers for Python and C with each kernel, which takes half of the time that compiling does. This one
    has none. Where Python calls it all the same, a second kernel of the same source, with a wrapper, is compiled for
    the types of that call.
    """

    def add_overload(self, compiled: Any) -> None:
        """Keep what was compiled for the kernels that call it; Numba's own tells Python of it, too."""
        self.overloads[tuple(compiled.signature.args)] = compiled

    def _compile_for_args(self, *given: Any, **named: Any) -> Any:
        """What Python calls; Numba asks for it where arguments are of types that it was not told of."""
        tell = cast("Any", self)._insert  # noqa: SLF001
        known = set(self._called.overloads)
        found = self._called._compile_for_args(*given, **named)  # noqa: SLF001
        for types, compiled in self._called.overloads.items():
            if types not in known:
                tell([each._code for each in types], compiled.entry_point, compiled.objectmode)  # noqa: SLF001
        return found

    @cached_property
    def _called(self) -> Any:
        """The kernel that Python calls. It has a name of its own in the cache, which knows kernels by name."""
        given = self.py_func
        copy = FunctionType(given.__code__, given.__globals__, given.__name__, given.__defaults__, given.__closure__)
        copy.__qualname__ = f"{given.__qualname__}.called"
        options = {name: value for name, value in self.targetoptions.items() if name not in _UNWRAPPED}
        return _jit(cache=True, no_cfunc_wrapper=True, **options)(copy)


_UNWRAPPED: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}


def _inner(function: F, **options: Any) -> F:
    made = _InnerKernel(function, targetoptions={**_KERNEL, **_UNWRAPPED, **options})
    made.enable_caching()
    return cast("F", made)


def kernel(function: F) -> F:
    """A compiled function that kernels call; strict IEEE arithmetic, free of the interpreter lock."""
    return _inner(function)


def uncounted(function: F) -> F:
    """A kernel that neither makes an array nor gives one back, and so need not count references to those it is given.

    Each reference costs two atomic operations; where a view is taken in a hot loop they cost more than the loop.
    """
    return _inner(function, **_UNCOUNTED)


def inlined(function: F) -> F:
    """An uncounted kernel that the compiler must merge into its caller: for what runs every second."""
    return _inner(function, forceinline=True, **_UNCOUNTED)


def entry(*signatures: Any) -> Callable[[F], F]:
    """A kernel that Python calls: compiled for its signatures when the module is imported, then cached."""

    def compile_once(function: F) -> F:
        _say(function)
        return cast("F", _jit(list(signatures), cache=True, no_cfunc_wrapper=True, **_KERNEL)(function))

    return compile_once


def callback(signature: Any, *, counted: bool = True) -> Callable[[F], F]:
    """A kernel handed to another kernel as a function pointer; `counted` unless it could be `uncounted`."""
    options = {} if counted else _UNCOUNTED

    def compile_once(function: F) -> F:
        _say(function)
        return cast("F", numba.cfunc(signature, cache=True, error_model="numpy", **options)(function))

    return compile_once


@cache
def _is_new(module: str) -> bool:
    """Whether the kernels of a module are still to be compiled; those of other packages stand in one folder."""
    folder = kernel_cache.folder_of(module if module in kernel_cache.modules() else "others")
    return not any(folder.rglob(f"{module.rpartition('.')[2]}.*.nbi"))


def _say(function: Callable[..., Any]) -> None:
    if _is_new(function.__module__):
        log.info("compiling %s.%s, once for its sources", function.__module__, function.__name__)
