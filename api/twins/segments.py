"""Samples as they are stored: some hundred rows to a Parquet file, every figure bit for bit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from api.packing import Basis, packed, unpacked
from api.twins.messages import COLUMNS
from station.columns import CODES, COUNTS

SENT = "sent"
"""Column of the Unix times at which samples were told; files of older versions have none."""

HISTORY = {**COLUMNS, SENT: "s"}
"""Name and unit of every column of a history: a sample's, and when it was told."""

_TYPES = {
    **{name: np.uint8 if name in CODES else np.int32 if name in COUNTS else np.float64 for name in COLUMNS},
    SENT: np.float64,
}

_MILLISECONDS = np.dtype("datetime64[ms]")


def columns_of(rows: Sequence[tuple[float, ...]], wanted: Sequence[str] = tuple(HISTORY)) -> dict[str, np.ndarray]:
    """Rows of HISTORY as the wanted columns, of the types of a record."""
    figures = np.array(rows, np.float64).reshape(len(rows), len(HISTORY)).T
    return {name: figures[place].astype(_TYPES[name]) for place, name in enumerate(HISTORY) if name in wanted}


def encode(rows: Sequence[tuple[float, ...]], basis: Basis) -> bytes:
    """Rows of HISTORY as a Parquet file; times at which they were told are whole milliseconds."""
    columns = columns_of(rows)
    columns[SENT] = np.round(1000 * columns[SENT]).astype(np.int64).view(_MILLISECONDS)
    return packed(columns, basis, {})


def stored_columns(content: bytes, wanted: Sequence[str]) -> dict[str, np.ndarray]:
    """The wanted columns of a Parquet file that `encode` wrote."""
    table = unpacked(content, tuple(dict.fromkeys(("time", *wanted))))
    told = table.get(SENT)
    table[SENT] = np.full(len(table["time"]), np.nan) if told is None else told.astype(np.int64) / 1000
    return {name: table[name] for name in wanted}


def decode(content: bytes) -> list[tuple[float, ...]]:
    """The rows that `encode` wrote."""
    table = stored_columns(content, tuple(HISTORY))
    return list(zip(*(table[name].tolist() for name in HISTORY), strict=True))
