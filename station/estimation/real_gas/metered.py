"""A fill whose flow cannot be predicted, since nobody told the vehicle's pressure: what the meter reads has flowed.

The second itself is taken with the outlets closed, so that nothing is learned of dispenser and precooler, whose flow
and cold would be laid to a vehicle that was assumed. Where the meter is silent too, the banks' own pressures say what
they gave.
"""

from __future__ import annotations

import numpy as np

from station.compiled import uncounted
from station.estimation.real_gas.states import VEHICLE_ENERGY, VEHICLE_MASS, Scratch
from station.estimation.real_gas.transition import blur, take_back
from station.geometry import VEHICLE
from station.plants.real_gas.entries import INSIDE, KILO, RealGasConstants
from station.plants.real_gas.layout import ALL_BANKS, BANKS
from station.plants.real_gas.tank import ENERGY, MASS

_UNMETERED = 30.0
"""Gas that may flow in a second of which no meter says anything, and that fills the line in a fill's first [g]."""

_SILENT = 0.2
"""By which part the flow may have changed since the meter spoke last [1]."""

_LINE = 0.1
"""By which part what the meter reads of a fill's first second may be other than what the banks gave: the line fills."""

_WARMTH = 2.0
"""By how much the vehicle's gas may be off in a second, whose mass is not known either [K]."""


@uncounted
def give_as_read(
    s: Scratch, command: int, meter: float, noise: float, relative: float, plant: RealGasConstants
) -> None:
    """Let the banks have given in a second, and the vehicle have got, what the meter read [g/s].

    Where it is silent, what it read last of this fill; where it never spoke, nothing, give or take _UNMETERED.
    """
    if command >> BANKS & ALL_BANKS == 0:
        return
    last = s.given[0]
    if not np.isnan(meter):
        s.given[0] = max(meter, 0.0)
        flow, spread = s.given[0], relative * s.given[0] + noise
    elif last >= 0.0:
        flow, spread = last, _SILENT * last + noise
    else:
        flow, spread = 0.0, _UNMETERED
    if last < 0.0:
        spread = _UNMETERED
    enthalpy = take_back(s, command, -flow, spread, plant)
    at = INSIDE + plant.station.vehicle_at
    s.state[at + MASS] += flow / KILO
    s.state[at + ENERGY] += flow / KILO * enthalpy
    blur(s, VEHICLE_MASS, VEHICLE_ENERGY, VEHICLE, spread, _WARMTH)


@uncounted
def give_to_another(
    s: Scratch, command: int, meter: float, noise: float, relative: float, gate: float, plant: RealGasConstants
) -> bool:
    """Let the banks have given what the meter read [g/s] in a second in which nobody told who is connected.

    Where it reads no more than the vehicle that was connected last would get, it may be that one still, and nothing is
    changed. Where it is silent too, and that one would get nothing, the banks have given nothing, give or take
    _UNMETERED. Returns whether another got it.
    """
    expected = s.flow[1]
    if command >> BANKS & ALL_BANKS == 0 or (np.isnan(meter) and expected > 0.0):
        return False
    left, spread = 0.0, _UNMETERED
    if not np.isnan(meter):
        left, spread = expected - meter, _LINE * max(meter, expected) + noise
        if -left <= gate * (relative * expected + noise):
            return False
    take_back(s, command, left, spread, plant)
    return True
