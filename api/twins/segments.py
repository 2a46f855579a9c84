"""Samples as they are stored: some hundred rows to a Parquet file, every figure bit for bit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from api.figures import table_of
from api.twins.feed import COLUMNS
from station.record import CODES, COUNTS

_TYPES = {name: np.uint8 if name in CODES else np.int32 if name in COUNTS else np.float64 for name in COLUMNS}


def columns_of(rows: Sequence[tuple[float, ...]], wanted: Sequence[str] = tuple(COLUMNS)) -> dict[str, np.ndarray]:
    """Rows as the wanted columns, of the types of a record."""
    figures = np.array(rows, np.float64).reshape(len(rows), len(COLUMNS)).T
    return {name: figures[place].astype(_TYPES[name]) for place, name in enumerate(COLUMNS) if name in wanted}


def encode(rows: Sequence[tuple[float, ...]]) -> bytes:
    """Rows as a Parquet file."""
    import pyarrow as pa  # slow to import
    from pyarrow import parquet

    stream = pa.BufferOutputStream()
    table = pa.table({name: pa.array(column) for name, column in columns_of(rows).items()})
    parquet.write_table(table, stream, compression="zstd", write_statistics=False)
    content: bytes = stream.getvalue().to_pybytes()
    return content


def stored_columns(content: bytes, wanted: Sequence[str]) -> dict[str, np.ndarray]:
    """The wanted columns of a Parquet file that `encode` wrote."""
    table = table_of(content, tuple(wanted))
    return {name: table[name] for name in wanted}


def decode(content: bytes) -> list[tuple[float, ...]]:
    """The rows that `encode` wrote."""
    table = table_of(content)
    return list(zip(*(table[name].tolist() for name in COLUMNS), strict=True))
