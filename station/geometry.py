"""Names and order of tanks and valves, and the zero of temperatures: what everybody says of a station alike."""

from __future__ import annotations

from enum import IntFlag
from typing import Literal

KELVIN = 273.15
"""Absolute temperature of 0 deg C [K]."""

HIGH, MEDIUM, LOW, VEHICLE = 0, 1, 2, 3
"""Places of the tanks in every array and tuple."""

BUFFERS = ("high", "medium", "low")
"""Names of the buffers in that order."""

BufferName = Literal["high", "medium", "low"]
"""One of them, as a type."""

TANKS = (*BUFFERS, "vehicle")
"""Names of all tanks in that order."""


class Valve(IntFlag):
    """The six valves of a station as bits of a command."""

    INLET_HIGH = 1
    INLET_MEDIUM = 2
    INLET_LOW = 4
    OUTLET_HIGH = 8
    OUTLET_MEDIUM = 16
    OUTLET_LOW = 32


VALVES = tuple(f"{side}_{buffer}" for side in ("inlet", "outlet") for buffer in BUFFERS)
"""Names of the valves in the order of their bits."""


CLOSED = 0


INLETS = int(Valve.INLET_HIGH | Valve.INLET_MEDIUM | Valve.INLET_LOW)


OUTLETS = int(Valve.OUTLET_HIGH | Valve.OUTLET_MEDIUM | Valve.OUTLET_LOW)


ALL_VALVES = INLETS | OUTLETS
