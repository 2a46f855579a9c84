"""Faults of the plant, which change what happens, and how a run applies them."""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from station.faults.base import BaseFault
from station.geometry import BUFFERS, CLOSED, VALVES, BufferName
from station.plants.interface import plant_named, plant_of

Rates = tuple[float, float, float, float, float, float, float]
"""What high, medium, low and the line lose, and what the closed outlets of high, medium and low let through [g/s]."""


MOST_LOST, MOST_WARMER = 100.0, 60.0
"""Largest leak [g/s], and by how much a precooler is warmer at most [K]."""

Percent = Annotated[float, Field(gt=0, lt=100, json_schema_extra={"unit": "%"})]


class _Losing(BaseFault):
    """Gas that is lost."""

    OF_PLANT: ClassVar[bool] = True

    rate_g_per_s: Annotated[
        float,
        Field(
            gt=0, le=MOST_LOST, allow_inf_nan=False, description="What it loses", json_schema_extra={"unit": "g/s"},
            examples=[0.5],
        ),
    ]  # fmt: skip

    @property
    def size(self) -> tuple[float, str] | None:
        """The loss [g/s]."""
        return self.rate_g_per_s, "g/s"


class Leak(_Losing):
    """A buffer that loses gas, while it lies above the atmosphere."""

    kind: Literal["leak"]
    buffer: Annotated[BufferName, Field(description="That leaks", examples=["high"])]

    @property
    def event(self) -> str:
        """The name of the event that tells it."""
        return f"leak_{self.buffer}"


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


class PrecoolerWeak(BaseFault):
    """A precooler that gas leaves warmer than it should, as one whose heat exchanger is fouled."""

    OF_PLANT: ClassVar[bool] = True

    kind: Literal["precooler_weak"]
    warmer_k: Annotated[
        float,
        Field(
            gt=0, le=MOST_WARMER, allow_inf_nan=False, description="By how much more than its block the gas meets",
            json_schema_extra={"unit": "K"}, examples=[5.0],
        ),
    ]  # fmt: skip

    @property
    def event(self) -> str:
        """The name of the event that tells it."""
        return "precooler_weak"

    @property
    def size(self) -> tuple[float, str] | None:
        """By how much warmer the gas meets it [K]."""
        return self.warmer_k, "K"


class LineLeak(_Losing):
    """A line that loses gas between the outlets and the dispenser's meter, while an outlet is open."""

    kind: Literal["line_leak"]

    @property
    def event(self) -> str:
        """The name of the event that tells it."""
        return "leak_line"


class OutletLeak(_Losing):
    """An outlet that is not tight: gas flows through to the vehicle connected while it is told to be closed."""

    kind: Literal["outlet_leak"]
    valve: Annotated[
        Literal["outlet_high", "outlet_medium", "outlet_low"], Field(description="That leaks", examples=["outlet_high"])
    ]

    @property
    def event(self) -> str:
        """The name of the event that tells it."""
        return f"leak_{self.valve}"


class ValveStuck(BaseFault):
    """A valve that stays as it is whatever it is told, and reports what it is told.

    Through an outlet that is stuck open gas flows while a vehicle of less pressure is connected. Through an inlet that
    is, what is compressed flows while another is told to open whose buffer is fuller.
    """

    OF_PLANT: ClassVar[bool] = True

    kind: Literal["valve_stuck"]
    valve: Annotated[
        Literal["inlet_high", "inlet_medium", "inlet_low", "outlet_high", "outlet_medium", "outlet_low"],
        Field(description="That sticks", examples=["outlet_high"]),
    ]
    position: Annotated[Literal["open", "closed"], Field(description="How it stays", examples=["closed"])]

    @property
    def event(self) -> str:
        """The name of the event that tells it."""
        return f"stuck_{self.valve}"


def _place(fault: Leak | LineLeak | OutletLeak) -> int:
    """Of a leak among `Rates`."""
    if isinstance(fault, LineLeak):
        return len(BUFFERS)
    if isinstance(fault, OutletLeak):
        return 1 + VALVES.index(fault.valve)
    return BUFFERS.index(fault.buffer)


def check_plant(faults: list[Any], plant: str) -> None:
    """Raise ValueError for a fault that the plant of a station cannot have."""
    for row, fault in enumerate(faults):
        if isinstance(fault, PrecoolerWeak) and not plant_named(plant).precools:
            raise ValueError(
                f"faults.{row}.kind must be another at a station whose plant is {plant!r}: it has no precooler; given "
                f"{fault.kind!r}"
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

    def stuck(self, time: float) -> tuple[int, int]:
        """Valves that are stuck open and closed in the second that begins at a time [s], as bits of Valve."""
        found = {"open": CLOSED, "closed": CLOSED}
        for fault in self._faults:
            if isinstance(fault, ValveStuck) and fault.there(time):
                found[fault.position] |= 1 << VALVES.index(fault.valve)
        return found["open"] & ~found["closed"], found["closed"]

    def constants(self, plant: Any, time: float) -> Any:
        """The constants of the second that begins at a time [s], from those of a healthy plant."""
        compressor, dispenser, warmer, any_there = 1.0, 1.0, 0.0, False
        for fault in self._faults:
            if not fault.there(time) or isinstance(fault, _Losing | ValveStuck):
                continue
            any_there = True
            if isinstance(fault, CompressorWeak):
                compressor *= 1 - fault.loss_percent / 100
            elif isinstance(fault, CompressorTripped):
                compressor = 0.0
            elif isinstance(fault, DispenserClogged):
                dispenser *= 1 - fault.loss_percent / 100
            elif isinstance(fault, PrecoolerWeak):
                warmer += fault.warmer_k
        return plant_of(type(plant)).ailing(plant, compressor, dispenser, warmer) if any_there else plant

    def rates(self, time: float) -> Rates:
        """Leaks of the second that begins at a time [s]."""
        lost = [0.0] * (2 * len(BUFFERS) + 1)
        for fault in self._faults:
            if isinstance(fault, Leak | LineLeak | OutletLeak) and fault.there(time):
                lost[_place(fault)] += fault.rate_g_per_s
        return lost[0], lost[1], lost[2], lost[3], lost[4], lost[5], lost[6]

    def behind(self, time: float) -> list[BaseFault]:
        """Those that are there behind a time [s]."""
        return [fault for fault in self._faults if fault.until > time]

    def next_change(self, time: float) -> float:
        """When the next fault begins or ends behind a time [s]; infinite: none does."""
        return min((at for fault in self._faults for at in (fault.begin_s, fault.until) if at > time), default=math.inf)
