"""The future of a command after which the reserve rule takes over: the model's seconds, until all is decided."""

from __future__ import annotations

import numpy as np

from controllers.guarded.settings import Promise
from controllers.reserve.rule import reserve_command
from station.compiled import inlined, uncounted
from station.controller import NONE_ANNOUNCED, Observation
from station.geometry import HIGH, KELVIN, MEDIUM, VEHICLE
from station.planning import Model, advance, gas_mass, gas_pressure
from station.plants.interface import M, P, T
from station.run import PERIOD

TANKS_SIZE = 12
"""Entries of the state of four tanks: pressures [bar], temperatures [deg C], masses [g]."""


@uncounted
def note_tanks(observation: Observation, vehicle: tuple[float, float], model: Model, tanks: np.ndarray) -> None:
    """Bring `tanks` (TANKS_SIZE,), as they were expected, to what the readings say.

    A mass that tells the pressure read to the last bit is kept: so a future is what the station will compute.
    """
    for buffer in range(3):
        pressure, temperature = observation.pressure[buffer], observation.temperature[buffer]
        volume = model.buffer_volume[buffer]
        if gas_pressure(tanks[M + buffer], temperature, volume, model) != pressure:
            tanks[M + buffer] = gas_mass(pressure, temperature, volume, model)
        tanks[P + buffer], tanks[T + buffer] = pressure, temperature
    if observation.vehicle >= 0:
        volume = observation.vehicle_volume
        if gas_pressure(tanks[M + VEHICLE], vehicle[1], volume, model) != vehicle[0]:
            tanks[M + VEHICLE] = gas_mass(vehicle[0], vehicle[1], volume, model)
        tanks[P + VEHICLE], tanks[T + VEHICLE] = vehicle


@inlined
def are_ready(tanks: np.ndarray, promise: Promise, model: Model) -> bool:
    """Whether all buffers are ready. They stay so while nobody is connected and the reserve rule fills them."""
    ready = True
    for buffer in range(3):
        least = promise.high if buffer == HIGH else (promise.medium if buffer == MEDIUM else promise.low)
        temperature = tanks[T + buffer]
        warmed = tanks[P + buffer] * max((model.ambient_temperature + KELVIN) / (temperature + KELVIN), 1.0)
        bearable = promise.cold <= temperature <= model.limits.buffer_temperature_max
        ready = ready and tanks[M + buffer] >= least and bearable and warmed <= promise.top
    return ready


@uncounted
def keeps(
    command: int, since: float, observation: Observation, promise: Promise, model: Model, rule: np.ndarray,
    shadow: np.ndarray, tanks: np.ndarray,
) -> bool:  # fmt: skip
    """Whether the promise is kept if `command` is given for this second, and the reserve rule decides from then on.

    `since`: when a vehicle last connected [s]. `shadow`: the rule's memory after this second, `tanks`
    (TANKS_SIZE,): the state before it; both are used up. With a vehicle waiting, buffers are to be ready when the
    one connected leaves.
    """
    connected = observation.vehicle >= 0
    time, finish, volume = observation.time, observation.finish_pressure, observation.vehicle_volume
    while True:
        advance(tanks, volume if connected else 0.0, command, PERIOD, model)
        time += PERIOD
        if connected and tanks[P + VEHICLE] >= finish:
            connected = False
        if connected:
            if time >= since + promise.within:
                return False
        elif are_ready(tanks, promise, model):
            return True
        elif observation.queue_length > 0 or time >= since + promise.ready:
            return False
        seen = Observation(
            time, PERIOD, (tanks[P], tanks[P + 1], tanks[P + 2]), (tanks[T], tanks[T + 1], tanks[T + 2]),
            observation.vehicle if connected else -1, tanks[P + VEHICLE], tanks[T + VEHICLE], volume, True, 0, command,
            finish, NONE_ANNOUNCED, np.nan, (0, 0),
        )  # fmt: skip
        command = reserve_command(seen, model, rule, shadow)
