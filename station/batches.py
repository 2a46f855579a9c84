"""A batch of measurements: samples of some tags as a source sends them, in any order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from station.errors import InputError
from station.measurement import Samples, TagMap, cells_of, check_columns, read_samples, times_of

if TYPE_CHECKING:
    import pyarrow as pa

BATCH_MAX = 20_000
"""Most samples of a batch."""

TIME_MAX = 253_402_300_800.0
"""Times lie within so many seconds of 0: Unix time up to the year 10000."""


class Quality(IntEnum):
    """Quality of a sample, the three levels of OPC UA (Part 8)."""

    BAD = 0
    UNCERTAIN = 1
    GOOD = 2


@dataclass(frozen=True, eq=False)
class Batch:
    """Samples of the tags of a map, in the order in which they came; its arrays cannot be written to.

    Given are arrays of one length or what becomes one. A value that is no finite number becomes NaN, its quality bad.

    Raises
    ------
    InputError
        naming what is longer than BATCH_MAX, has another length, or lies outside its limits.
    """

    tag: NDArray[np.int16]  # (k,) place of each sample's tag among `TagMap.tags`
    time: NDArray[np.float64]  # (k,) of the source's clock [s]
    value: NDArray[np.float64]  # (k,) as the source gives it, before scale and offset; NaN where there is none
    quality: NDArray[np.uint8]  # (k,) a `Quality`

    def __post_init__(self) -> None:
        tag, quality = (_whole(name, getattr(self, name)) for name in ("tag", "quality"))
        time, value = (_numbers(name, getattr(self, name)) for name in ("time", "value"))
        count = len(tag)
        if count > BATCH_MAX:
            raise InputError("batch", [("", f"must hold at most {BATCH_MAX} samples; given {count}")])
        for name, array in (("time", time), ("value", value), ("quality", quality)):
            if len(array) != count:
                raise InputError("batch", [(name, f"must hold {count} entries, as tag does; given {len(array)}")])
        top = float(np.iinfo(np.int16).max)
        _refuse_outside("tag", tag, 0.0, top)
        _refuse_outside("quality", quality, float(Quality.BAD), float(Quality.GOOD))
        _refuse_outside("time", time, -TIME_MAX, TIME_MAX)
        read = np.isfinite(value)
        arrays: dict[str, NDArray[Any]] = {
            "tag": tag.astype(np.int16),
            "time": time,
            "value": np.where(read, value, np.nan),
            "quality": np.where(read, quality, Quality.BAD).astype(np.uint8),
        }
        for name, kept in arrays.items():
            kept.flags.writeable = False
            object.__setattr__(self, name, kept)

    @classmethod
    def named(cls, tags: TagMap, names: Sequence[str], time: Any, value: Any, quality: Any = None) -> Batch:
        """A batch whose samples have the names of their tags; all of good quality where none is given.

        Raises
        ------
        InputError
            naming the first tags that the map does not have, and what the class refuses.
        """
        places = tag_places(tags)
        if unknown := sorted({name for name in names if name not in places}):
            message = f"must be tags of the map; given {', '.join(unknown[:5])!s:.200}"
            raise InputError("batch", [("tag", message)])
        tag = np.array([places[name] for name in names], np.int16)
        return cls(tag, time, value, np.full(len(tag), Quality.GOOD) if quality is None else quality)

    @classmethod
    def joined(cls, batches: Sequence[Batch]) -> Batch:
        """The samples of several batches as one, in their order; at most BATCH_MAX."""
        empty = np.zeros(0)
        names = ("tag", "time", "value", "quality")
        return cls(*(np.concatenate([empty, *(getattr(each, name) for each in batches)]) for name in names))

    def __len__(self) -> int:
        return len(self.tag)

    def part(self, places: NDArray[np.int64] | slice) -> Batch:
        """Some of the samples, in the order of `places`."""
        return Batch(self.tag[places], self.time[places], self.value[places], self.quality[places])

    def samples(self, tags: TagMap) -> list[Samples]:
        """The samples of each tag of the map, in sensors' units and the order in which they came.

        A tag that is silent has an empty series.

        Raises
        ------
        InputError
            naming the place that the map does not have.
        """
        _refuse_outside("tag", self.tag, 0.0, len(tags.tags) - 1.0)
        found = []
        for place, tag in enumerate(tags.tags):
            of_it = np.flatnonzero(self.tag == place)
            quality = self.quality[of_it]
            uncertain, bad = quality == Quality.UNCERTAIN, quality == Quality.BAD
            found.append(read_samples(tag, self.time[of_it], self.value[of_it], uncertain, bad))
        return found


def tag_places(tags: TagMap) -> dict[str, int]:
    """Place of each tag of a map by its name.

    Raises
    ------
    InputError
        naming the tags whose name is another's too.
    """
    names = [tag.tag for tag in tags.tags]
    if doubled := sorted({name for name in names if names.count(name) > 1}):
        raise InputError("tags", [("tag", f"must be another for each; given twice {', '.join(doubled)!s:.200}")])
    return {name: place for place, name in enumerate(names)}


def batches_of(
    table: pa.Table, tags: TagMap, each_s: float, start_s: float | None = None, source: str = "record"
) -> list[Batch]:  # fmt: skip
    """The samples of a table in the order of their times, in batches of `each_s` seconds and at most BATCH_MAX.

    Cells that are empty are no samples; rows without a time, or earlier than `start_s`, are left out. The same table
    gives the same batches.

    Raises
    ------
    InputError
        naming the column that is missing or holds no numbers, or that there is no sample.
    """
    time = times_of(table, tags, source)
    check_columns(table, tags, source)
    kept = np.flatnonzero(time >= (-np.inf if start_s is None else start_s))
    kept = kept[np.argsort(time[kept], kind="stable")]
    cells, quality = np.empty((len(kept), len(tags.tags))), np.full((len(kept), len(tags.tags)), Quality.GOOD, np.uint8)
    for column, tag in enumerate(tags.tags):
        value, uncertain, bad = cells_of(table, tag, source)
        cells[:, column] = value[kept]
        quality[uncertain[kept], column] = Quality.UNCERTAIN
        quality[bad[kept], column] = Quality.BAD
    row, column_of = np.nonzero(~np.isnan(cells))
    place = column_of.astype(np.int16)
    if not len(row):
        raise InputError(source, [("", "must hold at least one sample with a time and a value")])
    of_it = time[kept][row]
    whole = np.floor((of_it - of_it[0]) / each_s)
    begins = np.flatnonzero(np.diff(whole, prepend=-1.0))
    blocks = zip(begins, [*begins[1:], len(row)], strict=True)
    cuts = [cut for begin, end in blocks for cut in range(begin, end, BATCH_MAX)]
    parts = (slice(*ends) for ends in zip(cuts, [*cuts[1:], len(row)], strict=True))
    value, rated = cells[row, column_of], quality[row, column_of]
    return [Batch(place[part], of_it[part], value[part], rated[part]) for part in parts]


def _numbers(name: str, given: Any) -> NDArray[np.float64]:
    try:
        array = np.array(given, np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InputError("batch", [(name, "must hold numbers")]) from None
    if array.ndim != 1:
        raise InputError("batch", [(name, f"must have one dimension; given {array.ndim}")])
    return array


def _whole(name: str, given: Any) -> NDArray[np.float64]:
    array = _numbers(name, given)
    wrong = np.flatnonzero(array != np.floor(array))
    if len(wrong):
        raise InputError("batch", [(name, f"must hold whole numbers; given {array[wrong[0]]:g} at {wrong[0]}")])
    return array


def _refuse_outside(name: str, array: NDArray[Any], low: float, high: float) -> None:
    wrong = np.flatnonzero(~((array >= low) & (array <= high)))
    if len(wrong):
        given = f"given {array[wrong[0]]:g} at {wrong[0]}"
        raise InputError("batch", [(name, f"must lie from {low:.0f} to {high:.0f}; {given}")])
