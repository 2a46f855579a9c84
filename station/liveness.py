"""Liveness of the slot: logic stands in for a controller that has given a connected vehicle nothing for too long."""

from __future__ import annotations

import numpy as np

from station.compiled import inlined
from station.controller import CompiledController, Observation
from station.geometry import CLOSED, INLETS, LOW, OUTLETS, VEHICLE, Valve
from station.limits import Limit, flow_margin, gap_margin, least_pressure_margin
from station.plants.interface import Constants, P
from station.run import DRY, NEAREST, PERIOD, STALLED, RunParameters
from station.shield import valve_limits
from station.starts import full_low
from station.valves import ValveLimits, shield

STEP = 1.0
"""A fill to which nothing can be given gets nearer to going on when a buffer has come so much nearer to it [bar]."""

RELEASE = 60.0
"""A controller that logic stands in for decides alone again when it has given gas for so long [s]."""

_INLET_LOW = int(Valve.INLET_LOW)
_FLOW, _GAP, _LEAST_PRESSURE = int(Limit.FLOW), int(Limit.GAP), int(Limit.LEAST_PRESSURE)


@inlined
def _could_give(limits: ValveLimits) -> bool:
    """Whether some outlet may open."""
    return limits.outlet[0] == 0 or limits.outlet[1] == 0 or limits.outlet[2] == 0


@inlined
def _fullest(wanted: tuple[bool, bool, bool], pressure: tuple[float, float, float]) -> int:
    """The buffer of the highest pressure among those `wanted`, or -1."""
    found = -1
    for buffer in range(3):
        if wanted[buffer] and (found < 0 or pressure[buffer] > pressure[found]):
            found = buffer
    return found


@inlined
def _may_rise(buffer: int, free: ValveLimits, limits: ValveLimits) -> bool:
    """Whether a buffer is too close to the vehicle, or to its least pressure, and may be filled."""
    too_low = limits.outlet[buffer] == _GAP or limits.outlet[buffer] == _LEAST_PRESSURE
    return too_low and free.inlet[buffer] == 0


@inlined
def _raised(
    command: int,
    free: ValveLimits,
    limits: ValveLimits,
    pressure: tuple[float, float, float],
    low_full: bool,
    count: int,
) -> int:
    """The inlets that are opened while nothing can be given: the fullest buffer that is too low, and `command`'s.

    One that is too full for the dispenser's greatest flow is not filled: it only has to cool.
    """
    may_low = not low_full and _may_rise(2, free, limits)
    fullest = _fullest((_may_rise(0, free, limits), _may_rise(1, free, limits), may_low), pressure)
    wanted = command & INLETS
    for buffer in range(3):
        if limits.outlet[buffer] == _FLOW:
            wanted &= ~(1 << buffer)
    return shield(wanted, (1 << fullest) if fullest >= 0 else CLOSED, limits, count)[0]


@inlined
def _stand_in(
    command: int, state: np.ndarray, parameters: RunParameters, observation: Observation, limits: ValveLimits,
    fallback: CompiledController,
) -> int:  # fmt: skip
    """`command` with what a vehicle needs that has been given nothing for too long.

    Where gas could be given that is the outlet of the fallback, or else of the fullest buffer that may give; and the
    fallback's inlets where `command` opens none. Where it could not, see `_raised`.
    """
    count = parameters.plant.compressor_count
    free = valve_limits(state, observation, fallback.obeys_hold, parameters)
    low_full = observation.pressure[LOW] >= full_low(parameters.plant)
    if not _could_give(limits):
        return _raised(command, free, limits, observation.pressure, low_full, count)
    answer = fallback.decide(observation, fallback.model, fallback.settings, fallback.memory)
    outlets = shield(answer.command & OUTLETS, CLOSED, limits, count)[0]
    if outlets == CLOSED:
        may = limits.outlet[0] == 0, limits.outlet[1] == 0, limits.outlet[2] == 0
        outlets = 8 << _fullest(may, observation.pressure)
    if command & INLETS:
        return shield(command & INLETS, outlets, limits, count)[0]
    inlets = answer.command & INLETS
    return shield(inlets & ~_INLET_LOW if low_full else inlets, outlets, free, count)[0]


@inlined
def _nearest(state: np.ndarray, plant: Constants) -> float:
    """How far the buffer nearest to giving gas lies within its limits of pressure, negative where outside [bar].

    Eqs (7.11) and (7.12), and its least pressure where it has one.
    """
    found = -np.inf
    for buffer in range(3):
        pressure = state[P + buffer]
        flow = flow_margin(pressure, state[P + VEHICLE], plant) / plant.outlet_coefficient
        least = least_pressure_margin(buffer, pressure, plant)
        found = max(found, min(flow, gap_margin(pressure, state[P + VEHICLE], plant), least))
    return found


@inlined
def _watch(
    state: np.ndarray, own: int, command: int, limits: ValveLimits, parameters: RunParameters
) -> None:  # fmt: skip
    """Count the seconds in which a connected vehicle gets nothing, as through an outlet that sticks.

    `own` is what the controller gave, `command` what is given; `limits` say what could be. Who has once been stood in
    for after `liveness` seconds is so until it has given gas for RELEASE seconds, or the vehicle leaves.
    """
    stalled, liveness, plant = state[STALLED], parameters.liveness, parameters.plant
    giving = OUTLETS & ~parameters.stuck_closed
    if own & giving:
        stalled -= PERIOD
        stalled = stalled if stalled > liveness else 0.0
    elif _could_give(limits) or stalled > liveness:
        stalled = min(stalled + PERIOD, liveness + RELEASE)
    nearest = _nearest(state, plant)
    if command & giving or nearest >= state[NEAREST] + STEP:
        state[DRY], state[NEAREST] = 0.0, nearest
    else:
        state[DRY] += PERIOD
    if stalled <= liveness <= max(stalled, state[DRY]):
        stalled = liveness + RELEASE
    state[STALLED] = stalled


@inlined
def kept_alive(
    own: int, state: np.ndarray, limits: ValveLimits, parameters: RunParameters, observation: Observation,
    fallback: CompiledController,
) -> int:  # fmt: skip
    """Command executed for `own` while a vehicle is connected: logic stands in when it has waited too long."""
    needed = state[STALLED] > parameters.liveness and own & OUTLETS == 0
    command = _stand_in(own, state, parameters, observation, limits, fallback) if needed else own
    _watch(state, own, command, limits, parameters)
    return command
