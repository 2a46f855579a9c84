"""A dispenser that is clogged: less flows than the ramp wants, and the area of the outlets is all that can limit it.

The slope of the flow by the area is 0 while the ramp limits the flow, so that a reading far below it says nothing of
the area to an extended filter. It says that the area limits the flow.
"""

from __future__ import annotations

import numpy as np

from station.compiled import uncounted
from station.estimation.real_gas.slopes import believed, copy
from station.estimation.real_gas.states import AIR, COMPRESSOR, DISPENSER, PLANT_STATES, WARMER, Scratch
from station.estimation.scalar_update import take_reading
from station.plants.real_gas.entries import INSIDE, KILO, RealGasConstants, connected_tank, connected_visit
from station.plants.real_gas.layout import Line, RealGasStation, Visit
from station.plants.real_gas.station import advance_some

_LIMITED = 0.1
"""Where the area limits the flow, they are proportional; where the ramp does, hardly anything is left of that [1]."""

_SURE = 2
"""Seconds in a row in which less flows than the ramp wants, and the area limits the flow [1]."""

_STEEP = 1e12  # a ramp that limits nothing [Pa/s]


@uncounted
def _unlimited(s: Scratch, command: int, plant: RealGasConstants) -> float:
    """What would flow to the vehicle if neither ramp nor nozzle limited it [g/s]."""
    vehicle, told = connected_tank(s.state), connected_visit(s.state)
    visit = Visit(told.pressure, told.temperature, _STEEP, np.inf, told.pressure_max, np.inf)
    as_is = believed(plant.station, s.health[AIR], s.health[COMPRESSOR], s.health[DISPENSER], s.health[WARMER])
    line = Line(as_is.line.area, as_is.line.volume, as_is.line.vent, np.inf)
    station = RealGasStation(
        as_is.high, as_is.medium, as_is.low, as_is.compressor, as_is.precooler, line, as_is.ambient, as_is.stride,
        as_is.vehicle_at, as_is.rest_at,
    )  # fmt: skip
    copy(s.state[INSIDE:], s.varied)
    return advance_some(s.varied, vehicle, visit, command, station, 1.0, plant.gas, command >> 3, True)[1] * KILO


@uncounted
def _learn(
    s: Scratch, size: int, command: int, y: float, variance: float, gate: float, plant: RealGasConstants
) -> None:
    """Let a flow that the area limits tell it."""
    possible = _unlimited(s, command, plant)
    slope = possible / s.health[DISPENSER]
    for i in range(size):
        s.column[i] = slope * s.cov[i, DISPENSER]
    spread = variance + slope * s.column[DISPENSER]
    take_reading(s.delta, s.cov, s.column, size, y - possible - slope * s.delta[DISPENSER], spread, gate, True)


@uncounted
def read_area(
    s: Scratch, size: int, command: int, y: float, noise: float, relative: float, gate: float, plant: RealGasConstants
) -> None:
    """Let the meter of the vehicle's flow [g/s] tell the area of the outlets, where the ramp cannot be what limits it.

    The meter's reading is then expected as it is; a single one that is low says nothing.
    """
    expected = s.flow[1]
    unknown = s.unseen[3] + s.unseen[4] + s.unseen[5]
    if size == PLANT_STATES or np.isnan(y) or unknown > 0.0 or expected <= 0.0:
        return
    if s.flow_slopes[1, DISPENSER] > _LIMITED * expected:
        return
    for j in range(size):
        expected += s.flow_slopes[1, j] * s.delta[j]
    spread = noise * noise + (relative * expected) ** 2
    for i in range(size):
        for j in range(size):
            if s.flow_slopes[1, i] != 0.0 and s.flow_slopes[1, j] != 0.0:
                spread += s.flow_slopes[1, i] * s.cov[i, j] * s.flow_slopes[1, j]
    low = y < expected - gate * np.sqrt(spread)
    s.low[0] = s.low[0] + 1.0 if low else 0.0
    if not low:
        return
    if s.low[0] >= _SURE:
        _learn(s, size, command, y, noise * noise + (relative * y) ** 2, gate, plant)
    s.flow[1] = y
    for j in range(size):
        s.flow_slopes[1, j] = 0.0
