"""Bodies of measurements by their media type: JSON, NDJSON, CSV and Parquet, with the same four columns."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable, Sequence
from http import HTTPStatus
from typing import Any, TypeAlias

import orjson
import pyarrow as pa
from pyarrow import csv, parquet

from api.http.bodies import check_structure
from api.http.body_types import media_type
from api.http.problems import ProblemError, in_json, invalid
from api.http.timeseries import MEDIA, Format
from api.measurements.columns import Column, batch_of, check_count
from api.settings import Settings
from station.batches import Batch
from station.measurement import TagMap

FIELDS = ("tag", "time", "value", "quality")
"""Columns; the last may be left out, which says that all is good."""

NDJSON = "application/x-ndjson"

DECODED_MAX = 64_000_000
"""Most that the columns of a Parquet file may take uncompressed [bytes]."""


def read_measurements(body: bytes, media: str, tags: TagMap, settings: Settings) -> Batch:
    """The batch that a body holds, by its media type.

    Raises
    ------
    ProblemError
        413 `body-too-large`; 415 `media-type` where it is none of MEDIA_TYPES; 422 `invalid` where the body is not what
        it says, or naming row, field, limit and value given of the first 20 wrong cells.
    """
    if len(body) > settings.body_bytes_max:
        detail = f"measurements must not exceed {settings.body_bytes_max} bytes; given {len(body)}"
        raise ProblemError(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "body-too-large", "Body too large", detail)
    kind = media_type(media)
    read = MEDIA_TYPES.get(MEDIA[Format.JSON] if kind.endswith("+json") else kind)
    if read is None:
        detail = f"must be {', '.join(MEDIA_TYPES)}; given {kind!r:.100}"
        raise ProblemError(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "media-type", "Unsupported media type", detail)
    try:
        return batch_of(tags, *read(body, settings))
    except (pa.ArrowException, OSError, ValueError, OverflowError) as error:
        raise invalid([("", f"cannot be read as {kind}: {error!s:.200}")]) from None


Columns: TypeAlias = tuple[Column, Column, Column, Column | None]


def _json(body: bytes, settings: Settings) -> Columns:
    check_structure(body, settings)
    try:
        rows = orjson.loads(body)
    except orjson.JSONDecodeError as error:
        raise invalid([("", f"is not JSON: {error}")]) from None
    if isinstance(rows, dict) and set(rows) == {"samples"}:
        rows = rows["samples"]
    if not isinstance(rows, list):
        raise invalid([("", "must be a list of rows, or an object with the list `samples`")])
    return _of_rows(rows)


def _ndjson(body: bytes, settings: Settings) -> Columns:
    check_structure(body, settings)
    lines = [line for line in body.splitlines() if line.strip()]
    check_count(len(lines))
    rows = []
    for number, line in enumerate(lines):
        try:
            rows.append(orjson.loads(line))
        except orjson.JSONDecodeError as error:
            raise invalid([(str(number), f"is not JSON: {error}")]) from None
    return _of_rows(rows)


def _of_rows(rows: Sequence[Any]) -> Columns:
    check_count(len(rows))
    known = frozenset(FIELDS)
    for number, row in enumerate(rows):
        if not isinstance(row, dict):
            raise invalid([(str(number), f"must be an object with {', '.join(FIELDS)}; given {in_json(row):.100}")])
        if not row.keys() <= known:
            unknown = next(name for name in row if name not in known)
            raise invalid([(f"{number}.{unknown:.60}", f"is no field of a row; there are {', '.join(FIELDS)}")])
    tag, time, value = (_column([row.get(name) for row in rows]) for name in FIELDS[:3])
    rated = any("quality" in row for row in rows)
    return tag, time, value, _column([row.get("quality") for row in rows]) if rated else None


def _column(cells: list[Any]) -> Column:
    """Cells of JSON as a column; of different types as texts, as CSV has them."""
    kinds = set(map(type, cells))
    found = None
    if not {bool, float} <= kinds:  # Arrow takes truth among floating-point numbers for a number
        with contextlib.suppress(pa.ArrowException, ValueError, OverflowError):
            found = pa.array(cells)
    if found is None:
        found = pa.array([cell if cell is None or isinstance(cell, str) else in_json(cell) for cell in cells])
    return pa.chunked_array([found])


def _csv(body: bytes, _settings: Settings) -> Columns:
    table = csv.read_csv(
        pa.BufferReader(body),
        convert_options=csv.ConvertOptions(
            column_types=dict.fromkeys(FIELDS, pa.string()), strings_can_be_null=True, null_values=[""]
        ),
    )
    return _of_table(table)


def _parquet(body: bytes, _settings: Settings) -> Columns:
    file = parquet.ParquetFile(io.BytesIO(body))
    about = file.metadata
    check_count(about.num_rows)
    size = sum(about.row_group(group).total_byte_size for group in range(about.num_row_groups))
    if size > DECODED_MAX:
        raise invalid([("", f"must take at most {DECODED_MAX} bytes uncompressed; given {size}")])
    return _of_table(file.read())


def _of_table(table: pa.Table) -> Columns:
    names = table.column_names
    if wrong := [name for name in names if name not in FIELDS or names.count(name) > 1]:
        raise invalid([(f"{wrong[0]:.60}", f"must be one of the columns {', '.join(FIELDS)}, once")])
    if missing := [name for name in FIELDS[:3] if name not in names]:
        raise invalid([(name, "must be a column") for name in missing])
    return table["tag"], table["time"], table["value"], table["quality"] if "quality" in names else None


MEDIA_TYPES: dict[str, Callable[[bytes, Settings], Columns]] = {
    MEDIA[Format.JSON]: _json,
    NDJSON: _ndjson,
    "text/csv": _csv,
    MEDIA[Format.PARQUET]: _parquet,
}
"""Media types of measurements, and what reads them."""
