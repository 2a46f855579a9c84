"""Settings of the reserve rule, and the vector its kernel reads."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from controllers.base import Settings
from station.limits import START_SHARE, start_limit
from station.parameters import Station
from station.whole import WHOLE

# Entries of the settings, and of the memory behind the estimate.
SLOT, GAP, OPEN, STOP, SPACE = 0, 1, 2, 3, 6  # from STOP on the pressure at which high, medium and low are full


SETTINGS_SIZE = 7


Gap = Annotated[float, Field(ge=0, le=2000, allow_inf_nan=False, json_schema_extra={"unit": "bar"})]

Share = Annotated[float, Field(gt=0, le=1, json_schema_extra={"unit": "1"})]


class ReserveSettings(Settings):
    """Settings of `reserve`; all have defaults that fit any station."""

    slot_s: Annotated[
        int,
        Field(
            ge=1, le=60, description="How long a buffer's turn at the compressor lasts",
            json_schema_extra={"unit": "s"},
        ),
        WHOLE,
    ] = 10  # fmt: skip
    gap_bar: Annotated[
        Gap, Field(description="At which low and medium hand the vehicle on, where it exceeds the dispenser's least")
    ] = 0.0
    stop_share: Annotated[
        Share,
        Field(
            description="A buffer is full at this share of the compressor's pressure; low no later than "
            "where the dispenser's greatest flow would keep an empty vehicle from it"
        ),
    ] = 0.95
    open_bar: Annotated[
        Gap, Field(description="From which high is opened, at first and each time it has come too close")
    ] = 130.0
    space_s: Annotated[
        int,
        Field(
            ge=0, le=7200,
            description="Fills begin at least so far apart: a vehicle of a burst waits until the buffers are restored",
            json_schema_extra={"unit": "s"},
        ),
        WHOLE,
    ] = 0  # fmt: skip


def full_pressures(settings: ReserveSettings, station: Station) -> tuple[float, float, float]:
    """The pressures at which high, medium and low are full [bar]."""
    stop = settings.stop_share * station.compressor.pressure_bar
    return stop, stop, min(stop, START_SHARE * start_limit(station.constants()))


def reserve_vector(settings: ReserveSettings, station: Station) -> np.ndarray:
    """The settings the kernel reads (SETTINGS_SIZE,)."""
    full = full_pressures(settings, station)
    return np.array([settings.slot_s, settings.gap_bar, settings.open_bar, *full, settings.space_s], dtype=np.float64)
