"""Settings of the reserve rule, and the vector its kernel reads."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from controllers.base import Settings
from station.geometry import HIGH
from station.parameters import Station
from station.plants.interface import emptied_to, filled_to
from station.starts import full_low
from station.whole import WHOLE

# Entries of the settings, and of the memory behind the estimate.
SLOT, GAP, OPEN, STOP, SPACE = 0, 1, 2, 3, 6  # from STOP on the pressure at which high, medium and low are full
FULL, RETURNS = 7, 8  # pressure from which high is opened whatever the gap; whether a vehicle may go back

SETTINGS_SIZE = 9

OPEN_SHARE = 0.05
"""At real gas a buffer is opened at the latest with this share of what it may give, for vehicles wait for it."""

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
        Gap,
        Field(
            description="From which high is opened, at first and each time it has come too close; at real gas at most "
            "a twentieth of the way from its least to its greatest pressure"
        ),
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
    return stop, stop, min(stop, full_low(station.constants()))


def _spans(station: Station) -> tuple[float, float]:
    """The greatest pressure of high at a station of real gas, and how far that is above its least [bar]."""
    model = station.control_constants()
    greatest = float(filled_to(HIGH, model))
    return greatest, greatest - float(emptied_to(HIGH, model))


def reserve_vector(settings: ReserveSettings, station: Station) -> np.ndarray:
    """The settings the kernel reads (SETTINGS_SIZE,).

    At real gas nothing is certified of the rule: a vehicle may go back to a buffer, and what opens high is a share of
    what it may give.
    """
    stops = full_pressures(settings, station)
    opens, full, returns = settings.open_bar, stops[HIGH], 0.0
    if station.real_gas is not None:
        greatest, span = _spans(station)
        opens, full, returns = min(opens, OPEN_SHARE * span), greatest - (1.0 - settings.stop_share) * span, 1.0
    return np.array(
        [settings.slot_s, settings.gap_bar, opens, *stops, settings.space_s, full, returns], dtype=np.float64
    )
