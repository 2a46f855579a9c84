"""Series as requests ask for them: some columns, a span of time, a step; as JSON, CSV or Parquet."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated, Any

import numpy as np
import orjson
from fastapi import Query
from starlette.responses import Response

from api.problems import invalid

TABLE_MAX = 20_000_000
"""Most figures in one answer: a day of seconds with every column is 1.6 million."""


class Format(StrEnum):
    """What a series comes as."""

    JSON = "json"
    CSV = "csv"
    PARQUET = "parquet"


MEDIA = {
    Format.JSON: "application/json",
    Format.CSV: "text/csv; charset=utf-8",
    Format.PARQUET: "application/vnd.apache.parquet",
}
"""Media type of each format."""


@dataclass(frozen=True)
class Selection:
    """Which part of a series; all of it unless something is said."""

    columns: tuple[str, ...] = ()  # empty for all
    start: float = 0.0  # [s]
    end: float = np.inf  # [s]
    step: float | None = None  # [s]

    def of(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
        """Rows to take and, with a step, the times they stand for.

        A row holds until the next, so at a time between two rows the earlier one is taken.
        """
        if self.step is None:
            return np.flatnonzero((time >= self.start) & (time <= self.end)), None
        if len(time) == 0:
            return np.zeros(0, np.int64), np.zeros(0)
        first, last = max(self.start, float(time[0])), min(self.end, float(time[-1]))
        if first > last:
            return np.zeros(0, np.int64), np.zeros(0)
        if (last - first) / self.step > TABLE_MAX:
            raise invalid([("step_s", f"must give at most {TABLE_MAX} rows; given {self.step:g}")])
        times = first + self.step * np.arange(int((last - first) / self.step + 1e-9) + 1)
        return np.searchsorted(time, times, side="right") - 1, times


async def asked(
    columns: Annotated[
        str | None,
        Query(description="Names of columns, separated by commas; all if left out", examples=["pressure_high"]),
    ] = None,
    from_s: Annotated[
        float, Query(ge=0, description="First time", json_schema_extra={"unit": "s"}, examples=[0])
    ] = 0.0,
    to_s: Annotated[
        float | None,
        Query(ge=0, description="Last time; the end if left out", json_schema_extra={"unit": "s"}, examples=[600]),
    ] = None,
    step_s: Annotated[
        float | None,
        Query(gt=0, description="One row a step instead of every row", json_schema_extra={"unit": "s"}, examples=[10]),
    ] = None,
) -> Selection:
    """The selection of a request's query; async, so that no thread is taken for it."""
    names = tuple(name.strip() for name in columns.split(",")) if columns else ()
    end = np.inf if to_s is None else to_s
    if end < from_s:
        raise invalid([("to_s", f"must not lie before from_s = {from_s:g} s; given {end:g}")])
    return Selection(names, from_s, end, step_s)


def selected(columns: dict[str, np.ndarray], chosen: Selection) -> dict[str, np.ndarray]:
    """The part of a table that was chosen; `time` always comes first."""
    unknown = [name for name in chosen.columns if name not in columns]
    if unknown:
        raise invalid([("columns", f"no column is called {unknown[0]!r:.60}; there are {', '.join(columns)}")])
    rows, times = chosen.of(columns["time"])
    names = ["time", *(name for name in (chosen.columns or columns) if name != "time")]
    table = {name: columns[name][rows] for name in names}
    if times is not None:
        table["time"] = times
    return table


def response(table: dict[str, np.ndarray], units: dict[str, str], form: Format, **about: Any) -> Response:
    """A table as the answer to a request; NaN is null in JSON and empty in CSV."""
    if form is Format.JSON:
        content = orjson.dumps(
            {**about, "units": {name: units[name] for name in table}, "columns": table},
            option=orjson.OPT_SERIALIZE_NUMPY,
        )
        return Response(content, media_type=MEDIA[form])
    return Response(_arrow(table, units, form), media_type=MEDIA[form])


def _arrow(table: dict[str, np.ndarray], units: dict[str, str], form: Format) -> bytes:
    import pyarrow as pa  # slow to import
    from pyarrow import csv, parquet

    fields = [
        pa.field(name, pa.from_numpy_dtype(values.dtype), metadata={"unit": units[name]})
        for name, values in table.items()
    ]
    empty = form is Format.CSV
    arrays = [pa.array(values, from_pandas=empty) for values in table.values()]
    stream = pa.BufferOutputStream()
    rows = pa.table(arrays, schema=pa.schema(fields))
    if form is Format.CSV:
        csv.write_csv(rows, stream)
    else:
        parquet.write_table(rows, stream, compression="zstd")
    content: bytes = stream.getvalue().to_pybytes()
    return content


def table_of(content: bytes, wanted: tuple[str, ...] = ()) -> dict[str, np.ndarray]:
    """Columns of a stored Parquet file; only the wanted ones are read, and `time`."""
    import pyarrow as pa
    from pyarrow import parquet

    reader = parquet.ParquetFile(pa.BufferReader(content))
    names = reader.schema_arrow.names
    asked = (
        None if not wanted or not set(wanted) <= set(names) else ["time", *(name for name in wanted if name != "time")]
    )
    read = reader.read(columns=asked)
    return {name: read[name].to_numpy() for name in read.column_names}
