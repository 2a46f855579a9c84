"""A unit of others, stepped in a process of its own: it is native code, which may crash or hang."""

from __future__ import annotations

import math
import multiprocessing
import signal
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple, Self
from zipfile import BadZipFile, ZipFile

from api.bridges.fmi.unit_host import Opening, host
from api.bridges.fmi.unit_map import OUTPUTS, Channel, UnitMap, Wiring, wired
from station.errors import InputError, StationError

PATIENCE_S = 30.0
"""A unit that has not answered for so long hangs [s]."""

CLOSE_S = 2.0
"""How long a unit may take to end in order [s]."""

Assignments = Sequence[tuple[str, float]]
"""Values of inputs by quantity, in the quantities' own units."""


class UnitError(StationError):
    """A foreign unit refuses, crashed, hangs, or shows what cannot be."""


class Described(NamedTuple):
    """What is read of a unit before any of its code runs."""

    path: Path
    version: int
    token: str
    identifier: str
    wiring: Wiring


def describe(path: Path, given: UnitMap, source: str) -> Described:
    """A unit's description, with the variables of a map found in it; none of its code is run.

    Raises
    ------
    InputError
        if it is no unit of FMI 2.0 or 3.0 for co-simulation, has no binary for this platform, or the map, which errors
        call `source`, does not fit.
    """
    import fmpy

    try:
        description = fmpy.read_model_description(path)
        with ZipFile(path) as archive:
            names = archive.namelist()
    except OSError as error:
        raise InputError(str(path), [("", f"cannot be read: {error.strerror or error}")]) from None
    except BadZipFile:
        raise InputError(str(path), [("", "must be an FMU: it is no ZIP archive")]) from None
    except Exception as error:  # noqa: BLE001 - FMPy and its XML parser raise what they find
        raise InputError(str(path), [("modelDescription.xml", f"is not valid: {error!s:.500}")]) from None
    version = int(description.fmiVersion.partition(".")[0])
    if version not in (2, 3):
        raise InputError(str(path), [("fmiVersion", f"must be 2.0 or 3.0; given {description.fmiVersion!r}")])
    if description.coSimulation is None:
        raise InputError(str(path), [("", "must be a unit for co-simulation; it is for model exchange alone")])
    identifier = description.coSimulation.modelIdentifier
    where = fmpy.platform if version == 2 else fmpy.platform_tuple
    if f"binaries/{where}/{identifier}{fmpy.sharedLibraryExtension}" not in names:
        there = sorted({name.split("/")[1] for name in names if name.startswith("binaries/") and name.count("/") > 1})
        raise InputError(
            str(path), [("binaries", f"must have one for {where}, this platform; given {', '.join(there) or 'none'}")]
        )
    token = description.guid if version == 2 else description.instantiationToken
    return Described(path, version, token, identifier, wired(given, description, source))


class ForeignUnit:
    """A unit that lives in a process of its own; a context manager that ends it.

    Parameters
    ----------
    described
        The unit, and the map of its variables.
    patience_s
        A unit that has not answered for so long is ended [s].
    """

    def __init__(self, described: Described, patience_s: float = PATIENCE_S) -> None:
        self._described, self._patience = described, patience_s
        self._time = 0.0  # to which it was stepped [s]
        self._folder = tempfile.TemporaryDirectory(prefix="hrs-fmu-", ignore_cleanup_errors=True)
        context = multiprocessing.get_context("spawn")  # a process that has loaded no code but ours and FMPy's
        self._pipe: Connection
        self._pipe, theirs = context.Pipe()
        self._process: Any = context.Process(target=host, args=(theirs,), daemon=True, name="foreign unit")
        self._process.start()
        theirs.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def wiring(self) -> Wiring:
        """The map of its variables."""
        return self._described.wiring

    def begin(self, inputs: Assignments) -> dict[str, float]:
        """Load it and initialise it with its parameters and these inputs; its outputs by quantity then.

        Raises
        ------
        UnitError
            if it refuses, crashes or hangs, or shows what cannot be.
        """
        unit = self._described
        parameters = [(channel.type, channel.reference, value) for channel, value in unit.wiring.parameters]
        shown = unit.wiring.outputs.items()
        outputs = [(channel.type, channel.reference, name.startswith("flow")) for name, channel in shown]
        opening = Opening(
            str(unit.path), self._folder.name, unit.version, unit.token, unit.identifier,
            [*parameters, *self._set(inputs)], outputs, unit.wiring.steps_per_second,
        )  # fmt: skip
        return self._asked(opening)

    def step(self, before: Assignments, inputs: Assignments) -> dict[str, float]:
        """A second with these inputs, after those of `before` were set and gone by; the outputs by quantity at its end.

        Raises
        ------
        UnitError
            if it refuses, crashes or hangs, or shows what cannot be.
        """
        time = self._time
        self._time += 1.0
        return self._asked((time, self._set(before), self._set(inputs)))

    def _set(self, given: Assignments) -> list[tuple[str, int, float]]:
        channels = self.wiring.inputs
        found = [(channels[name], value) for name, value in given if name in channels]
        return [(channel.type, channel.reference, channel.written(value)) for channel, value in found]

    def _asked(self, message: Any) -> dict[str, float]:
        try:
            self._pipe.send(message)
            if not self._pipe.poll(self._patience):
                self._process.kill()
                raise self._wrong(f"has not answered for {self._patience:g} s, and was ended")
            kind, answer = self._pipe.recv()
        except (EOFError, OSError):
            self._process.join(CLOSE_S)
            raise self._wrong(f"has crashed: its process ended with {_ending(self._process.exitcode)}") from None
        if kind == "error":
            raise self._wrong(answer)
        return {
            name: self._checked(channel, channel.read(value))
            for (name, channel), value in zip(self.wiring.outputs.items(), answer, strict=True)
        }

    def _checked(self, channel: Channel, value: float) -> float:
        known = OUTPUTS[channel.quantity]
        if math.isfinite(value) and known.low <= value <= known.high:
            return value
        raise self._wrong(
            f"{channel.quantity}, its variable {channel.variable!r}, must lie within {known.low:g} and {known.high:g} "
            f"{known.unit}; given {value:g}"
        )

    def _wrong(self, message: str) -> UnitError:
        return UnitError(f"{self._described.path}, at {self._time:g} s: {message}")

    def close(self) -> None:
        """End it; one that does not end in order is killed."""
        with suppress(OSError):
            self._pipe.send(None)
        self._process.join(CLOSE_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._pipe.close()
        self._folder.cleanup()


def _ending(code: int | None) -> str:
    """How a process ended."""
    if code is not None and code < 0:
        return f"signal {signal.Signals(-code).name}"
    return f"status {code}"
