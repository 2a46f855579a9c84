"""Measurements of twins as answers show them, and what is estimated from them."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

from pydantic import BaseModel, Field

from api.twins.schemas import Id

SOURCE_PATTERN = r"^[A-Za-z0-9._:-]{1,64}$"
"""Of the names of who sends measurements."""

SEQUENCE_MAX = 2**53 - 1
"""Largest whole number that every JSON has."""

_LIMIT = 1e308
"""Of figures that are finite, and bounded by nothing else."""

_Figure = Annotated[float, Field(ge=-_LIMIT, le=_LIMIT)]

_Name = Annotated[str, Field(description="Name", examples=["mass_high"])]


class StoredBatch(BaseModel):
    """Measurements that are stored, and followed soon."""

    number: Annotated[
        int, Field(ge=1, description="In the order in which the twin's measurements came", examples=[4711])
    ]
    samples: Annotated[
        int, Field(ge=1, description="Samples sent", json_schema_extra={"unit": "samples"}, examples=[30])
    ]
    repeated: Annotated[bool, Field(description="Whether they were stored already", examples=[False])]


class MeasurementSource(BaseModel):
    """The newest measurements that a source has sent."""

    source: Annotated[str, Field(description="Who sends them", examples=["gateway-1"])]
    sequence: Annotated[int, Field(ge=0, description="Highest of its sequence numbers", examples=[360])]


class MeasurementSources(BaseModel):
    """Who has sent measurements to a twin, and up to where."""

    sources: Annotated[list[MeasurementSource], Field(description="By name", examples=[[]])]


class EstimatedQuantity(BaseModel):
    """An estimate with its standard deviation; null where there is none, as of a vehicle that is not there."""

    value: Annotated[_Figure | None, Field(description="Estimate", examples=[5213.4])]
    deviation: Annotated[_Figure | None, Field(description="Standard deviation, in the same unit", examples=[21.7])]
    unit: Annotated[str, Field(description="Unit; a deviation of degC is in K", examples=["g"])]


class Verdict(StrEnum):
    """What an estimate says of a part's health."""

    SOUND = "sound"  # as it should be
    FAILING = "failing"  # beyond the limit of detection, and surely
    UNKNOWN = "unknown"  # a loss at the limit could not be told from none, or the filter still learns


class SensorReading(BaseModel):
    """What a sensor told in the second, and how far it lay from what was expected."""

    value: Annotated[_Figure | None, Field(description="Measured; null where nothing is known", examples=[812.5])]
    innovation: Annotated[
        _Figure | None, Field(description="Measured less expected, in standard deviations", examples=[-0.4])
    ] = None
    error: Annotated[_Figure | None, Field(description="Measured less expected, in the unit", examples=[-0.41])] = None
    unit: Annotated[str, Field(description="Unit", examples=["bar"])]


_Bound = Annotated[_Figure | None, Field(json_schema_extra={"unit": "s"}, examples=[1795252770.0])]


class DetectedEvent(BaseModel):
    """Something that the measurements say is wrong."""

    name: Annotated[str, Field(description="What is wrong", examples=["leak_high"])]
    begin_s: Annotated[
        _Figure, Field(description="About when it began", json_schema_extra={"unit": "s"}, examples=[1795252800.0])
    ]
    found_s: Annotated[
        _Figure, Field(description="When it was found", json_schema_extra={"unit": "s"}, examples=[1795252920.0])
    ]
    size: Annotated[_Figure | None, Field(description="How large it is", examples=[0.31])]
    unit: Annotated[str, Field(description="Unit of the size", examples=["g/s"])]
    settled: Annotated[bool, Field(description="False: its size is told again later", examples=[True])] = True
    size_deviation: Annotated[
        _Figure | None, Field(description="Standard deviation of the size, where it has one", examples=[0.05])
    ] = None
    begin_low_s: _Bound = Field(None, description="It was not there before; null where that is not known")
    begin_high_s: _Bound = Field(None, description="It was there then; null where that is not known")


class SampleCounts(BaseModel):
    """Samples since the beginning, by what became of them."""

    taken: Annotated[int, Field(ge=0, description="Followed", examples=[108000])]
    late: Annotated[int, Field(ge=0, description="Came when their second was closed", examples=[3])]
    empty: Annotated[int, Field(ge=0, description="Bad, no number or outside the sensor's range", examples=[12])]
    ahead: Annotated[int, Field(ge=0, description="Too far ahead of all others", examples=[0])]
    duplicate: Annotated[int, Field(ge=0, description="Taken for the tag and time of another", examples=[0])]


class Estimate(BaseModel):
    """The newest second that a twin has followed."""

    twin: Id
    epoch: Annotated[int, Field(ge=1, description="Start of the twin it belongs to", examples=[1])]
    seq: Annotated[int, Field(ge=0, description="Number of the second, from 0", examples=[3599])]
    source_time: Annotated[
        _Figure, Field(description="Time of the measurements", json_schema_extra={"unit": "s"}, examples=[1795252800.0])
    ]
    quantities: Annotated[dict[_Name, EstimatedQuantity], Field(description="Estimates", examples=[{}])]
    health: Annotated[
        dict[_Name, Verdict],
        Field(description="Whether each buffer leaks, and compressor, dispenser and precooler are weak", examples=[{}]),
    ]
    refused: Annotated[
        list[str],
        Field(
            description="Why the model does not fit the last hour, a line a channel: then no leak or weakness counts",
            examples=[["pressure_high: innovations 3.020 (must be 0.9 to 1.05)"]],
        ),
    ]
    unknown: Annotated[list[str], Field(description="Quantities of which nothing is known", examples=[["leak_low"]])]
    sensors: Annotated[dict[_Name, SensorReading], Field(description="Readings", examples=[{}])]
    events: Annotated[list[DetectedEvent], Field(description="What was detected, in order", examples=[[]])]
    lasting: Annotated[
        list[str] | None,
        Field(description="Names of events that last; null when it has ended", examples=[["leak_high"]]),
    ]
    number: Annotated[
        int | None, Field(ge=0, description="Of the last measurements followed; null when it has ended", examples=[360])
    ]
    samples: Annotated[
        SampleCounts | None,
        Field(
            description="What became of samples; null when it has ended",
            examples=[{"taken": 108000, "late": 3, "empty": 12, "ahead": 0, "duplicate": 0}],
        ),
    ]
