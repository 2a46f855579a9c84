"""Recorded days as CSV: one vehicle a line; what is wrong is named with its line and column."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import NamedTuple

from pydantic import ValidationError

from station.arrivals import TraceVehicle
from station.errors import InputError
from station.files import read_text

_COLUMNS = {"time_s", "start_pressure_bar", "volume_m3", "finish_pressure_bar"}
_REQUIRED = {"time_s", "start_pressure_bar"}

_BYTE_ORDER_MARK = "\ufeff"
"""Spreadsheets begin a text with it."""

_NAMED_MAX = 20
"""Wrong cells named at once."""


class TraceFile(NamedTuple):
    """The vehicles of a CSV text, and where each stands."""

    source: str  # name of the file; empty for a text
    vehicles: list[dict[str, float]]
    lines: list[int]  # of the vehicles, counted from 1

    def place(self, vehicle: int, column: str = "") -> str:
        """Position of a vehicle, or of its value in a column."""
        return _place(self.source, self.lines[vehicle], column)


def read_trace(path: Traversable | Path) -> TraceFile:
    """Vehicles of a CSV file with columns time_s, start_pressure_bar and, where wanted, volume_m3, finish_pressure_bar.

    Raises
    ------
    InputError
        naming the file, line and column that cannot be read or is beyond a limit.
    """
    return parse_trace(read_text(path), str(path))


def parse_trace(text: str, source: str = "") -> TraceFile:
    """Vehicles of a CSV text, of the file `source` if it has one; see `read_trace`.

    Raises
    ------
    InputError
        naming the line and column that cannot be read or is beyond a limit.
    """
    rows = _rows(text, source)
    header = [name.strip() for name in next(rows, (1, []))[1]]
    if not set(header) >= _REQUIRED or not set(header) <= _COLUMNS or len(set(header)) != len(header):
        names, extra = ", ".join(sorted(_REQUIRED)), ", ".join(sorted(_COLUMNS - _REQUIRED))
        given = ", ".join(header) or "nothing"
        message = f"columns must be {names} and may be {extra}; given {given:.200}"
        if len(header) == 1 and any(other in given for other in ";\t"):
            message = f"columns must be separated by commas, and a number has a point; given {given!r:.200}"
        problem = (_place(source, 1), message)
        raise InputError(source or "trace", [problem])
    found, problems = TraceFile(source, [], []), []
    for line, row in rows:
        if not row:
            continue
        vehicle, wrong = _vehicle(header, row)
        problems += [(_place(source, line, column), message) for column, message in wrong]
        if len(problems) >= _NAMED_MAX:
            break
        found.vehicles.append(vehicle)
        found.lines.append(line)
    if problems:
        raise InputError(source or "trace", problems[:_NAMED_MAX])
    return found


def _vehicle(header: list[str], row: list[str]) -> tuple[dict[str, float], list[tuple[str, str]]]:
    """The vehicle of a line, and (column, what is wrong)."""
    if len(row) != len(header):
        return {}, [("", f"must have {len(header)} values; given {len(row)}")]
    vehicle: dict[str, float] = {}
    wrong = []
    for column, cell in zip(header, row, strict=True):
        if not cell.strip() and column not in _REQUIRED:
            continue
        try:
            vehicle[column] = _number(cell)
        except ValueError:
            wrong.append((column, f"must be a number; given {cell!r:.100}"))
    if not wrong:
        try:
            TraceVehicle.model_validate(vehicle)
        except ValidationError as error:
            wrong = InputError.of("", error).problems
    return vehicle, wrong


def _number(cell: str) -> float:
    """The number that every program reads in a cell; ValueError for what Python alone takes for one (1_000)."""
    if "_" in cell or not cell.isascii():
        raise ValueError(cell)
    return float(cell)


def _place(source: str, line: int, column: str = "") -> str:
    where = f"{source}:{line}" if source else f"line {line}"
    return f"{where}, {column}" if column else where


def _rows(text: str, source: str) -> Iterator[tuple[int, list[str]]]:
    """The rows of a CSV text, each with the line it begins on; InputError at the first that is none."""
    rows = csv.reader(text.removeprefix(_BYTE_ORDER_MARK).splitlines())
    line = 1
    try:
        for row in rows:
            yield line, row
            line = rows.line_num + 1
    except csv.Error as error:
        raise InputError(source or "trace", [(_place(source, rows.line_num), f"cannot be read: {error}")]) from None
