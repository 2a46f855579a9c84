"""A comparison's runs as files: one row a run, every figure of merit with its unit."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from typing import Any

from station.metrics import units_of

ABOUT = ("scenario", "controller", "replication", "seed")
"""The columns before the figures in a row."""


def csv_of(rows: Sequence[dict[str, Any]]) -> str:
    """The rows as CSV with a line of names; a figure that a row lacks or that is not finite is an empty cell."""
    text = io.StringIO()
    writer = csv.DictWriter(text, [*ABOUT, *units_of(rows)], lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def parquet_of(rows: Sequence[dict[str, Any]]) -> bytes:
    """The rows as a Parquet file with units as field metadata; a figure a row lacks or that is not finite is null."""
    import pyarrow as pa  # slow to import
    from pyarrow import parquet

    names = [pa.field(name, pa.string() if name in ABOUT[:2] else pa.int64()) for name in ABOUT]
    figures = [pa.field(name, pa.float64(), metadata={"unit": unit}) for name, unit in units_of(rows).items()]
    stream = pa.BufferOutputStream()
    parquet.write_table(pa.Table.from_pylist(list(rows), pa.schema([*names, *figures])), stream, compression="zstd")
    content: bytes = stream.getvalue().to_pybytes()
    return content


ENDINGS = (".csv", ".parquet", ".json")
"""Of the files that `file_of` makes."""


def file_of(document: dict[str, Any], ending: str) -> str | bytes:
    """A document of `api.comparisons.service.as_document` as a file of one of ENDINGS; JSON holds all of it."""
    if ending == ".csv":
        return csv_of(document["results"])
    if ending == ".parquet":
        return parquet_of(document["results"])
    return json.dumps(document, indent=1, allow_nan=False) + "\n"
