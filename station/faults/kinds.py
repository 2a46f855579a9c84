"""Every kind of fault, as a scenario lists them."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from station.faults.plant import (
    CompressorTripped,
    CompressorWeak,
    DispenserClogged,
    Leak,
    LineLeak,
    OutletLeak,
    PrecoolerWeak,
    ValveStuck,
)
from station.faults.sensors import ClockSkew, SensorAbsent, SensorDrift, SensorFrozen, SensorNoisy, SensorOffset

FAULTS_MAX = 50
"""Most faults of a scenario."""

PlantFault = (
    Leak | LineLeak | OutletLeak | CompressorWeak | CompressorTripped | DispenserClogged | PrecoolerWeak | ValveStuck
)
"""A fault of a station's plant, told from the others by its `kind`."""

Fault = Annotated[
    PlantFault
    | SensorOffset | SensorDrift | SensorNoisy | SensorFrozen | SensorAbsent | ClockSkew,
    Field(discriminator="kind"),
]  # fmt: skip
"""A fault of a scenario."""

Faults = Annotated[list[Fault], Field(max_length=FAULTS_MAX)]
"""Faults of a scenario, in any order; they may be there at one time."""
