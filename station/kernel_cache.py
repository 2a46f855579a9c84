"""The cache of compiled kernels: a folder for each module, named after the sources its kernels are made from.

Those are the module and all it imports from our rooms, what these import, and the data files they read. So an edit
compiles again what is made from the edited file, and nothing else; and no stale kernel can be found, for its folder has
another name. Numba itself looks only at the file a kernel stands in, not at those of the formulas it calls.
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
_DATA = re.compile(r"""files\("(\w+)"\)((?:\s*/\s*"[^"]+")+)""")
"""Of a source: a folder or file of a package's data, by importlib.resources."""

_GIVEN = {"alarms", "presets", "scenarios"}
"""Folders of data that no kernel is made from: runs are given what stands there."""

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


@cache
def _files() -> dict[str, Path]:
    """The source of each module of our rooms."""
    found = {}
    for room in _ROOMS:
        for folder, _, names in os.walk(TOP / room):
            package = Path(folder).relative_to(TOP).parts
            for name in names:
                if name.endswith(".py"):
                    parts = package if name == "__init__.py" else (*package, name.removesuffix(".py"))
                    found[".".join(parts)] = Path(folder, name)
    return found


@cache
def _stub(package: str) -> str:
    """The stub by which a package of our rooms is loaded lazily; "" where it has none."""
    file = TOP.joinpath(*package.split("."), "__init__.pyi")
    return file.read_text(encoding="utf-8") if package in _files() and file.is_file() else ""


def _named(module: str, names: str) -> Iterator[str]:
    """What an import of names from a module may load: it, its submodules, and all that its stub imports them from."""
    yield module
    found = [f"{module}.{name}" for name in _NAME.findall(names)]
    yield from found
    if not all(name in _files() for name in found):
        for source, _, _ in _IMPORT.findall(_stub(module)):
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
    file = _files()[module]
    package = module if file.name == "__init__.py" else module.rpartition(".")[0]
    found = {name for name in (module, *_imports(_text(module).decode(), package)) if name in _files()}
    packages = {name[:end] for name in found for end, letter in enumerate(name) if letter == "."}
    return frozenset(found | packages)


@cache
def _text(module: str) -> bytes:
    return _files()[module].read_bytes()


def _data(module: str) -> list[Path]:
    """The data files that a module's source names."""
    found = []
    for room, names in _DATA.findall(_text(module).decode()):
        place = TOP.joinpath(room, *re.findall(r'"([^"]+)"', names))
        if place.name not in _GIVEN:
            found += [place] if place.is_file() else sorted(file for file in place.rglob("*") if file.is_file())
    return found


@cache
def _digest(module: str) -> bytes:
    digest = hashlib.sha256(_text(module))
    for file in _data(module):
        digest.update(file.name.encode() + file.read_bytes())
    return digest.digest()


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
    names = closure(module) if module in _files() else frozenset(_files())
    digest = hashlib.sha256(f"{numba.__version__} {TOP} {module}".encode())
    for name in sorted(names):
        digest.update(name.encode() + _digest(name))
    return digest.hexdigest()[:16]


def modules() -> list[str]:
    """The modules of our rooms."""
    return sorted(_files())


@cache
def folder_of(module: str) -> Path:
    """Folder of a module's kernels, as its sources are now."""
    return CACHE_FOLDER / f"{module}-{fingerprint(module)}"


class _Locator:
    """Tells Numba the folder of a function's module, for modules of our rooms; Numba asks for these five methods."""

    def __init__(self, line: int, folder: Path) -> None:
        self._line, self._folder = line, folder

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> _Locator | None:
        """The locator of a function; None where it is not ours, or its folder cannot be written.

        Functions of other packages may be made from ours: their kernels stand in a folder for all our sources.
        """
        module = _module(py_file)
        if module not in _files():
            vars(numba.config)["CACHE_DIR"] = str(folder_of("others"))
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


@cache
def _module(file: str) -> str:
    """Name of the module that a file below TOP is; "" for another."""
    path = Path(file)
    if not path.is_relative_to(TOP):
        return ""
    below = path.relative_to(TOP)
    return ".".join(below.parts[:-1] if below.stem == "__init__" else below.with_suffix("").parts)


def install() -> None:
    """Let Numba keep kernels so."""
    locators: list[Any] = caching.CompileResultCacheImpl._locator_classes  # noqa: SLF001  # Numba has no other way
    locators.insert(0, _Locator)
