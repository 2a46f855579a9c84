"""Measurements: a tag map says what a column is, and in what unit.

Quality has the three levels of OPC UA (Part 8, status codes): good, uncertain, bad. A sample that is bad, no number or
outside what its sensor can read counts as missing, and a missing value is NaN.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError, model_validator

from station.errors import InputError
from station.files import parse_file
from station.geometry import VALVES
from station.quantities import PRESSURE_MAX, VOLUME_MAX, Part
from station.sensor_names import SENSORS

if TYPE_CHECKING:
    import pyarrow as pa

REQUIRED = (*VALVES, "vehicle")
"""What the station was told to do must be known; every other sensor may be missing."""

POWER_MAX = 10_000.0
"""Largest electric power of the compressors [kW]."""

_RANGES = {
    "pressure": ("bar", 0.0, PRESSURE_MAX),
    "temperature": ("degC", -100.0, 200.0),
    "flow": ("g/s", -1000.0, 1000.0),
    "inlet": ("", 0.0, 1.0),
    "outlet": ("", 0.0, 1.0),
    "vehicle": ("", -1.0, 1e9),
    "vehicle_volume": ("m^3", 1e-6, VOLUME_MAX),
    "power": ("kW", 0.0, POWER_MAX),
}
"""Unit, lowest and highest value of each kind of sensor."""

NOISE = {"pressure": 1.0, "temperature": 0.5, "flow": 0.01}
"""Standard deviation of a sensor whose tag says none, in its unit."""

METER_CLASS = 0.5
"""Accuracy class of a flow meter whose tag tells none, that of usual Coriolis meters [%]."""

FLOW_NOISE = 0.02
"""Relative part of a flow meter's, where its tag says none."""

UNCERTAIN = 3.0
"""By so much more noise a sample of uncertain quality is trusted less."""

_FACTOR_MAX = 1e12
"""Largest scale and offset of a tag: beyond it a figure is a mistake."""

LAG_MAX = 60.0
"""Most by which a tag may lag [s]."""

TIME_CONSTANT_MAX = 120.0
"""Longest time constant of a thermometer [s]."""

_GOOD = ("good", "192")
_UNCERTAIN = ("uncertain", "64")


def kind_of(sensor: str) -> str:
    """Which kind of sensor this is, a key of the tables of units and noise."""
    return sensor if sensor in _RANGES else sensor.partition("_")[0]


def unit_of(sensor: str) -> str:
    """The unit a sensor's values have once they are read."""
    return _RANGES[kind_of(sensor)][0]


def range_of(sensor: str) -> tuple[float, float]:
    """The lowest and highest value that a sensor can have, in the unit of `unit_of`."""
    return _RANGES[kind_of(sensor)][1:]


def _factor(about: str, example: float) -> Any:
    """A field of a conversion; any finite number."""
    return Field(ge=-_FACTOR_MAX, le=_FACTOR_MAX, allow_inf_nan=False, description=about, examples=[example])


class Tag(Part):
    """One tag: which column it stands in, and which sensor it is.

    A value is `scale * cell + offset` in `unit`; the sample was true `lag_s` seconds before its time.
    """

    tag: Annotated[str, Field(min_length=1, max_length=128, description="Its name at the station", examples=["PT-101"])]
    column: Annotated[
        str, Field(min_length=1, max_length=128, description="Column of a record with its values", examples=["PT101"])
    ]
    sensor: Annotated[str, Field(description="Sensor that it is", examples=["pressure_high"])]
    unit: Annotated[str, Field(description="Unit of its values; empty: the sensor's own", examples=["MPa"])] = ""
    scale: Annotated[float, _factor("A value is scale * cell + offset; not 0", 1.0)] = 1.0
    offset: Annotated[float, _factor("A value is scale * cell + offset", 0.0)] = 0.0
    lag_s: Annotated[
        float,
        Field(
            ge=-LAG_MAX, le=LAG_MAX, description="A sample was true so long before its time", examples=[0.0],
            json_schema_extra={"unit": "s"},
        ),
    ] = 0.0  # fmt: skip
    time_constant_s: Annotated[
        Annotated[float, Field(ge=0, le=TIME_CONSTANT_MAX, json_schema_extra={"unit": "s"})] | None,
        Field(
            description="A thermometer follows its gas with such a first-order lag; left out: as a record fits best, "
            "and 0 for live measurements",
            examples=[10.0],
        ),
    ] = None
    noise: Annotated[
        Annotated[float, Field(gt=0, le=1000, allow_inf_nan=False)] | None,
        Field(description="Standard deviation in the sensor's unit; left out: the usual one", examples=[1.0]),
    ] = None
    noise_relative: Annotated[
        float,
        Field(ge=0, le=1, description="Relative part of the noise of a meter of flow or power", examples=[FLOW_NOISE]),
    ] = FLOW_NOISE
    class_percent: Annotated[
        float,
        Field(
            ge=0, le=10, description="A meter of flow reads too much or too little by this part at most, all the time",
            examples=[METER_CLASS], json_schema_extra={"unit": "%"},
        ),
    ] = METER_CLASS  # fmt: skip
    source: Annotated[str, Field(description="Tags of one source have one clock", examples=["transmitters"])] = (
        "station"
    )
    quality: Annotated[
        str | None, Field(description="Column of a record with its quality", examples=["PT101_quality"])
    ] = None
    on_change: Annotated[
        bool,
        Field(
            description="Told only when it changes, it holds until then: a valve, a vehicle, no flow", examples=[False]
        ),
    ] = False  # fmt: skip
    node: Annotated[
        str | None,
        Field(min_length=1, max_length=512, description="Node of an OPC UA server", examples=["ns=2;s=PT-101"]),
    ] = None

    @property
    def deviation(self) -> float:
        """Standard deviation of a good sample, its absolute part, in the sensor's unit."""
        return self.noise or NOISE.get(kind_of(self.sensor), 1.0)

    @model_validator(mode="after")
    def _convertible(self) -> Tag:
        if self.sensor not in SENSORS:
            raise ValueError(f"sensor must be one of {', '.join(SENSORS)}; given {self.sensor!r:.100}")
        if self.scale == 0:
            raise ValueError("scale must not be 0: every value would be the same")
        if self.time_constant_s and kind_of(self.sensor) != "temperature":
            raise ValueError("time_constant_s must be 0: it is for thermometers")
        if self.on_change and kind_of(self.sensor) in ("pressure", "temperature"):
            raise ValueError("on_change must be false: pressures and temperatures change all the time")
        convert(np.zeros(1), self.unit, self.sensor)
        return self


class TagMap(Part):
    """The tags of a station, and the column of time: seconds, or timestamps."""

    time: Annotated[str, Field(min_length=1, description="Column of a record with the time", examples=["time_s"])] = (
        "time_s"
    )
    tags: Annotated[
        list[Tag],
        Field(
            min_length=1,
            max_length=200,
            description="One for each sensor; the valves' and the vehicle's must be there",
            examples=[[{"tag": "PT-101", "column": "PT101", "sensor": "pressure_high", "unit": "bar"}]],
        ),
    ]

    @model_validator(mode="after")
    def _one_each(self) -> TagMap:
        sensors = [tag.sensor for tag in self.tags]
        if doubled := sorted({sensor for sensor in sensors if sensors.count(sensor) > 1}):
            raise ValueError(f"each sensor must have one tag; {', '.join(doubled)} has more")
        if missing := [sensor for sensor in REQUIRED if sensor not in sensors]:
            raise ValueError(f"tags must name {', '.join(REQUIRED)}; missing {', '.join(missing)}")
        return self

    @property
    def sources(self) -> tuple[str, ...]:
        """The sources, each with a clock; first the one that tells the valves, whose clock is taken for right."""
        first = next(tag.source for tag in self.tags if tag.sensor == VALVES[0])
        return (first, *sorted({tag.source for tag in self.tags} - {first}))


def load_tags(path: Path) -> TagMap:
    """The tag map of a TOML or JSON file.

    Raises
    ------
    InputError
        naming each wrong field with its limit, or the file that cannot be read.
    """
    try:
        return TagMap.model_validate(parse_file(path, str(path)))
    except ValidationError as error:
        raise InputError.of(str(path), error) from None


def convert(values: NDArray[np.float64], unit: str, sensor: str) -> NDArray[np.float64]:
    """Values in the unit of a sensor.

    Raises
    ------
    ValueError
        if the unit is unknown or of another dimension.
    """
    wanted = unit_of(sensor)
    if unit in (wanted, ""):
        return values
    try:
        return np.asarray(unit_registry().Quantity(values, unit).to(wanted).magnitude, np.float64)
    except Exception as error:  # noqa: BLE001 - pint raises what its parser and tokenizer raise
        raise ValueError(f"unit must be one of {wanted or 'none'}'s dimension; given {unit!r:.50} ({error})") from None


@cache
def unit_registry() -> Any:
    """The registry of units; to make one takes a third of a second."""
    import pint

    return pint.UnitRegistry(cache_folder=None)


@dataclass(frozen=True)
class Samples:
    """Samples of one sensor by a source, in the sensor's unit, as they came: in any order, at any rate."""

    tag: Tag
    time: NDArray[np.float64]  # (k,) of the source's clock, less the tag's lag [s]
    value: NDArray[np.float64]  # (k,) NaN where bad or missing
    noise: NDArray[np.float64]  # (k,) standard deviation, absolute part


def samples_of(table: pa.Table, tags: TagMap, source: str = "record") -> list[Samples]:
    """The samples of a table with a column a tag.

    Raises
    ------
    InputError
        naming the column that is missing or holds no numbers.
    """
    time = times_of(table, tags, source)
    check_columns(table, tags, source)
    found = []
    for tag in tags.tags:
        cells, uncertain, bad = cells_of(table, tag, source)
        told = np.where(np.isnan(cells) & tag.on_change, np.nan, time)  # an empty cell is no sample
        found.append(read_samples(tag, told, cells, uncertain, bad))
    return found


_FEWEST_CHANGES = 10
"""Of fewer values it is not said whether they are told when they change."""


def seem_told_on_change(samples: Sequence[Samples]) -> list[str]:
    """Tags that never tell one value twice in a row, no flow say, and whose map does not say so."""
    found = []
    for each in samples:
        kind, value = kind_of(each.tag.sensor), each.value[np.isfinite(each.value) & np.isfinite(each.time)]
        rests = kind not in ("pressure", "temperature", "flow") or (kind == "flow" and (value == 0.0).any())
        if rests and not each.tag.on_change and len(value) >= _FEWEST_CHANGES and np.diff(value).all():
            found.append(each.tag.tag)
    return found


def times_of(table: pa.Table, tags: TagMap, source: str) -> NDArray[np.float64]:
    """Time of each row of a table [s], shape (k,); NaN where it is empty.

    Raises
    ------
    InputError
        naming the column that is missing or holds no times.
    """
    return _numbers(table, tags.time, source, time=True)


def check_columns(table: pa.Table, tags: TagMap, source: str) -> None:
    """Refuse a table that lacks the column of a tag.

    Raises
    ------
    InputError
        naming each such tag, and the columns that there are.
    """
    problems = []
    for tag in tags.tags:
        if tag.column not in table.column_names or (tag.quality and tag.quality not in table.column_names):
            missing = tag.column if tag.column not in table.column_names else tag.quality
            there = ", ".join(table.column_names)
            problems.append((f"tags.{tag.tag}", f"column {missing!r} must be in the record; there are {there:.200}"))
    if problems:
        raise InputError(source, problems)


def cells_of(
    table: pa.Table, tag: Tag, source: str
) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_]]:
    """The cells of a tag as the table has them, which of them are uncertain, and which are bad; shapes (k,).

    Raises
    ------
    InputError
        naming the column that holds no numbers.
    """
    cells = _numbers(table, tag.column, source)
    uncertain = bad = np.zeros(len(cells), np.bool_)
    if tag.quality:
        words = np.array([str(word).strip().lower() for word in table[tag.quality].to_pylist()])
        uncertain = np.isin(words, _UNCERTAIN)
        bad = ~np.isin(words, _GOOD + _UNCERTAIN)
    return cells, uncertain, bad


def read_samples(
    tag: Tag, time: NDArray[np.float64], cells: NDArray[np.float64], uncertain: NDArray[np.bool_],
    bad: NDArray[np.bool_],
) -> Samples:  # fmt: skip
    """Samples of a tag from the cells of its source.

    Parameters
    ----------
    tag : Tag
        Which sensor it is, and how its cells are read.
    time : ndarray, shape (k,)
        Of the source's clock [s].
    cells : ndarray, shape (k,)
        As the source gives them.
    uncertain, bad : ndarray, shape (k,)
        Whose quality is that.

    Returns
    -------
    Samples
        In the sensor's unit; NaN where bad, or outside what the sensor can read.
    """
    kind = kind_of(tag.sensor)
    _, low, high = _RANGES[kind]
    with np.errstate(invalid="ignore", over="ignore"):
        value = convert(tag.scale * cells + tag.offset, tag.unit, tag.sensor)
        value = np.where((value >= low) & (value <= high) & ~bad, value, np.nan)
    noise = np.full(len(value), tag.deviation)
    noise[uncertain] *= UNCERTAIN
    return Samples(tag, time - tag.lag_s, value, noise)


def _numbers(table: pa.Table, column: str, source: str, *, time: bool = False) -> NDArray[np.float64]:
    """A column as numbers, NaN where a cell is empty."""
    import pyarrow as pa
    import pyarrow.compute as pc

    if column not in table.column_names:
        raise InputError(source, [(column, f"must be a column of the record; there are {table.column_names!s:.200}")])
    cells = table[column]
    try:
        if time and pa.types.is_timestamp(cells.type):
            cells = pc.divide(pc.cast(pc.cast(cells, pa.timestamp("us")), pa.int64()), 1e6)
        return np.array(pc.cast(cells, pa.float64()).to_numpy(zero_copy_only=False), np.float64)
    except pa.ArrowException as error:
        raise InputError(source, [(column, f"must hold numbers: {error!s:.200}")]) from None


def read_table(path: Path) -> pa.Table:
    """The table of a CSV or Parquet file.

    Raises
    ------
    InputError
        if it cannot be read.
    """
    import pyarrow as pa
    from pyarrow import csv, parquet

    if path.suffix not in (".csv", ".parquet"):
        raise InputError(str(path), [("", "must be a .csv or .parquet file")])
    try:
        if path.suffix == ".csv":
            return csv.read_csv(path, csv.ReadOptions(use_threads=False))
        with parquet.ParquetFile(path) as file:
            return file.read(use_threads=False)  # threads of Arrow's may abort a process that ends
    except (pa.ArrowException, OSError) as error:
        raise InputError(str(path), [("", f"cannot be read: {error!s:.300}")]) from None
