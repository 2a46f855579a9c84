"""A station's plant as an FMU file: description, sources, and a binary for this machine."""

from __future__ import annotations

import hashlib
import io
import platform
import shutil
import subprocess
import sys
import tempfile
from importlib.resources import files
from pathlib import Path
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

from api.bridges.fmi.description import NAME, fmi2, fmi3, starts_of
from api.bridges.fmi.plant_code import header_of
from station import StationError
from station.parameters import Station

VERSIONS = {2: (fmi2, "linux64"), 3: (fmi3, "x86_64-linux")}
"""Of each version of the standard the maker of its description, and its name for this platform."""

FLAGS = ("-std=c99", "-O2", "-fPIC", "-shared", "-fvisibility=hidden", "-ffp-contract=off", "-Wall", "-Werror", "-s")
"""Of the compiler: products and sums are rounded one by one, as our kernels round them."""

COMPILE_S = 120.0
"""The compiler takes less than a second; after so long it hangs [s]."""


class ExportError(StationError):
    """This machine cannot make the binary of a unit."""


def fmu(station: Station, version: int) -> bytes:
    """The FMU of a station's plant, for co-simulation; the same bytes for the same station and compiler.

    Raises
    ------
    PlantError
        if the station's plant is another than the thesis's.
    ExportError
        if there is no C compiler, or this is no Linux on x86-64.
    """
    describe, where = VERSIONS[version]
    starts = starts_of(station)
    token = _token(station, version)
    header = header_of(station, station.name, token, starts)
    sources = {"core.h": _data("core.h"), "unit.h": header, f"fmi{version}.c": _data(f"fmi{version}.c")}
    content = {
        "modelDescription.xml": describe(station, token, starts),
        **{f"sources/{name}": text.encode() for name, text in sources.items()},
        f"binaries/{where}/{NAME}.so": _compiled(sources, f"fmi{version}.c"),
    }
    if version == 3:  # where FMI 2.0 lists them in the description
        content["sources/buildDescription.xml"] = _data("buildDescription.xml").encode()
    return _zipped(content)


def _data(name: str) -> str:
    return (files("api") / "bridges" / "fmi" / "data" / name).read_text(encoding="utf-8")


def _token(station: Station, version: int) -> str:
    """What an importer must show to instantiate the unit: a digest of the station, as a GUID."""
    digest = hashlib.sha256(f"{version} {station.model_dump_json()}".encode()).hexdigest()
    return "{" + "-".join((digest[:8], digest[8:12], digest[12:16], digest[16:20], digest[20:32])) + "}"


def _compiled(sources: dict[str, str], main: str) -> bytes:
    """The binary of the sources.

    Raises
    ------
    ExportError
        if it cannot be made here.
    """
    if sys.platform != "linux" or platform.machine() != "x86_64":
        message = f"the binary of an FMU is made on Linux on x86-64; this is {sys.platform} on {platform.machine()}"
        raise ExportError(message)
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        raise ExportError("an FMU needs a C compiler: there is no gcc and no cc in the PATH")
    with tempfile.TemporaryDirectory() as folder:
        for name, text in sources.items():
            Path(folder, name).write_text(text, encoding="utf-8")
        command = [compiler, *FLAGS, "-o", f"{NAME}.so", main, "-lm"]
        try:
            done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=COMPILE_S)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise ExportError(f"{compiler} cannot be run: {error}") from None
        if done.returncode != 0:
            raise ExportError(f"{compiler} failed: {done.stderr.strip()[:1000]}")
        return Path(folder, f"{NAME}.so").read_bytes()


def _zipped(content: dict[str, bytes]) -> bytes:
    """An archive without times, so that the same content gives the same bytes."""
    stream = io.BytesIO()
    with ZipFile(stream, "w", ZIP_DEFLATED) as archive:
        for name, data in content.items():
            archive.writestr(ZipInfo(name), data, ZIP_DEFLATED)
    return stream.getvalue()
