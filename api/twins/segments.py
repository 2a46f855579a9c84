"""Samples as they are stored: some hundred rows to a Parquet file, every figure bit for bit."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np

from api.packing import Basis, packed, plain, unpacked
from api.twins.messages import is_measured, sample_columns
from station.columns import CODES, COUNTS

SENT = "sent"
"""Column of the Unix times at which samples were told; files of older versions have none."""


@cache
def history_columns(layout: str) -> dict[str, str]:
    """Name and unit of every column of a history: a sample's, and when it was told."""
    return {**sample_columns(layout), SENT: "s"}


def _type_of(name: str) -> type[np.generic]:
    return np.uint8 if name in CODES else np.int32 if name in COUNTS else np.float64


_MILLISECONDS = np.dtype("datetime64[ms]")


def columns_of(
    rows: Sequence[tuple[float, ...]], layout: str, wanted: Sequence[str] | None = None
) -> dict[str, np.ndarray]:  # fmt: skip
    """Rows of `history_columns` as the wanted ones, of the types of a record."""
    names = history_columns(layout)
    figures = np.array(rows, np.float64).reshape(len(rows), len(names)).T
    chosen = names if wanted is None else wanted
    return {name: figures[place].astype(_type_of(name)) for place, name in enumerate(names) if name in chosen}


def encode(rows: Sequence[tuple[float, ...]], basis: Basis, layout: str) -> bytes:
    """Rows of `history_columns` as a Parquet file; times at which they were told are whole milliseconds."""
    columns = columns_of(rows, layout)
    columns[SENT] = np.round(1000 * columns[SENT]).astype(np.int64).view(_MILLISECONDS)
    return plain(columns) if is_measured(layout) else packed(columns, basis, {})


def stored_columns(content: bytes, wanted: Sequence[str]) -> dict[str, np.ndarray]:
    """The wanted columns of a Parquet file that `encode` wrote; NaN where an older version did not keep one."""
    table = unpacked(content, tuple(dict.fromkeys(("time", *wanted))))
    told = table.get(SENT)
    none = np.full(len(table["time"]), np.nan)
    table[SENT] = none if told is None else told.astype(np.int64) / 1000
    return {name: table.get(name, none) for name in wanted}


def decode(content: bytes, layout: str) -> list[tuple[float, ...]]:
    """The rows that `encode` wrote."""
    names = tuple(history_columns(layout))
    table = stored_columns(content, names)
    return list(zip(*(table[name].tolist() for name in names), strict=True))
