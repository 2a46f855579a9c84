"""Time series as answers to requests: some columns, a span of time, a step; as JSON, CSV or Parquet."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Annotated, Any

import numpy as np
from fastapi import Depends, Query
from pydantic import BaseModel, Field
from starlette.responses import Response

from api.http import pieces
from api.http.problems import invalid

TABLE_MAX = 20_000_000
"""Most figures in one answer: a day of seconds with every column is 1.6 million."""


class Format(StrEnum):
    """The format of a series."""

    JSON = "json"
    CSV = "csv"
    PARQUET = "parquet"


MEDIA = {
    Format.JSON: "application/json",
    Format.CSV: "text/csv; charset=utf-8",
    Format.PARQUET: "application/vnd.apache.parquet",
}
"""Media type of each format."""


class Fold(StrEnum):
    """The downsampling of a series: the rows that stand for a step."""

    HOLD = "hold"  # the row that holds where the step begins
    MIN_MAX = "extremes"  # the least and the greatest of each column within the step, as two rows


@dataclass(frozen=True)
class Selection:
    """Which part of a series; all of it unless something is said."""

    columns: tuple[str, ...] = ()  # empty for all
    start: float = 0.0  # [s]
    end: float = np.inf  # [s]
    step: float | None = None  # [s]
    fold: Fold = Fold.HOLD

    def newest(self, seconds: int, rows: int) -> Selection:
        """The same of the newest seconds of a series that has so many rows, one a second; a problem beside a span."""
        if self.start > 0.0 or self.end < np.inf:
            raise invalid([("last_s", "must not be given with from_s or to_s")])
        return replace(self, start=float(max(0, rows - seconds)))

    def of(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
        """Rows to take and, with a step, the times they stand for.

        A row holds until the next, so at a time between two rows the earlier one is taken.
        """
        if self.step is None:
            return np.flatnonzero((time >= self.start) & (time <= self.end)), None
        if len(time) == 0:
            return np.zeros(0, np.int64), np.zeros(0)
        times = self._times(time, self.step)
        return np.searchsorted(time, times, side="right") - 1, times

    def _times(self, time: np.ndarray, step: float) -> np.ndarray:
        """Where the steps of a series that is not empty begin."""
        first, last = max(self.start, float(time[0])), min(self.end, float(time[-1]))
        if first > last:
            return np.zeros(0)
        if (last - first) / step > TABLE_MAX:
            raise invalid([("step_s", f"must give at most {TABLE_MAX} rows; given {step:g}")])
        return first + step * np.arange(int((last - first) / step + 1e-9) + 1)

    def min_max(self, table: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Two rows a step that holds rows: the least and the greatest of each column, in the order in which it moves.

        They stand at the step's begin and middle. NaN counts only where a step has nothing else.
        """
        if self.step is None:
            raise invalid([("step_s", "must be given with fold = extremes")])
        time = table["time"]
        steps = self._times(time, self.step) if len(time) else np.zeros(0)
        begins = np.searchsorted(time, steps, side="left")
        ends = np.append(begins[1:], np.searchsorted(time, self.end, side="right")) if len(steps) else begins
        full = ends > begins
        steps, begins, end = steps[full], begins[full], int(ends[-1]) if len(ends) else 0
        found = {"time": np.column_stack((steps, steps + self.step / 2)).ravel()}
        for name, column in table.items():
            if name != "time":
                found[name] = _min_max(column[:end], begins)
        return found


def _min_max(column: np.ndarray, begins: np.ndarray) -> np.ndarray:
    """The least and the greatest entry from each place to the next, the least first where the part rises."""
    if len(begins) == 0:
        return column[:0]
    low, high = np.fmin.reduceat(column, begins), np.fmax.reduceat(column, begins)
    last = column[np.append(begins[1:], len(column)) - 1]
    falls = last < column[begins]
    return np.column_stack((np.where(falls, high, low), np.where(falls, low, high))).ravel()


def _seconds(description: str, example: float, *, ge: float | None = None, gt: float | None = None) -> Any:
    """A time in a request's query."""
    unit = {"unit": "s"}
    return Query(
        ge=ge, gt=gt, allow_inf_nan=False, description=description, json_schema_extra=unit, examples=[example]
    )  # fmt: skip


async def timeseries_query(
    columns: Annotated[
        str | None,
        Query(description="Names of columns, separated by commas; all if left out", examples=["pressure_high"]),
    ] = None,
    from_s: Annotated[float, _seconds("First time", 0, ge=0)] = 0.0,
    to_s: Annotated[float | None, _seconds("Last time; the end if left out", 600, ge=0)] = None,
    step_s: Annotated[float | None, _seconds("One row a step instead of every row", 10, gt=0)] = None,
    fold: Annotated[
        Fold,
        Query(
            description="What stands for a step: the row that holds where it begins, or the least and the greatest of "
            "each column within it, as two rows",
            examples=["hold"],
        ),
    ] = Fold.HOLD,
) -> Selection:
    """The selection of a request's query; async, so that no thread is taken for it."""
    names = tuple(name.strip() for name in columns.split(",")) if columns else ()
    end = np.inf if to_s is None else to_s
    if end < from_s:
        raise invalid([("to_s", f"must not lie before from_s = {from_s:g} s; given {end:g}")])
    return Selection(names, from_s, end, step_s, fold)


def selected(columns: dict[str, np.ndarray], chosen: Selection) -> dict[str, np.ndarray]:
    """The part of a table that was chosen; `time` always comes first."""
    unknown = [name for name in chosen.columns if name not in columns]
    if unknown:
        raise invalid([("columns", f"no column is called {unknown[0]!r:.60}; there are {', '.join(columns)}")])
    names = ["time", *(name for name in (chosen.columns or columns) if name != "time")]
    if chosen.fold is Fold.MIN_MAX:
        return chosen.min_max({name: columns[name] for name in names})
    rows, times = chosen.of(columns["time"])
    table = {name: columns[name][rows] for name in names}
    if times is not None:
        table["time"] = times
    return table


def response(table: dict[str, np.ndarray], units: dict[str, str], form: Format, **about: Any) -> Response:
    """A table as the answer to a request; NaN is null in JSON and empty in CSV."""
    if form is Format.JSON:
        about["units"] = {name: units[name] for name in table}
        return pieces.answer(pieces.columns(about, table), MEDIA[form])
    return pieces.answer(pieces.slices(memoryview(_arrow(table, units, form))), MEDIA[form])


def encoded(table: dict[str, np.ndarray], units: Mapping[str, str], form: Format) -> bytes:
    """A table as CSV or Parquet; NaN is an empty cell in CSV."""
    content: bytes = _arrow(table, units, form).to_pybytes()
    return content


def _arrow(table: dict[str, np.ndarray], units: Mapping[str, str], form: Format) -> Any:
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
    return stream.getvalue()


class SeriesTable(BaseModel):
    """Series, column by column."""

    units: Annotated[
        dict[str, str], Field(description="Unit of each column", examples=[{"time": "s", "pressure_high": "bar"}])
    ]
    columns: Annotated[
        dict[str, list[float | None]],
        Field(
            description="Figures, one a row; null where there is none (no vehicle connected)",
            examples=[{"time": [0, 1], "pressure_high": [886.77, 884.68]}],
        ),
    ]


SelectionDep = Annotated[Selection, Depends(timeseries_query)]
FormatParameter = Annotated[Format, Query(alias="format", description="What to answer", examples=["csv"])]

SERIES_RESPONSES: dict[int | str, dict[str, Any]] = {
    200: {
        "model": SeriesTable,
        "description": "The series in the format asked for",
        "content": {
            "text/csv": {"schema": {"type": "string"}},
            MEDIA[Format.PARQUET]: {"schema": {"type": "string", "format": "binary"}},
        },
    }
}  # fmt: skip
