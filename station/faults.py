"""Faults of a station that are known to be there: of the plant, of a sensor, of a clock; with time and size.

Those of the plant change what happens (`PlantFaults`), the others what is measured (`station.measured_day`). Each has
the name by which `station.estimation.detection` would tell it, so that detection can be scored.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from station.geometry import BUFFERS
from station.measurement import kind_of, unit_of
from station.parameters import Part
from station.plants.interface import M, P, T
from station.plants.thesis import THESIS, gas_pressure

FAULTS_MAX = 50
"""Most faults of a scenario."""

ATMOSPHERE = 1.01325
"""A buffer at this pressure leaks no more [bar]."""

Seconds = Annotated[float, Field(ge=0, le=1e9, allow_inf_nan=False, json_schema_extra={"unit": "s"})]
Percent = Annotated[float, Field(gt=0, lt=100, json_schema_extra={"unit": "%"})]
Analog = Literal[
    "pressure_high", "pressure_medium", "pressure_low", "pressure_vehicle", "temperature_high", "temperature_medium",
    "temperature_low", "temperature_vehicle", "flow_compressor", "flow_dispenser",
]  # fmt: skip
"""The sensors of `station.measurement.ANALOG`, as a type."""

Sensor = Annotated[Analog, Field(description="That fails", examples=["pressure_high"])]


class _Fault(Part):
    """When a fault is there: from `begin_s` on, up to `end_s` or for ever."""

    OF_PLANT: ClassVar[bool] = False

    begin_s: Annotated[Seconds, Field(description="From this second of the run on", examples=[20_000.0])]
    end_s: Annotated[
        Seconds | None,
        Field(description="Up to this second; left out: to the end of the run", examples=[24_000.0]),
    ] = None

    @model_validator(mode="after")
    def _ordered(self) -> _Fault:
        if self.end_s is not None and self.end_s <= self.begin_s:
            raise ValueError(f"end_s must lie behind begin_s {self.begin_s:g} s; given {self.end_s:g}")
        return self

    def there(self, time: float) -> bool:
        """Whether it is there at a time [s]."""
        return self.begin_s <= time < self.until

    @property
    def until(self) -> float:
        """When it ends [s]; infinite: never."""
        return math.inf if self.end_s is None else self.end_s

    @property
    def event(self) -> str:
        """The name of the event that tells it."""
        raise NotImplementedError

    @property
    def size(self) -> tuple[float, str] | None:
        """How large it is, in the unit of its event; None where it has no size."""
        return None


class Leak(_Fault):
    """A buffer that loses gas, while it lies above the atmosphere."""

    OF_PLANT: ClassVar[bool] = True

    kind: Literal["leak"]
    buffer: Annotated[Literal["high", "medium", "low"], Field(description="That leaks", examples=["high"])]
    rate_g_per_s: Annotated[
        float,
        Field(
            gt=0,
            le=100,
            allow_inf_nan=False,
            description="What it loses",
            json_schema_extra={"unit": "g/s"},
            examples=[0.5],
        ),
    ]

    @property
    def event(self) -> str:
        """The name of the event that tells it."""
        return f"leak_{self.buffer}"

    @property
    def size(self) -> tuple[float, str] | None:
        """The loss [g/s]."""
        return self.rate_g_per_s, "g/s"


class CompressorWeak(_Fault):
    """A compressor that gives less than it should; heat rates stay, which chapter 7 has constant."""

    OF_PLANT: ClassVar[bool] = True

    kind: Literal["compressor_weak"]
    loss_percent: Annotated[Percent, Field(description="Part of its flow that is missing", examples=[20.0])]

    @property
    def event(self) -> str:
        """The name of the event that tells it."""
        return "compressor_weak"

    @property
    def size(self) -> tuple[float, str] | None:
        """Part of the flow that is missing [%]."""
        return self.loss_percent, "%"


class CompressorTripped(_Fault):
    """A compressor that gives nothing, and heats nothing, whatever it is told."""

    OF_PLANT: ClassVar[bool] = True

    kind: Literal["compressor_tripped"]

    @property
    def event(self) -> str:
        """The name of the event that tells it: one that gives nothing is as weak as can be."""
        return "compressor_weak"

    @property
    def size(self) -> tuple[float, str] | None:
        """All of the flow [%]."""
        return 100.0, "%"


class DispenserClogged(_Fault):
    """A dispenser through which less flows than should. The shield knows the flow that there is."""

    OF_PLANT: ClassVar[bool] = True

    kind: Literal["dispenser_clogged"]
    loss_percent: Annotated[Percent, Field(description="Part of its flow that is missing", examples=[20.0])]

    @property
    def event(self) -> str:
        """The name of the event that tells it."""
        return "dispenser_clogged"

    @property
    def size(self) -> tuple[float, str] | None:
        """Part of the flow that is missing [%]."""
        return self.loss_percent, "%"


_ENDINGS = {"pressure": "bar", "temperature": "k", "flow": "g_per_s"}


class _Sized(_Fault):
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


class SensorFrozen(_Fault):
    """A sensor that goes on saying its last value."""

    kind: Literal["sensor_frozen"]
    sensor: Sensor

    @property
    def event(self) -> str:
        """The name of the event that tells it."""
        return f"frozen_{self.sensor}"


class SensorAbsent(_Fault):
    """A sensor that says nothing."""

    kind: Literal["sensor_absent"]
    sensor: Sensor

    @property
    def event(self) -> str:
        """The name of the event that tells it."""
        return f"absent_{self.sensor}"


class ClockSkew(_Fault):
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


Fault = Annotated[
    Leak | CompressorWeak | CompressorTripped | DispenserClogged
    | SensorOffset | SensorDrift | SensorNoisy | SensorFrozen | SensorAbsent | ClockSkew,
    Field(discriminator="kind"),
]  # fmt: skip
"""A fault of a scenario."""

Faults = Annotated[list[Fault], Field(max_length=FAULTS_MAX)]
"""Faults of a scenario, in any order; they may be there at one time."""


def check_plant(faults: list[Any], plant: str) -> None:
    """Raise ValueError for a fault that the plant of a station cannot have.

    Faults of the plant act on masses and flows of Eqs (7.1)-(7.10); another plant keeps energies besides.
    """
    for row, fault in enumerate(faults):
        if fault.OF_PLANT and plant != THESIS.name:
            raise ValueError(
                f"faults.{row}.kind must be one of a sensor or clock at a station whose plant is {plant!r}: faults of "
                f"the plant act on the flows of {THESIS.name!r} alone; given {fault.kind!r}"
            )


class PlantFaults:
    """The faults of a plant, as a run applies them around each of its seconds.

    Parameters
    ----------
    faults : list of Fault
        Those of a scenario; what is none of the plant is left out.
    """

    def __init__(self, faults: list[Any]) -> None:
        self._faults = [fault for fault in faults if fault.OF_PLANT]

    def __bool__(self) -> bool:
        """Whether there is any."""
        return bool(self._faults)

    def constants(self, plant: Any, time: float) -> Any:
        """The constants of the second that begins at a time [s], from those of a healthy plant of chapter 7."""
        for fault in self._faults:
            if not fault.there(time):
                continue
            if isinstance(fault, CompressorWeak):
                plant = plant._replace(inlet_coefficient=plant.inlet_coefficient * (1 - fault.loss_percent / 100))
            elif isinstance(fault, CompressorTripped):
                plant = plant._replace(inlet_coefficient=0.0, inlet_heating=(0.0, 0.0, 0.0))
            elif isinstance(fault, DispenserClogged):
                plant = plant._replace(outlet_coefficient=plant.outlet_coefficient * (1 - fault.loss_percent / 100))
        return plant

    def lose(self, state: np.ndarray, plant: Any, time: float, period: float) -> None:
        """Take out of the buffers what leaked in the second that began at a time [s]."""
        for fault in self._faults:
            if isinstance(fault, Leak) and fault.there(time):
                buffer = BUFFERS.index(fault.buffer)
                if state[P + buffer] > ATMOSPHERE:
                    volume = plant.buffer_volume[buffer]
                    state[M + buffer] = max(state[M + buffer] - period * fault.rate_g_per_s, 0.0)
                    state[P + buffer] = gas_pressure(state[M + buffer], state[T + buffer], volume)
