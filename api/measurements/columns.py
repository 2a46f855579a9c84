"""The columns of measurements, as a sender wrote them, made into a batch; what is wrong is told row by row."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime
from typing import Any, TypeAlias

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from api.http.problems import ERRORS_LISTED, in_json, invalid
from station.batches import BATCH_MAX, TIME_MAX, Batch, Quality, tag_places
from station.measurement import TagMap

Column: TypeAlias = pa.ChunkedArray
"""Cells of a column."""


_STAMP = pa.timestamp("ns", tz="UTC")
_NUMBER = r"^[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?$"

WORDS = {"good": Quality.GOOD, "uncertain": Quality.UNCERTAIN, "bad": Quality.BAD}
"""Qualities by their words."""

_STATUS = 1 << 30
"""From here on a code is a status code of OPC UA (Part 4), whose two highest bits are the severity."""

_TIME = "must be seconds or an ISO 8601 time with its zone"
_VALUE = "must be a number, true, false or empty"
_QUALITY = "must be good, uncertain, bad, 0 to 63, 64 to 127, 192 to 255 or an OPC UA status code"


class _Faults:
    """What is wrong, the first of it row by row."""

    def __init__(self) -> None:
        self.listed: list[tuple[str, str]] = []
        self.count = 0

    def add(self, row: int, column: str, message: str) -> None:
        """A cell is wrong."""
        self.count += 1
        if len(self.listed) < ERRORS_LISTED:
            self.listed.append((f"{row}.{column}", message))


def check_count(rows: int) -> None:
    """Refuse more rows than a batch may hold, or none.

    Raises
    ------
    ProblemError
        422 `invalid`.
    """
    if not 1 <= rows <= BATCH_MAX:
        raise invalid([("", f"must hold 1 to {BATCH_MAX} rows; given {rows}")])


def batch_of(tags: TagMap, tag: Column, time: Column, value: Column, quality: Column | None) -> Batch:
    """The batch of columns of equal length.

    Raises
    ------
    ProblemError
        422 `invalid`, which names row, field, limit and value given of the first 20 wrong cells.
    """
    check_count(len(tag))
    faults = _Faults()
    places = _places(tags, tag, faults)
    times = _times(time, faults)
    values = _values(value, faults)
    rated = np.full(len(tag), Quality.GOOD, np.uint8) if quality is None else _qualities(quality, faults)
    if faults.count:
        raise invalid(sorted(faults.listed, key=_row), faults.count)
    return Batch(places, times, values, rated)


def _row(listed: tuple[str, str]) -> int:
    return int(listed[0].partition(".")[0])


def _by_cell(
    column: Column, name: str, read: Callable[[Any], float | None], wanted: str, faults: _Faults
) -> np.ndarray:  # fmt: skip
    """Cell by cell, where the column's function found something wrong; `read` gives None for what is."""
    found = np.zeros(len(column))
    for row, cell in enumerate(column.to_pylist()):
        number = read(cell)
        if number is None:
            faults.add(row, name, f"{wanted}; given {in_json(cell):.100}")
        else:
            found[row] = number
    return found


def _encoded(column: Column) -> tuple[list[Any], np.ndarray]:
    """The different cells of a column, and for each row its place among them; -1 where it is empty."""
    whole = column.combine_chunks()
    whole = whole.chunk(0) if isinstance(whole, pa.ChunkedArray) else whole
    if not pa.types.is_dictionary(whole.type):
        whole = whole.dictionary_encode()
    return whole.dictionary.to_pylist(), np.asarray(pc.fill_null(whole.indices.cast(pa.int64()), -1), np.int64)


def _places(tags: TagMap, column: Column, faults: _Faults) -> np.ndarray:
    places = tag_places(tags)
    names, rows = _encoded(column)
    known = [places.get(name, -1) if isinstance(name, str) else -1 for name in names]
    found = np.array([*known, -1], np.int64)[rows]  # an empty cell's place, -1, is that behind the last
    for row in np.flatnonzero(found < 0):
        given = None if rows[row] < 0 else names[rows[row]]
        faults.add(int(row), "tag", f"must be a tag of the twin's map; given {in_json(given):.100}")
    return found


def _times(column: Column, faults: _Faults) -> np.ndarray:
    kind = column.type
    if column.null_count:
        seconds = _by_cell(column, "time", _read_time, _TIME, faults)
    elif pa.types.is_timestamp(kind) and kind.tz is not None:
        seconds = _seconds(column)
    elif pa.types.is_integer(kind) or pa.types.is_floating(kind):
        seconds = _floats(column)
    elif _is_text(kind):
        seconds = _written_times(column, faults)
    else:
        seconds = _by_cell(column, "time", _read_time, _TIME, faults)
    for row in np.flatnonzero(~(np.abs(seconds) <= TIME_MAX)):
        faults.add(int(row), "time", f"must lie within {TIME_MAX:.0f} s of 1970; given {seconds[row]:g}")
    return seconds


def _seconds(stamps: Column) -> np.ndarray:
    """Unix times; whole seconds apart from their parts, so that none is rounded twice."""
    per = {"s": 1, "ms": 1_000, "us": 1_000_000, "ns": 1_000_000_000}[stamps.type.unit]
    ticks = np.asarray(stamps.cast(pa.int64()).to_numpy(), np.int64)
    return ticks // per + (ticks % per) / per


def _written_times(column: Column, faults: _Faults) -> np.ndarray:
    try:
        if pc.all(pc.match_substring_regex(column, _NUMBER)).as_py():
            return _floats(column)
        return _seconds(column.cast(_STAMP))
    except (pa.ArrowException, ValueError):
        return _by_cell(column, "time", _read_time, _TIME, faults)


def _read_time(cell: Any) -> float | None:
    """Unix time of a cell [s]; None where it is none."""
    if isinstance(cell, str):
        try:
            return float(cell)
        except ValueError:
            return _of_iso(cell)
    if isinstance(cell, bool) or not isinstance(cell, int | float):
        return cell.timestamp() if isinstance(cell, datetime) and cell.tzinfo is not None else None
    return _float(cell)


def _of_iso(text: str) -> float | None:
    try:
        moment = datetime.fromisoformat(text.strip())
        return None if moment.tzinfo is None else moment.timestamp()
    except (ValueError, OverflowError):
        return None


def _float(number: int | float) -> float:
    try:
        return float(number)
    except OverflowError:
        return float("inf")


def _values(column: Column, faults: _Faults) -> np.ndarray:
    kind = column.type
    if pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_boolean(kind) or pa.types.is_null(kind):
        return _floats(column)
    if _is_text(kind):
        try:
            empty = pc.equal(pc.utf8_trim_whitespace(column), "")
            return _floats(pc.if_else(empty, None, column))
        except (pa.ArrowException, ValueError):
            pass
    return _by_cell(column, "value", _read_value, _VALUE, faults)


def _read_value(cell: Any) -> float | None:
    if cell is None:
        return float("nan")
    if isinstance(cell, str):
        word = cell.strip().lower()
        if word in ("", "true", "false"):
            return {"": float("nan"), "true": 1.0, "false": 0.0}[word]
        try:
            return float(word)
        except ValueError:
            return None
    return _float(cell) if isinstance(cell, int | float) else None


def _floats(column: Column) -> np.ndarray:
    """Numbers as they are, NaN where a cell is empty."""
    if pa.types.is_boolean(column.type):
        column = column.cast(pa.uint8())
    whole = pa.types.is_integer(column.type)  # beyond 2**53 rounded, not refused
    return np.array(column.cast(pa.float64(), safe=not whole).to_numpy(), np.float64)


def _qualities(column: Column, faults: _Faults) -> np.ndarray:
    cells, rows = _encoded(column)
    rated = [_read_quality(cell) for cell in cells]
    for row in np.flatnonzero(np.array([*(each is None for each in rated), False])[rows]):
        faults.add(int(row), "quality", f"{_QUALITY}; given {in_json(cells[rows[row]]):.100}")
    return np.array([*(each or Quality.BAD for each in rated), Quality.GOOD], np.uint8)[rows]


def _read_quality(cell: Any) -> Quality | None:
    """The quality that a cell means, good where it is empty; None where it means none."""
    if isinstance(cell, str):
        word = cell.strip().lower()
        if word.isascii() and word.isdigit() and len(word) <= 10:  # a status code has 10 digits
            return _of_code(int(word))
        return WORDS.get(word) if word else Quality.GOOD
    if isinstance(cell, float) and cell.is_integer():
        cell = int(cell)
    return _of_code(cell) if isinstance(cell, int) and not isinstance(cell, bool) else None


def _of_code(code: int) -> Quality | None:
    """Of the classic scale, whose bits 6 and 7 are 00, 01 and 11, or of a status code's, 01 and 1x."""
    if _STATUS <= code < 4 * _STATUS:
        return Quality.UNCERTAIN if code < 2 * _STATUS else Quality.BAD
    if not 0 <= code <= 255:  # a byte
        return None
    return {0: Quality.BAD, 1: Quality.UNCERTAIN, 3: Quality.GOOD}.get(code >> 6)


def _is_text(kind: pa.DataType) -> bool:
    return pa.types.is_string(kind) or pa.types.is_large_string(kind)
