"""The reserve rule: made to be certified. High is kept for the end of each fill; low, then medium begin it."""

from __future__ import annotations

import numpy as np

from controllers.estimate import ESTIMATE_SIZE, estimate_vehicle
from controllers.reserve.settings import FULL, GAP, OPEN, RETURNS, SLOT, SPACE, STOP
from station.compiled import inlined, uncounted
from station.controller import Observation
from station.geometry import HIGH, LOW, MEDIUM
from station.limits import least_pressure_margin, least_temperature_margin
from station.planning import Model
from station.plants.interface import emptied_to
from station.valves import inlet_limit, outlet_limit

_VEHICLE, _STAGE, _SINCE, _FREE = range(ESTIMATE_SIZE, ESTIMATE_SIZE + 4)
MEMORY_SIZE = ESTIMATE_SIZE + 4

FIRST, SECOND, WAIT, LAST, AGAIN, IDLE = range(6)
"""Stages of a fill: low dispenses, medium does, the vehicle waits for high, high dispenses, the vehicle waits for it
once more; nobody is filled."""


@inlined
def due(second: float, stage: int, slot: float) -> int:
    """The buffer whose turn it is at the compressor, `second` seconds after the last fill has begun.

    Before high is opened it and one of the others take turns: medium until it dispenses, then low. While the vehicle
    first waits for high, all turns are high's. Once high dispenses, the two others take turns, and while the vehicle
    waits once more high has low's. While nobody is filled each has a third: low odd turns and medium even ones, so
    that they are theirs whether or not the fill is over.
    """
    turn = int(np.floor(second / slot))
    if stage == WAIT:
        return HIGH
    if stage == IDLE:
        place = turn % 6
        return HIGH if place % 3 == 0 else (MEDIUM if place % 2 == 0 else LOW)
    if turn % 2 == 0:
        return HIGH if stage < LAST else MEDIUM
    return MEDIUM if stage == FIRST else (HIGH if stage == AGAIN else LOW)


@inlined
def _is_spent(buffer: int, observation: Observation, model: Model) -> bool:
    """Whether a buffer is below its least pressure or temperature, so that nothing may flow out of it."""
    pressure, temperature = observation.pressure[buffer], observation.temperature[buffer]
    return least_pressure_margin(buffer, pressure, model) < 0.0 or least_temperature_margin(temperature, model) < 0.0


@inlined
def _room(buffer: int, vehicle_pressure: float, observation: Observation, model: Model) -> float:
    """How far a buffer lies above the vehicle, and above its least pressure [bar]."""
    return observation.pressure[buffer] - max(vehicle_pressure, emptied_to(buffer, model))


@inlined
def _stage(
    observation: Observation, vehicle: tuple[float, float], model: Model, settings: np.ndarray,
    memory: np.ndarray,
) -> int:  # fmt: skip
    """The stage of the fill in this second.

    A vehicle goes back to low or medium at stations of real gas alone, while it waits for high.
    """
    pressure = vehicle[0]
    gap = max(settings[GAP], model.limits.outlet_gap_min)
    stage = int(memory[_STAGE])
    while stage < WAIT and (
        observation.pressure[LOW - stage] - pressure < gap or _is_spent(LOW - stage, observation, model)
    ):
        stage += 1
    above = observation.pressure[HIGH] - pressure
    if stage == LAST and (above < model.limits.outlet_gap_min or _is_spent(HIGH, observation, model)):
        return AGAIN
    if stage not in (WAIT, AGAIN):
        return stage
    opens = max(settings[OPEN], gap)
    if _room(HIGH, pressure, observation, model) >= opens or observation.pressure[HIGH] >= settings[FULL]:
        return LAST
    for earlier in range(WAIT if settings[RETURNS] != 0.0 else 0):
        if _room(LOW - earlier, pressure, observation, model) >= opens:
            return earlier
    return stage


@inlined
def _outlet(stage: int, observation: Observation, vehicle: tuple[float, float], model: Model) -> int:
    """The buffer to dispense from, or -1."""
    if stage in (WAIT, AGAIN):
        return -1
    buffer = HIGH if stage == LAST else LOW - stage
    limit = outlet_limit(
        buffer,
        observation.pressure[buffer],
        observation.temperature[buffer],
        True,
        vehicle[0],
        vehicle[1],
        model,
        observation.period,
    )
    return buffer if limit == 0 else -1


@inlined
def _inlet(stage: int, second: float, observation: Observation, model: Model, settings: np.ndarray) -> int:
    """The buffer whose turn it is unless it is full or too warm; or -1.

    Nobody takes another's turn while a vehicle is connected: then what a buffer gets follows from the clock and its
    own state. While nobody is, the next in the order may.
    """
    waits = stage == AGAIN and settings[RETURNS] != 0.0
    first = due(second, WAIT if waits else stage, settings[SLOT])
    for place in range(3 if stage == IDLE else 1):
        buffer = (first + place) % 3
        pressure, temperature = observation.pressure[buffer], observation.temperature[buffer]
        if pressure >= settings[STOP + buffer]:
            continue
        if inlet_limit(buffer, pressure, temperature, True, False, model, observation.period) == 0:
            return buffer
    return -1


@uncounted
def reserve_command(observation: Observation, model: Model, settings: np.ndarray, memory: np.ndarray) -> int:
    """Bits of Valve: at most one outlet and one inlet. `memory` is (MEMORY_SIZE,), `settings` (SETTINGS_SIZE,)."""
    stage, outlet = IDLE, -1
    if observation.vehicle >= 0:
        vehicle = estimate_vehicle(observation, model, memory)
        if memory[_VEHICLE] != observation.vehicle + 1 and observation.time >= memory[_FREE]:
            memory[_VEHICLE], memory[_STAGE], memory[_SINCE] = observation.vehicle + 1, FIRST, observation.time
            memory[_FREE] = observation.time + settings[SPACE]
        if memory[_VEHICLE] == observation.vehicle + 1:
            stage = _stage(observation, vehicle, model, settings, memory)
            memory[_STAGE] = stage
            outlet = _outlet(stage, observation, vehicle, model)
    else:
        memory[_VEHICLE] = 0.0
    inlet = _inlet(stage, observation.time - memory[_SINCE], observation, model, settings)
    return ((8 << outlet) if outlet >= 0 else 0) | ((1 << inlet) if inlet >= 0 else 0)
