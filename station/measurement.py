"""Measured seconds: a tag map says what a column is; samples become frames of a second, and nothing is invented.

Quality has the three levels of OPC UA (Part 8, status codes): good, uncertain, bad. A sample that is bad, no number or
outside what its sensor can read counts as missing, and a missing value is NaN.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError, model_validator

from station.errors import InputError
from station.files import parse_file
from station.geometry import TANKS, VALVES
from station.quantities import PRESSURE_MAX, VOLUME_MAX, Part

if TYPE_CHECKING:
    import pyarrow as pa

ANALOG = (*(f"pressure_{tank}" for tank in TANKS), *(f"temperature_{tank}" for tank in TANKS), "flow_compressor",
          "flow_dispenser")  # fmt: skip
"""Sensors with an error, the filter's channels, in its order."""

SENSORS = (*ANALOG, *VALVES, "vehicle", "vehicle_volume")
"""Everything a tag can be: `vehicle` numbers the vehicle connected, -1 for none."""

REQUIRED = (*VALVES, "vehicle")
"""What the station was told to do must be known; every other sensor may be missing."""

_RANGES = {
    "pressure": ("bar", 0.0, PRESSURE_MAX),
    "temperature": ("degC", -100.0, 200.0),
    "flow": ("g/s", -1000.0, 1000.0),
    "inlet": ("", 0.0, 1.0),
    "outlet": ("", 0.0, 1.0),
    "vehicle": ("", -1.0, 1e9),
    "vehicle_volume": ("m^3", 1e-6, VOLUME_MAX),
}
"""Unit, lowest and highest value of each kind of sensor."""

NOISE = {"pressure": 1.0, "temperature": 0.5, "flow": 0.01}
"""Standard deviation of a sensor whose tag says none, in its unit."""

FLOW_NOISE = 0.02
"""Relative part of a flow meter's, where its tag says none."""

UNCERTAIN = 3.0
"""By so much more noise a sample of uncertain quality is trusted less."""

LAG_MAX = 60.0
"""Most by which a tag may lag [s]."""

SECONDS_MAX = 40 * 86_400
"""Longest record [s]."""

_GOOD = ("good", "192")
_UNCERTAIN = ("uncertain", "64")


def kind_of(sensor: str) -> str:
    """Which kind of sensor this is, a key of the tables of units and noise."""
    return sensor if sensor in _RANGES else sensor.partition("_")[0]


def unit_of(sensor: str) -> str:
    """The unit a sensor's values have once they are read."""
    return _RANGES[kind_of(sensor)][0]


Finite = Annotated[float, Field(allow_inf_nan=False)]


class Tag(Part):
    """One tag: which column it stands in, and which sensor it is.

    A value is `scale * cell + offset` in `unit`; the sample was true `lag_s` seconds before its time.
    """

    tag: Annotated[str, Field(min_length=1, max_length=128)]
    column: Annotated[str, Field(min_length=1, max_length=128)]
    sensor: str
    unit: str = ""
    scale: Finite = 1.0
    offset: Finite = 0.0
    lag_s: Annotated[float, Field(ge=-LAG_MAX, le=LAG_MAX)] = 0.0
    noise: Annotated[float, Field(gt=0, le=1000, allow_inf_nan=False)] | None = None
    noise_relative: Annotated[float, Field(ge=0, le=1)] = FLOW_NOISE
    source: str = "station"
    quality: str | None = None

    @model_validator(mode="after")
    def _convertible(self) -> Tag:
        if self.sensor not in SENSORS:
            raise ValueError(f"sensor must be one of {', '.join(SENSORS)}; given {self.sensor!r:.100}")
        if self.scale == 0:
            raise ValueError("scale must not be 0: every value would be the same")
        convert(np.zeros(1), self.unit, self.sensor)
        return self


class TagMap(Part):
    """The tags of a station, and the column of time: seconds, or timestamps."""

    time: Annotated[str, Field(min_length=1)] = "time_s"
    tags: Annotated[list[Tag], Field(min_length=1, max_length=200)]

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
        return np.asarray(_units().Quantity(values, unit).to(wanted).magnitude, np.float64)
    except Exception as error:  # noqa: BLE001 - pint raises what its parser and tokenizer raise
        raise ValueError(f"unit must be one of {wanted or 'none'}'s dimension; given {unit!r:.50} ({error})") from None


@cache
def _units() -> Any:
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


@dataclass(frozen=True)
class Frames:
    """A record second by second."""

    start: float  # time of the first [s]
    values: NDArray[np.float64]  # (seconds, len(SENSORS)) NaN where nothing is known
    noise: NDArray[np.float64]  # (seconds, len(ANALOG)) standard deviation, absolute part
    relative: NDArray[np.float64]  # (len(ANALOG),) relative part, of flows alone
    measured: tuple[str, ...]  # sensors that have a tag

    def __len__(self) -> int:
        return len(self.values)

    def __getitem__(self, sensor: str) -> NDArray[np.float64]:
        """The values of a sensor."""
        return self.values[:, SENSORS.index(sensor)]

    def part(self, first: int, last: int) -> Frames:
        """The seconds from `first` up to `last`."""
        return Frames(
            self.start + first, self.values[first:last], self.noise[first:last], self.relative, self.measured
        )  # fmt: skip


def samples_of(table: pa.Table, tags: TagMap, source: str = "record") -> list[Samples]:
    """The samples of a table with a column a tag.

    Raises
    ------
    InputError
        naming the column that is missing or holds no numbers.
    """
    time = _numbers(table, tags.time, source, time=True)
    found, problems = [], []
    for tag in tags.tags:
        if tag.column not in table.column_names or (tag.quality and tag.quality not in table.column_names):
            missing = tag.column if tag.column not in table.column_names else tag.quality
            there = ", ".join(table.column_names)
            problems.append((f"tags.{tag.tag}", f"column {missing!r} must be in the record; there are {there:.200}"))
            continue
        found.append(_samples(table, tag, time, source))
    if problems:
        raise InputError(source, problems)
    return found


def _samples(table: pa.Table, tag: Tag, time: NDArray[np.float64], source: str) -> Samples:
    kind = kind_of(tag.sensor)
    _, low, high = _RANGES[kind]
    value = convert(tag.scale * _numbers(table, tag.column, source) + tag.offset, tag.unit, tag.sensor)
    noise = np.full(len(value), tag.noise or NOISE.get(kind, 1.0))
    if tag.quality:
        words = np.array([str(word).strip().lower() for word in table[tag.quality].to_pylist()])
        noise[np.isin(words, _UNCERTAIN)] *= UNCERTAIN
        value[~np.isin(words, _GOOD + _UNCERTAIN)] = np.nan
    with np.errstate(invalid="ignore"):
        value[~((value >= low) & (value <= high))] = np.nan
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
        return csv.read_csv(path) if path.suffix == ".csv" else parquet.read_table(path)
    except (pa.ArrowException, OSError) as error:
        raise InputError(str(path), [("", f"cannot be read: {error!s:.300}")]) from None


def frames_of(samples: list[Samples], skew: dict[str, float] | None = None) -> Frames:
    """Samples brought to whole seconds: of each sensor the one nearest to the second, within half a second of it.

    `skew` says by how much the clock of a source is fast [s]. Of two samples of one time the later in the file counts.

    Raises
    ------
    InputError
        if there is no time at all, or the record is longer than SECONDS_MAX.
    """
    given = np.concatenate([each.time[np.isfinite(each.time) & np.isfinite(each.value)] for each in samples])
    if not len(given):
        raise InputError("record", [("", "must hold at least one sample with a time and a value")])
    start, length = np.floor(given.min()), int(np.ceil(given.max()) - np.floor(given.min())) + 1
    if length > SECONDS_MAX:
        raise InputError("record", [("time", f"must not span more than {SECONDS_MAX} s; given {length}")])
    values = np.full((length, len(SENSORS)), np.nan)
    noise = np.ones((length, len(ANALOG)))
    relative = np.zeros(len(ANALOG))
    for each in samples:
        column = SENSORS.index(each.tag.sensor)
        place, rows = _nearest(each, start + (skew or {}).get(each.tag.source, 0.0), length)
        values[rows, column] = each.value[place]
        if column < len(ANALOG):
            noise[rows, column] = each.noise[place]
            relative[column] = each.tag.noise_relative if kind_of(each.tag.sensor) == "flow" else 0.0
    return Frames(float(start), values, noise, relative, tuple(each.tag.sensor for each in samples))


def _nearest(each: Samples, start: float, length: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Which samples count, and the seconds they count for."""
    good = np.flatnonzero(np.isfinite(each.time) & np.isfinite(each.value))
    since = each.time[good] - start
    second = np.floor(since + 0.5)
    inside = (second >= 0) & (second < length)
    good, since, second = good[inside], since[inside], second[inside].astype(np.int64)
    order = np.lexsort((-good, np.abs(since - second), second))
    first = np.unique(second[order], return_index=True)[1]
    return good[order][first], second[order][first]
