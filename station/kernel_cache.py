"""Where compiled kernels are kept: a folder for each module, named after the sources its kernels are made from.

Those are the module and all it imports from our rooms, and what these import. So an edit compiles again what is made
from the edited file, and nothing else; and no stale kernel can be found, for its folder has another name. Numba itself
looks only at the file a kernel stands in, not at those of the formulas it calls.
"""

from __future__ import annotations

import hashlib
import os
import re
import tempfile
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba.core import caching

_ROOMS = ("station", "controllers", "theory")
"""Packages whose modules kernels are made from."""

TOP = Path(__file__).resolve().parent.parent
"""Folder of the packages: another installation of the same version has kernels of its own."""

_IMPORT = re.compile(
    r"^[ \t]*(?:from[ \t]+([\w.]+)[ \t]+import[ \t]+(\([^)]*\)|[^\n]*)|import[ \t]+([^\n]*))", re.MULTILINE
)
_NAME = re.compile(r"\w+(?:\.\w+)*")


def _cache_folder() -> Path:
    """Folder of this installation's kernels by this Numba.

    Where no folder of the user's can be written, kernels live as long as the process, in a private folder.
    """
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    name = hashlib.sha256(str(TOP).encode()).hexdigest()[:12]
    folder = base / "hrs-twin" / f"kernels-{name}-{numba.__version__}"
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
    except OSError:
        return Path(tempfile.mkdtemp(prefix="hrs-twin-kernels-"))
    return folder


CACHE_FOLDER = Path(os.environ.get("NUMBA_CACHE_DIR") or _cache_folder())


def _file(module: str) -> Path | None:
    """The source of a module of our rooms, if there is one."""
    if module.split(".", 1)[0] not in _ROOMS:
        return None
    place = TOP.joinpath(*module.split("."))
    for found in (place.with_suffix(".py"), place / "__init__.py"):
        if found.is_file():
            return found
    return None


def _named(module: str, names: str) -> Iterator[str]:
    """What an import of names from a module may load: it, its submodules, and all that its stub imports them from."""
    yield module
    found = [f"{module}.{name}" for name in _NAME.findall(names)]
    yield from found
    stub = TOP.joinpath(*module.split("."), "__init__.pyi")
    if stub.is_file() and any(_file(name) is None for name in found):
        for source, _, _ in _IMPORT.findall(stub.read_text(encoding="utf-8")):
            yield _absolute(source, module)


def _absolute(source: str, package: str) -> str:
    """The module that an import names, from within a package."""
    name = source.lstrip(".")
    above = len(source) - len(name)
    if above == 0:
        return name
    parts = package.split(".")
    return ".".join([*parts[: len(parts) + 1 - above], *filter(None, [name])])


def _imports(text: str, package: str) -> Iterator[str]:
    """Modules that a source imports, wherever in it; what only looks like an import does no harm."""
    for source, names, plain in _IMPORT.findall(text):
        if source:
            yield from _named(_absolute(source, package), names)
        else:
            yield from _NAME.findall(plain)


@cache
def _sources(module: str) -> frozenset[str]:
    """The module, its packages, and the modules of our rooms that its source imports."""
    file = _file(module)
    if file is None:
        return frozenset()
    package = module if file.name == "__init__.py" else module.rpartition(".")[0]
    found = {module, *_imports(file.read_text(encoding="utf-8"), package)}
    packages = {name[:end] for name in found for end, letter in enumerate(name) if letter == "."}
    return frozenset(name for name in found | packages if _file(name) is not None)


@cache
def _digest(module: str) -> bytes:
    file = _file(module)
    return b"" if file is None else hashlib.sha256(file.read_bytes()).digest()


def closure(module: str) -> frozenset[str]:
    """The modules that the kernels of a module are made from, itself among them."""
    found: set[str] = set()
    waiting = [module]
    while waiting:
        name = waiting.pop()
        if name not in found:
            found.add(name)
            waiting += _sources(name) - found
    return frozenset(found)


@cache
def fingerprint(module: str) -> str:
    """Hash of all that the kernels of a module are made from; of all our rooms where the module is another's."""
    names = closure(module) if _file(module) is not None else frozenset(modules())
    digest = hashlib.sha256(f"{numba.__version__} {TOP} {module}".encode())
    for name in sorted(names):
        digest.update(name.encode() + _digest(name))
    return digest.hexdigest()[:16]


def modules() -> list[str]:
    """The modules of our rooms."""
    files = [file.relative_to(TOP) for room in _ROOMS for file in (TOP / room).rglob("*.py")]
    return sorted(
        ".".join(file.parts[:-1] if file.stem == "__init__" else file.with_suffix("").parts) for file in files
    )


def folder_of(module: str) -> Path:
    """Where the kernels of a module are kept, as its sources are now."""
    return CACHE_FOLDER / f"{module}-{fingerprint(module)}"


class _Locator:
    """Tells Numba the folder of a function's module, for modules of our rooms; Numba asks for these five methods."""

    def __init__(self, line: int, folder: Path) -> None:
        self._line, self._folder = line, folder

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> _Locator | None:
        """The locator of a function; None where it is not ours, or its folder cannot be written."""
        module = _module(py_file)
        if _file(module) is None:
            return None
        found = cls(py_func.__code__.co_firstlineno, folder_of(module))
        try:
            found.ensure_cache_path()
        except OSError:
            return None
        return found

    def ensure_cache_path(self) -> None:
        """Make the folder; raises OSError where it cannot be written."""
        self._folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=self._folder).close()

    def get_cache_path(self) -> str:
        """The folder."""
        return str(self._folder)

    def get_source_stamp(self) -> str:
        """The sources: Numba takes no kernel with another stamp."""
        return self._folder.name

    def get_disambiguator(self) -> str:
        """The line, which tells functions of one name apart."""
        return str(self._line)


def _module(file: str) -> str:
    """Name of the module that a file below TOP is; "" for another."""
    path = Path(file)
    if not path.is_relative_to(TOP):
        return ""
    below = path.relative_to(TOP)
    return ".".join(below.parts[:-1] if below.stem == "__init__" else below.with_suffix("").parts)


def install() -> None:
    """Let Numba keep kernels so: of other packages, which may be made from ours, in a folder for all our sources."""
    vars(numba.config)["CACHE_DIR"] = str(folder_of("others"))
    locators: list[Any] = caching.CompileResultCacheImpl._locator_classes  # noqa: SLF001  # Numba has no other way
    locators.insert(0, _Locator)
