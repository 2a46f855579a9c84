"""What becomes of a command if the reserve rule takes over after it: the station's own second, until all is told."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from controllers.guarded.settings import Promise
from controllers.reserve import reserve_command
from station.compiled import inlined, kernel
from station.controller import NONE_ANNOUNCED, Observation
from station.plant import KELVIN, VEHICLE, PlantConstants, gas_mass, gas_pressure
from station.second import PERIOD, M, P, T, advance_tanks

TANKS_SIZE = 12
"""Entries of the state of four tanks: pressures [bar], temperatures [deg C], masses [g]."""

LATER = 600.0
"""How long beyond the promise a late fill is followed [s]."""


class Lack(NamedTuple):
    """How far a future falls short of the promise; nothing where it is kept."""

    late: float  # seconds of the fill beyond the promise
    missing: float  # shares of the ready masses that the buffers lack, added up


@kernel
def note_tanks(observation: Observation, vehicle: tuple[float, float], model: PlantConstants, tanks: np.ndarray) -> None:
    """Bring `tanks` (TANKS_SIZE,), as they were expected, to what the readings say.

    A mass that tells the pressure read to the last bit is kept: so a future is what the station will compute.
    """
    for buffer in range(3):
        pressure, temperature = observation.pressure[buffer], observation.temperature[buffer]
        volume = model.buffer_volume[buffer]
        if gas_pressure(tanks[M + buffer], temperature, volume) != pressure:
            tanks[M + buffer] = gas_mass(pressure, temperature, volume)
        tanks[P + buffer], tanks[T + buffer] = pressure, temperature
    if observation.vehicle >= 0:
        volume = observation.vehicle_volume
        if gas_pressure(tanks[M + VEHICLE], vehicle[1], volume) != vehicle[0]:
            tanks[M + VEHICLE] = gas_mass(vehicle[0], vehicle[1], volume)
        tanks[P + VEHICLE], tanks[T + VEHICLE] = vehicle


@inlined
def missing_of(tanks: np.ndarray, promise: Promise, model: PlantConstants) -> float:
    """What the buffers lack of being ready; 0 stays 0 while nobody is connected and the reserve rule fills them."""
    lack = 0.0
    for buffer in range(3):
        least = promise.high if buffer == 0 else (promise.medium if buffer == 1 else promise.low)
        lack += max(least - tanks[M + buffer], 0.0) / least
        temperature = tanks[T + buffer]
        warmed = tanks[P + buffer] * max((model.ambient_temperature + KELVIN) / (temperature + KELVIN), 1.0)
        if temperature < promise.cold or warmed > promise.top:
            lack += 1.0
    return lack


@kernel
def future(
    command: int, since: float, observation: Observation, promise: Promise, model: PlantConstants, rule: np.ndarray,
    shadow: np.ndarray, tanks: np.ndarray,
) -> Lack:  # fmt: skip
    """How far the promise is missed if `command` is given for this second, and the reserve rule decides from then on.

    `since`: when a vehicle last connected [s]. `shadow`: the rule's memory after this second, `tanks`
    (TANKS_SIZE,): the state before it; both are used up.
    """
    connected = observation.vehicle >= 0
    time, finish, volume = observation.time, observation.finish_pressure, observation.vehicle_volume
    left, late_from = time, since + promise.within
    while True:
        advance_tanks(tanks, connected, volume, model, command)
        time += PERIOD
        if connected and tanks[P + VEHICLE] >= finish:
            connected, left = False, time
        if connected:
            if time >= late_from + LATER:
                return Lack(LATER, missing_of(tanks, promise, model))
        else:
            missing = missing_of(tanks, promise, model)
            if missing == 0.0 or observation.queue_length > 0 or time >= since + promise.ready:
                return Lack(max(left - late_from, 0.0) if observation.vehicle >= 0 else 0.0, missing)
        seen = Observation(
            time, PERIOD, (tanks[P], tanks[P + 1], tanks[P + 2]), (tanks[T], tanks[T + 1], tanks[T + 2]),
            observation.vehicle if connected else -1, tanks[P + VEHICLE], tanks[T + VEHICLE], volume, True, 0, command,
            finish, NONE_ANNOUNCED,
        )  # fmt: skip
        command = reserve_command(seen, model, rule, shadow)
