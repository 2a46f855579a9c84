"""Calibrations as requests order them and answers show them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Literal

from pydantic import BaseModel, Field

from api.http.pagination import FAR, Next
from api.http.strict import Body
from api.jobs.schemas import JobStatus, status_of
from api.store.records import Job, JobState
from api.twins.schemas import Id
from station import Station
from station.whole import WHOLE

_LIMIT = 1e308

_Figure = Annotated[float, Field(ge=-_LIMIT, le=_LIMIT)]

_Second = Annotated[int, Field(ge=0, le=FAR, json_schema_extra={"unit": "s"}), WHOLE]

_Name = Annotated[str, Field(description="Name", examples=["compressor.pressure_bar"])]


class CalibrationRequest(Body):
    """Calibrate the station of a measured twin from its seconds."""

    twin: Id
    from_s: Annotated[
        _Second | None,
        Field(
            description="First second; left out: as many as there are by clocks put right, and as are allowed",
            examples=[0],
        ),
    ] = None
    to_s: Annotated[_Second | None, Field(description="Last second; left out: the newest", examples=[86399])] = None


class StationMove(Body):
    """Follow with the station that a calibration found."""

    calibration: Annotated[
        str,
        Field(
            min_length=1, max_length=40, description="A calibration whose model was accepted",
            examples=["calibration-019a7c3f2b10a1b2c3d4"],
        ),
    ]  # fmt: skip


class CalibratedParameter(BaseModel):
    """A parameter with its 95 % interval, in the unit that its name ends with."""

    value: Annotated[_Figure, Field(description="Found; the station's own where it is not known", examples=[918.2])]
    low: Annotated[_Figure, Field(description="Lower end of the interval", examples=[915.9])]
    high: Annotated[_Figure, Field(description="Upper end of the interval", examples=[920.5])]
    known: Annotated[bool, Field(description="Whether the measurements say anything of it", examples=[True])]


class ChannelFit(BaseModel):
    """How well a sensor's readings in the part held out fit."""

    innovation_rms: Annotated[
        _Figure, Field(description="Of innovations, in standard deviations; 0.9 to 1.05 fits", examples=[0.998])
    ]
    block_rms: Annotated[
        _Figure,
        Field(
            description="Of sums over 120 s, in standard deviations; up to 1.3 fits, of few readings more",
            examples=[1.01],
        ),
    ]
    outliers: Annotated[
        _Figure, Field(description="Part of the readings that were not used; up to 0.01 fits", examples=[0.0])
    ]


class CalibrationResult(BaseModel):
    """What a calibration found."""

    verdict: Annotated[
        Literal["accepted", "refused"],
        Field(description="Whether the last quarter, which is not fitted to, fits", examples=["accepted"]),
    ]
    refused: Annotated[
        list[str],
        Field(
            description="Why the model is refused, a line a channel or parameter; empty where it is accepted",
            examples=[["pressure_high: innovations 3.020 (must be 0.9 to 1.05)"]],
        ),
    ]
    parameters: Annotated[
        dict[_Name, CalibratedParameter], Field(description="By their place in a station", examples=[{}])
    ]
    unknown: Annotated[
        list[str],
        Field(
            description="Parameters of which the measurements say too little",
            examples=[["thermal.heat_exchange_per_s"]],
        ),
    ]
    channels: Annotated[dict[_Name, ChannelFit], Field(description="By sensor", examples=[{}])]
    station: Annotated[
        Station | None,
        Field(description="The calibrated station; null where the model is refused, and in lists", examples=[None]),
    ]


class Calibration(JobStatus):
    """A calibration and, when it is done, what it found."""

    twin: Id
    station: Annotated[str, Field(description="Name of the station that was calibrated", examples=["thesis-fit"])]
    from_s: Annotated[int, Field(ge=0, description="First second", json_schema_extra={"unit": "s"}, examples=[0])]
    to_s: Annotated[int, Field(ge=0, description="Last second", json_schema_extra={"unit": "s"}, examples=[86399])]
    source_time: Annotated[
        _Figure,
        Field(
            description="Time of the first measurements, by the station's clock", json_schema_extra={"unit": "s"},
            examples=[1795252800.0],
        ),
    ]  # fmt: skip
    version: Annotated[str, Field(description="Version of hrs-twin that was asked", examples=["0.1.0"])]
    progress: Annotated[float, Field(ge=0, le=1, description="Part of the work that is done", examples=[0.5])]
    result: Annotated[CalibrationResult | None, Field(description="Null until done", examples=[None])]


class CalibrationPage(BaseModel):
    """Calibrations, the newest first; their results without stations."""

    items: Annotated[list[Calibration], Field(description="Calibrations", examples=[[]])]
    next: Next


def calibration_of(job: Job, rows: Sequence[dict[str, Any]], *, whole: bool = True) -> Calibration:
    """A stored calibration as answers show it; `rows` hold what it found, if it has."""
    done = job.state is JobState.SUCCEEDED and bool(rows)
    result = CalibrationResult.model_validate(rows[0] if whole else {**rows[0], "station": None}) if done else None
    about = job.summary
    return Calibration(
        **status_of(job), twin=about["twin"], station=about["station"], from_s=about["from_s"], to_s=about["to_s"],
        source_time=about["start"], version=about["version"],
        progress=1.0 if done else job.progress or 0.0, result=result,
    )  # fmt: skip
