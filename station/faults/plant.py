"""Faults of the plant, which change what happens, and how a run applies them."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from station.faults.base import BaseFault
from station.geometry import BUFFERS
from station.plants.interface import M, P, T
from station.plants.thesis import THESIS, gas_pressure

ATMOSPHERE = 1.01325
"""A buffer at this pressure leaks no more [bar]."""

Percent = Annotated[float, Field(gt=0, lt=100, json_schema_extra={"unit": "%"})]


class Leak(BaseFault):
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


class CompressorWeak(BaseFault):
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


class CompressorTripped(BaseFault):
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


class DispenserClogged(BaseFault):
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
