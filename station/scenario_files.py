"""Scenarios by name and from files: S1-S4 and examples in data/scenarios, TOML and JSON files, traces as CSV."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.resources import files
from pathlib import Path
from typing import Any

from station.errors import InputError
from station.files import parse_file
from station.parameters import Station
from station.scenario import Scenario, parse_scenario
from station.traces import TraceFile, read_trace

SCENARIOS = files("station") / "data" / "scenarios"


def scenarios() -> list[str]:
    """Names of the scenarios that ship with the package."""
    return sorted(item.name.removesuffix(".toml") for item in SCENARIOS.iterdir() if item.name.endswith(".toml"))


def load_scenario(name: str | Path, station: Station | None = None) -> Scenario:
    """The scenario of that name, or of a TOML, JSON or CSV file, at `station` instead of its own where one is given.

    A CSV file is a trace (see `read_trace`) at the default station. In a TOML or JSON file `arrivals.file` names
    a trace beside it.

    Raises
    ------
    InputError
        naming each wrong field with its limit, or the file that cannot be read.
    """
    elsewhere = {} if station is None else {"station": station.model_dump()}
    if str(name) in scenarios():
        return parse_scenario({**parse_file(SCENARIOS / f"{name}.toml", str(name)), **elsewhere}, str(name))
    path = Path(name)
    if path.suffix not in (".toml", ".json", ".csv"):
        known = ", ".join(scenarios())
        raise InputError(
            "scenario", [("", f"{str(name)!r} is neither a scenario ({known}) nor a .toml, .json or .csv file")]
        )
    if path.suffix == ".csv":
        return _with_trace({"name": path.stem[:64], **elsewhere}, {}, path, str(name))
    given = {**parse_file(path, str(name)), **elsewhere}
    arrivals = given.get("arrivals")
    if not isinstance(arrivals, dict) or "file" not in arrivals:
        return parse_scenario(given, str(name))
    rest = {key: value for key, value in arrivals.items() if key != "file"}
    return _with_trace(given, rest, path.parent / str(arrivals["file"]), str(name))


def _with_trace(given: dict[str, Any], arrivals: dict[str, Any], file: Path, source: str) -> Scenario:
    """The scenario with the vehicles of a CSV file as its arrivals."""
    trace = read_trace(file)
    with _lines_named(trace):
        return parse_scenario({**given, "arrivals": {"kind": "trace", **arrivals, "vehicles": trace.vehicles}}, source)


_VEHICLE = re.compile(r"\barrivals\.(?:trace\.)?vehicles\.([0-9]+)(?:\.(\w+))?")
"""Path of a vehicle, or of a field of one, in an error."""


@contextmanager
def _lines_named(trace: TraceFile) -> Iterator[None]:
    """Errors name the file, line and column where they would name the place in a list."""

    def placed(found: re.Match[str]) -> str:
        return trace.place(int(found[1]), found[2] or "")

    try:
        yield
    except InputError as error:
        located = [(_VEHICLE.sub(placed, field), _VEHICLE.sub(placed, message)) for field, message in error.problems]
        raise InputError(error.source, located) from None
