"""Columns of a record as they are stored: each by the codec of Parquet that fits it, and only what does not follow.

Pressures follow from mass and temperature, flows from pressures and valves, by the formulas of
`station.plants.thesis` and bit for bit. Of a column that follows, a row is null where the formula gives its very bits,
and has its figure elsewhere (a tank's first second is given, not computed). A checksum of each such column is stored
with it, so that a formula that changes one day cannot change what was recorded. Files without these marks are read as
they are.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Callable, Mapping, Sequence
from enum import StrEnum
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from station import Record, Station, StationError
from station.columns import CODES, COUNTS, VALUES
from station.geometry import BUFFERS, VALVES
from station.plants.interface import plant_named
from station.plants.thesis import SAMPLE_CONSTANTS, THESIS, PlantConstants, gas_pressure, inlet_flow, outlet_flow

if TYPE_CHECKING:
    import pyarrow as pa
    from pyarrow import parquet

Columns = Mapping[str, np.ndarray]

_MARK = b"hrs_packed"
"""Key of the file's metadata that says what follows from what."""

_FEW = ("temperature_vehicle", *CODES, *COUNTS)
"""Columns of few different figures, for which a dictionary is smallest."""

_PLAIN = ("decision_cost", "decision_bound")
"""Columns that are mostly NaN or the same for long, which the compressor alone packs best."""

_CODECS = {
    **{name: "BYTE_STREAM_SPLIT" for name in VALUES if name not in (*_FEW, *_PLAIN)},
    "sent": "DELTA_BINARY_PACKED",
}
"""Codecs of the columns of many figures; the least bytes of all that Parquet has were measured for each."""

_INLETS, _OUTLETS = VALVES[:3], VALVES[3:]

_CONSTANTS = ("buffer_volume", "compressor_pressure", "inlet_coefficient", "outlet_coefficient")
"""Of a station, what the formulas below use."""

_ABOUT = ("controller", "replication", "seed", "scenario", "vehicles")
"""Keys of a record's metadata, in the order of `Record.parquet`."""

_LEVEL = 3
"""Of zstd: 9 takes twice the time for 1 % of the bytes."""


class DamagedError(StationError):
    """The stored file does not give the figures that were recorded."""


class Basis(NamedTuple):
    """The arguments of formulas besides columns."""

    plant: PlantConstants
    volume: Sequence[float]  # of the tank of each vehicle [m3]; the last stands for all behind it

    @classmethod
    def of(cls, station: Station, volume: Sequence[float] = ()) -> Basis:
        """Of a station; without volumes its usual vehicle's stands for all."""
        return cls(station.constants(), volume or (station.vehicle.volume_m3,))

    @classmethod
    def parse(cls, document: Mapping[str, Any]) -> Basis:
        """The basis that `document` wrote."""
        constants: dict[str, Any] = {name: document[name] for name in _CONSTANTS}
        return cls(SAMPLE_CONSTANTS._replace(**constants), document["volume"])  # the others stay unused

    def document(self) -> dict[str, Any]:
        """As JSON carries it: every float keeps all its digits."""
        return {**{name: getattr(self.plant, name) for name in _CONSTANTS}, "volume": list(self.volume)}


def _pressure(buffer: int) -> Callable[[Columns, Basis], np.ndarray]:
    name = BUFFERS[buffer]

    def formula(columns: Columns, basis: Basis) -> np.ndarray:
        volume = basis.plant.buffer_volume[buffer]
        found: np.ndarray = gas_pressure(columns[f"mass_{name}"], columns[f"temperature_{name}"], volume)
        return found

    return formula


def _vehicle_pressure(columns: Columns, basis: Basis) -> np.ndarray:
    volumes = np.asarray(basis.volume, np.float64)
    volume = volumes[np.clip(columns["vehicle"], 0, len(volumes) - 1)]
    found: np.ndarray = gas_pressure(columns["mass_vehicle"], columns["temperature_vehicle"], volume)
    return found


def _compressed(columns: Columns, basis: Basis) -> np.ndarray:
    total = np.zeros(len(columns["time"]))
    for name, valve in zip(BUFFERS, _INLETS, strict=True):
        total = total + np.where(columns[valve], inlet_flow(columns[f"pressure_{name}"], basis.plant), 0.0)
    return total


def _dispensed(columns: Columns, basis: Basis) -> np.ndarray:
    total, vehicle = np.zeros(len(columns["time"])), columns["pressure_vehicle"]
    for name, valve in zip(BUFFERS, _OUTLETS, strict=True):
        total = total + np.where(columns[valve], outlet_flow(columns[f"pressure_{name}"], vehicle, basis.plant), 0.0)
    return total


class _Rule(NamedTuple):
    needs: tuple[str, ...]
    formula: Callable[[Columns, Basis], np.ndarray]


_RULES = {
    **{
        f"pressure_{name}": _Rule((f"mass_{name}", f"temperature_{name}"), _pressure(place))
        for place, name in enumerate(BUFFERS)
    },
    "pressure_vehicle": _Rule(("mass_vehicle", "temperature_vehicle", "vehicle"), _vehicle_pressure),
    "flow_compressor": _Rule(("time", *(f"pressure_{name}" for name in BUFFERS), *_INLETS), _compressed),
    "flow_dispenser": _Rule(("time", *(f"pressure_{name}" for name in (*BUFFERS, "vehicle")), *_OUTLETS), _dispensed),
}
"""The columns that follow, and from which; the columns that a rule needs stand before it."""


# Packing.


def packed(columns: Columns, basis: Basis, about: Mapping[str, str]) -> bytes:
    """Columns of equal length as a Parquet file; `about` goes into its metadata."""
    import pyarrow as pa  # slow to import
    from pyarrow import parquet

    arrays = {name: pa.array(column) for name, column in columns.items()}
    sums = {}
    for name, rule in _RULES.items():
        with np.errstate(all="ignore"):
            follows = _same_bits(columns[name], rule.formula(columns, basis))
        arrays[name] = pa.array(columns[name], mask=follows)
        sums[name] = _checksum(columns[name])
    mark = json.dumps({"basis": basis.document(), "checksums": sums}, separators=(",", ":"))
    table = pa.table(arrays)
    codecs = {name: codec for name, codec in _CODECS.items() if name in columns}
    stream = pa.BufferOutputStream()
    with parquet.ParquetWriter(
        stream, table.schema, compression="zstd", compression_level=_LEVEL, use_dictionary=list(_FEW),
        column_encoding=codecs, write_statistics=False, store_schema=False,
    ) as writer:  # fmt: skip
        writer.write_table(table)
        writer.add_key_value_metadata({_MARK.decode(): mark, **about})
    content: bytes = stream.getvalue().to_pybytes()
    return content


def plain(columns: Columns) -> bytes:
    """Columns of floats as a Parquet file from which nothing follows."""
    import pyarrow as pa
    from pyarrow import parquet

    stream = pa.BufferOutputStream()
    parquet.write_table(
        pa.table({name: pa.array(column) for name, column in columns.items()}), stream, compression="zstd",
        compression_level=_LEVEL, use_dictionary=False, column_encoding=dict.fromkeys(columns, "BYTE_STREAM_SPLIT"),
        write_statistics=False, store_schema=False,
    )  # fmt: skip
    content: bytes = stream.getvalue().to_pybytes()
    return content


def _same_bits(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Where two columns of floats are equal to the last bit, NaN included."""
    return np.ascontiguousarray(one).view(np.uint64) == np.ascontiguousarray(other).view(np.uint64)


def _checksum(column: np.ndarray) -> int:
    return zlib.crc32(np.ascontiguousarray(column, np.float64).data)


class Kept(StrEnum):
    """The part of a run's record that is stored besides its figures of merit."""

    FULL = "full"
    VEHICLES = "vehicles"  # the table of vehicles alone
    NONE = "none"


def packed_record(record: Record, kept: Kept = Kept.FULL) -> bytes | None:
    """A run's record as it is stored; `whole` makes of it the file that `Record.parquet` writes.

    None where nothing of it is kept.
    """
    if kept is Kept.NONE:
        return None
    vehicles = json.dumps({name: column.tolist() for name, column in record.vehicles.items()})
    told = record.controller, str(record.replication), str(record.seed), record.scenario.model_dump_json(), vehicles
    about = dict(zip(_ABOUT, told, strict=True))
    rows = len(record) if kept is Kept.FULL else 0
    columns = {name: record[name][:rows] for name in record.columns}
    return packed(columns, Basis.of(record.scenario.station, record.vehicles["volume"].tolist()), about)


# Unpacking.


def unpacked(content: bytes, wanted: Sequence[str] = ()) -> dict[str, np.ndarray]:
    """Columns of a stored file, all or the wanted ones of those that it has, in this order.

    Raises
    ------
    DamagedError
        if a column that follows from others does not follow as it did.
    """
    file = _opened(content)
    there = file.schema_arrow.names
    names = [name for name in wanted or there if name in there]
    marked = (file.metadata.metadata or {}).get(_MARK)
    if marked is None:
        read = file.read(columns=names)
        return {name: read[name].to_numpy() for name in names}
    mark = json.loads(marked)
    read = file.read(columns=_needed(names))
    basis = Basis.parse(mark["basis"])
    columns: dict[str, np.ndarray] = {}
    for name in [*(name for name in read.column_names if name not in _RULES), *_RULES]:
        if name in read.column_names:
            columns[name] = _completed(name, read[name], columns, basis, mark["checksums"])
    return {name: columns[name] for name in names}


def _opened(content: bytes) -> parquet.ParquetFile:
    import pyarrow as pa
    from pyarrow import parquet

    return parquet.ParquetFile(pa.BufferReader(content))


def names_of(content: bytes) -> list[str]:
    """Names of the columns of a stored file."""
    names: list[str] = _opened(content).schema_arrow.names
    return names


def _needed(names: Sequence[str]) -> list[str]:
    """These columns and those that they follow from."""
    needed = dict.fromkeys(names)
    for name in reversed(_RULES):  # what follows from what follows first
        if name in needed:
            needed |= dict.fromkeys(_RULES[name].needs)
    return list(needed)


def _completed(
    name: str, stored: pa.ChunkedArray, columns: Columns, basis: Basis, checksums: Mapping[str, int]
) -> np.ndarray:  # fmt: skip
    figures: np.ndarray = stored.to_numpy()
    if name not in _RULES:
        return figures
    with np.errstate(all="ignore"):
        column = np.where(np.asarray(stored.is_null()), _RULES[name].formula(columns, basis), figures)
    if _checksum(column) != checksums[name]:
        raise DamagedError(f"column {name} is not what was recorded: its checksum is another")
    return column


def whole(content: bytes) -> bytes:
    """A stored record as a Parquet file for others: every column complete, with its unit, and no marks of ours."""
    import pyarrow as pa
    from pyarrow import parquet

    about = _opened(content).metadata.metadata or {}
    if _MARK not in about:
        return content
    columns = unpacked(content)
    units = units_of(content)
    fields = [
        pa.field(name, pa.from_numpy_dtype(column.dtype), metadata={"unit": units[name]})
        for name, column in columns.items()
    ]
    metadata = {name: about[name.encode()] for name in _ABOUT if name.encode() in about}
    table = pa.table([pa.array(column) for column in columns.values()], schema=pa.schema(fields, metadata=metadata))
    stream = pa.BufferOutputStream()
    parquet.write_table(table, stream, compression="zstd")
    made: bytes = stream.getvalue().to_pybytes()
    return made


def plant_of(content: bytes) -> str:
    """Name of the plant of a stored record's station."""
    scenario = json.loads((_opened(content).metadata.metadata or {})[b"scenario"])
    return str(scenario["station"].get("plant", THESIS.name))


def units_of(content: bytes) -> dict[str, str]:
    """Name and unit of every column that a stored record has."""
    return {**VALUES, **plant_named(plant_of(content)).columns, **CODES, **COUNTS}


def vehicles_of(content: bytes) -> dict[str, np.ndarray]:
    """The table of vehicles of a stored record."""
    columns = json.loads((_opened(content).metadata.metadata or {})[b"vehicles"])
    return {name: np.array(column, np.float64) for name, column in columns.items()}
