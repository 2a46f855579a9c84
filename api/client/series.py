"""Tables that a service answers, with their units, as NumPy, pandas or Polars have them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from station import StationError

if TYPE_CHECKING:
    import pandas as pd
    import polars as pl
    from numpy.typing import NDArray


class MissingLibraryError(StationError):
    """A library that is not installed is needed for this."""


class Series:
    """Columns of one length with their units, every float with all its digits.

    Parameters
    ----------
    content
        A Parquet file with units as field metadata.
    """

    def __init__(self, content: bytes) -> None:
        import pyarrow as pa  # slow to import
        from pyarrow import parquet

        # Without threads: those of a reader may still be ending when the process does, which is then aborted.
        self._table: Any = parquet.ParquetFile(pa.BufferReader(content)).read(use_threads=False)

    @property
    def units(self) -> dict[str, str]:
        """Unit of each column, by name; empty where it has none."""
        return {field.name: ((field.metadata or {}).get(b"unit") or b"").decode() for field in self._table.schema}

    def __len__(self) -> int:
        return int(self._table.num_rows)

    def __contains__(self, name: object) -> bool:
        return name in self._table.column_names

    def __getitem__(self, name: str) -> NDArray[Any]:
        """The column of that name, (rows,).

        Raises
        ------
        KeyError
            naming the columns there are.
        """
        if name not in self:
            raise KeyError(f"no column {name!r}; there are {', '.join(self._table.column_names)}")
        found: NDArray[Any] = self._table.column(name).to_numpy()
        return found

    def numpy(self) -> dict[str, NDArray[Any]]:
        """Every column as an array, by name."""
        return {name: self[name] for name in self._table.column_names}

    def pandas(self) -> pd.DataFrame:
        """A DataFrame whose `attrs["units"]` has the units.

        Raises
        ------
        MissingLibraryError
            if pandas is not installed.
        """
        try:
            import pandas as pd
        except ImportError:
            raise MissingLibraryError("pandas is not installed: pip install hrs-twin[notebook]") from None
        frame = pd.DataFrame(self.numpy())
        frame.attrs["units"] = self.units
        return frame

    def polars(self) -> pl.DataFrame:
        """A Polars DataFrame; Polars keeps no units.

        Raises
        ------
        MissingLibraryError
            if Polars is not installed.
        """
        try:
            import polars as pl
        except ImportError:
            raise MissingLibraryError("Polars is not installed: pip install hrs-twin[notebook]") from None
        return pl.DataFrame(self.numpy())


def selection(
    columns: list[str] | tuple[str, ...], from_s: float | None, to_s: float | None, step_s: float | None,
    *, extremes: bool,
) -> dict[str, Any]:  # fmt: skip
    """The query of a series as `/series` and `/history` take it; None says nothing."""
    return {
        "columns": ",".join(columns) or None, "from_s": from_s, "to_s": to_s, "step_s": step_s,
        "fold": "extremes" if extremes else None, "format": "parquet",
    }  # fmt: skip
