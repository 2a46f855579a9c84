"""The electric power of a compressor tells its flow, where no meter does.

A compressor that gives less takes less power, for the work of a gram follows from the pressure that it is pressed
against. So a reading of the power is one of the flow: the flow that the station's file expects against the pressures
read, times the power read by the power expected.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from station.frames import Frames
from station.geometry import BUFFERS, VALVES
from station.measurement import NOISE
from station.sensor_names import ANALOG, POWER, SENSORS

_FLOW = ANALOG.index("flow_compressor")
_PRESSURES = [ANALOG.index(f"pressure_{each}") for each in BUFFERS]
_INLETS = [SENSORS.index(valve) for valve in VALVES[: len(BUFFERS)]]


class PowerCurve(NamedTuple):
    """A compressor's flow and power against a pressure, as its station's file says them."""

    pressure: NDArray[np.float64]  # [bar], in order
    flow: NDArray[np.float64]  # [g/s]
    power: NDArray[np.float64]  # electric [kW]


def with_flow_of_power(frames: Frames, curve: PowerCurve | None) -> Frames:
    """Seconds with a flow out of the compressor where its power was read and no flow was.

    A second in which an inlet, or the pressure of a bank that is filled, is not told stays as it is; so do all of them
    without a curve: of the thesis's compressor, which takes the same power whatever it gives.
    """
    if curve is None:
        return frames
    values = frames.values
    inlets = values[:, _INLETS]
    unread = np.isnan(values[:, _FLOW]) & np.isfinite(values[:, SENSORS.index(POWER)]) & np.isfinite(inlets).all(axis=1)
    if not unread.any():
        return frames
    opened, pressure = inlets[unread] > 0.5, values[unread][:, _PRESSURES]
    expected = [np.where(opened, np.interp(pressure, curve.pressure, each), 0.0) for each in (curve.flow, curve.power)]
    flow, power = (each.sum(axis=1) for each in expected)  # NaN where the pressure of an open bank is
    with np.errstate(divide="ignore", invalid="ignore"):
        told = values[unread, SENSORS.index(POWER)] * np.where(power > 0.0, flow / power, np.nan)
    values, noise = values.copy(), frames.noise.copy()
    values[unread, _FLOW], noise[unread, _FLOW] = told, NOISE["flow"]
    return replace(frames, values=values, noise=noise)
