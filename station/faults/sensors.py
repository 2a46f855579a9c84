"""Faults of sensors and clocks, which change what is measured."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, model_validator

from station.faults.base import BaseFault
from station.measurement import kind_of, unit_of

Analog = Literal[
    "pressure_high", "pressure_medium", "pressure_low", "pressure_vehicle", "temperature_high", "temperature_medium",
    "temperature_low", "temperature_vehicle", "flow_compressor", "flow_dispenser",
]  # fmt: skip
"""The sensors of `station.measurement.ANALOG`, as a type."""

Sensor = Annotated[Analog, Field(description="That fails", examples=["pressure_high"])]

_ENDINGS = {"pressure": "bar", "temperature": "k", "flow": "g_per_s"}


class _Sized(BaseFault):
    """A fault of a sensor with a size, in one of the fields that `stem` begins: the one of the sensor's unit."""

    STEM: ClassVar[str]
    TAIL: ClassVar[str] = ""

    sensor: Sensor

    @model_validator(mode="after")
    def _one_size(self) -> _Sized:
        wanted = self._field()
        for ending in _ENDINGS.values():
            field = f"{self.STEM}_{ending}{self.TAIL}"
            if (getattr(self, field) is None) == (field == wanted):
                must = "must be given" if field == wanted else f"must be left out: {wanted} is its size"
                raise ValueError(f"{field} {must} where sensor is {self.sensor}")
        return self

    def _field(self) -> str:
        return f"{self.STEM}_{_ENDINGS[kind_of(self.sensor)]}{self.TAIL}"

    @property
    def amount(self) -> float:
        """Its size, in the unit of its sensor (of drift: an hour)."""
        return float(getattr(self, self._field()))


Size = Annotated[float, Field(ge=-1000, le=1000, allow_inf_nan=False)]
Spread = Annotated[float, Field(gt=0, le=1000, allow_inf_nan=False)]


def _size(description: str, unit: str, example: float) -> Any:
    """What is told of the size of a sensor's fault, which stands in the field of its unit alone."""
    return Field(description=description, examples=[example], json_schema_extra={"unit": unit})


class SensorOffset(_Sized):
    """A sensor that reads so much too high."""

    STEM: ClassVar[str] = "offset"

    kind: Literal["sensor_offset"]
    offset_bar: Annotated[Size | None, _size("By how much it reads too high", "bar", 5.0)] = None
    offset_k: Annotated[Size | None, _size("By how much it reads too high", "K", 5.0)] = None
    offset_g_per_s: Annotated[Size | None, _size("By how much it reads too high", "g/s", 5.0)] = None

    @property
    def event(self) -> str:
        """The name of the event that tells it."""
        return f"offset_{self.sensor}"

    @property
    def size(self) -> tuple[float, str] | None:
        """By how much it reads too high, in the sensor's unit."""
        return self.amount, unit_of(self.sensor)


class SensorDrift(_Sized):
    """A sensor whose offset grows by so much an hour."""

    STEM: ClassVar[str] = "drift"
    TAIL: ClassVar[str] = "_per_h"

    kind: Literal["sensor_drift"]
    drift_bar_per_h: Annotated[Size | None, _size("By how much more it reads too high an hour later", "bar/h", 3.0)] = (
        None
    )
    drift_k_per_h: Annotated[Size | None, _size("By how much more it reads too high an hour later", "K/h", 3.0)] = None
    drift_g_per_s_per_h: Annotated[
        Size | None, _size("By how much more it reads too high an hour later", "g/s/h", 3.0)
    ] = None

    @property
    def event(self) -> str:
        """The name of the event that tells it."""
        return f"drift_{self.sensor}"

    @property
    def size(self) -> tuple[float, str] | None:
        """By how much more it reads too high an hour later, in the sensor's unit."""
        return self.amount, f"{unit_of(self.sensor)}/h"


class SensorNoisy(_Sized):
    """A sensor with so much more noise, as a standard deviation."""

    STEM: ClassVar[str] = "noise"

    kind: Literal["sensor_noisy"]
    noise_bar: Annotated[Spread | None, _size("Standard deviation of the noise that is added", "bar", 4.0)] = None
    noise_k: Annotated[Spread | None, _size("Standard deviation of the noise that is added", "K", 4.0)] = None
    noise_g_per_s: Annotated[Spread | None, _size("Standard deviation of the noise that is added", "g/s", 4.0)] = None

    @property
    def event(self) -> str:
        """The name of the event that tells it."""
        return f"noisy_{self.sensor}"

    @property
    def size(self) -> tuple[float, str] | None:
        """Standard deviation of the noise that is added, in the sensor's unit."""
        return self.amount, unit_of(self.sensor)


class SensorFrozen(BaseFault):
    """A sensor that goes on saying its last value."""

    kind: Literal["sensor_frozen"]
    sensor: Sensor

    @property
    def event(self) -> str:
        """The name of the event that tells it."""
        return f"frozen_{self.sensor}"


class SensorAbsent(BaseFault):
    """A sensor that says nothing."""

    kind: Literal["sensor_absent"]
    sensor: Sensor

    @property
    def event(self) -> str:
        """The name of the event that tells it."""
        return f"absent_{self.sensor}"


class ClockSkew(BaseFault):
    """The clock of the transmitters is fast against that of the valves."""

    kind: Literal["clock_skew"]
    skew_s: Annotated[
        int, Field(ge=-60, le=60, description="So fast; below 0: slow", json_schema_extra={"unit": "s"}, examples=[3])
    ]

    @property
    def event(self) -> str:
        """The name of the event that tells it."""
        return "clock_skew_transmitters"

    @property
    def size(self) -> tuple[float, str] | None:
        """How fast the clock is [s]."""
        return float(self.skew_s), "s"
