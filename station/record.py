"""The record of a run: columns with units, one row a sample, and a table of vehicles."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from station.columns import CODES, COUNTS, VALUES, VEHICLE_COLUMNS
from station.metrics import Metrics, metrics
from station.plants.interface import plant_named
from station.scenario import Scenario


def value_columns(plant: str) -> dict[str, str]:
    """Floating-point columns of a record of a plant, with their units."""
    return {**VALUES, **plant_named(plant).columns}


def vehicle_columns(plant: str) -> dict[str, str]:
    """Columns of the table of vehicles of a plant, with their units."""
    return {**VEHICLE_COLUMNS, **plant_named(plant).figures}


@dataclass(frozen=True)
class Timing:
    """How long a run took; not part of what is compared."""

    total: float  # wall clock [s]
    decisions: NDArray[np.float64] | None = None  # one a row, where the controller is called from Python [s]


@dataclass(frozen=True)
class Record:
    """One run: who ran what, its columns, its vehicles."""

    scenario: Scenario
    controller: str
    replication: int
    seed: int
    values: NDArray[np.float64]  # (len(value_columns), rows)
    codes: NDArray[np.uint8]  # (len(CODES), rows)
    counts: NDArray[np.int32]  # (len(COUNTS), rows)
    vehicles: dict[str, NDArray[np.float64]]  # vehicle_columns, each (vehicles,)
    timing: Timing = field(compare=False)

    @property
    def columns(self) -> dict[str, str]:
        """Name and unit of every column."""
        return {**self._value_columns, **CODES, **COUNTS}

    @property
    def _value_columns(self) -> dict[str, str]:
        return value_columns(self.scenario.station.plant)

    def __len__(self) -> int:
        return self.values.shape[1]

    def __getitem__(self, column: str) -> NDArray[Any]:
        """The column of that name, one entry a row."""
        for names, block in ((self._value_columns, self.values), (CODES, self.codes), (COUNTS, self.counts)):
            if column in names:
                return block[list(names).index(column)]
        raise KeyError(f"no column {column!r}; there are {', '.join(self.columns)}")

    def to_bytes(self) -> bytes:
        """Every figure of the run in one string of bytes: equal runs give equal bytes."""
        vehicles = (self.vehicles[name] for name in vehicle_columns(self.scenario.station.plant))
        return b"".join(np.ascontiguousarray(a).tobytes() for a in (self.values, self.codes, self.counts, *vehicles))

    def metrics(self) -> Metrics:
        """The figures of merit, computed from this record alone."""
        return metrics(self)

    def parquet(self) -> bytes:
        """A Parquet file: the columns, with units as field metadata, and scenario and vehicles as file metadata."""
        import pyarrow as pa  # slow to import, needed here only
        import pyarrow.parquet as pq

        fields = [
            pa.field(name, pa.from_numpy_dtype(self[name].dtype), metadata={"unit": unit})
            for name, unit in self.columns.items()
        ]
        about = {
            "controller": self.controller,
            "replication": str(self.replication),
            "seed": str(self.seed),
            "scenario": self.scenario.model_dump_json(),
            "vehicles": json.dumps({name: column.tolist() for name, column in self.vehicles.items()}),
        }
        table = pa.table([pa.array(self[name]) for name in self.columns], schema=pa.schema(fields, metadata=about))
        stream = pa.BufferOutputStream()
        pq.write_table(table, stream, compression="zstd")
        content: bytes = stream.getvalue().to_pybytes()
        return content

    def to_parquet(self, path: str | Path) -> None:
        """Write `parquet()` to a file.

        Raises
        ------
        OSError
            if the file cannot be written; nothing half-written remains.
        """
        target = Path(path)
        partial = target.with_name(target.name + ".partial")
        try:
            partial.write_bytes(self.parquet())
            partial.replace(target)
        finally:
            partial.unlink(missing_ok=True)

    @classmethod
    def from_parquet(cls, source: str | Path | bytes) -> Record:
        """The record that `to_parquet` wrote to a file, or that `parquet` made."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        with pq.ParquetFile(pa.BufferReader(source) if isinstance(source, bytes) else source) as file:
            table = file.read(use_threads=False)  # threads of Arrow's may abort a process that ends
        about = {key.decode(): value.decode() for key, value in table.schema.metadata.items()}

        def block(names: dict[str, str], dtype: Any) -> Any:
            return np.array([table[name].to_numpy() for name in names], dtype=dtype)

        vehicles = {name: np.array(column, dtype=float) for name, column in json.loads(about["vehicles"]).items()}
        scenario = Scenario.model_validate_json(about["scenario"])
        return cls(
            scenario,
            about["controller"],
            int(about["replication"]),
            int(about["seed"]),
            block(value_columns(scenario.station.plant), np.float64),
            block(CODES, np.uint8),
            block(COUNTS, np.int32),
            vehicles,
            Timing(float("nan")),
        )
