"""A sequence of commands replayed on the plant: what it costs, and whether the limits admit it.

Solvers answer within tolerances and may claim more than they found; what counts is this replay.
"""

from __future__ import annotations

import numpy as np
from numba import types

from controllers.estimate import estimate_vehicle
from controllers.minlp.exact import kept_alive, search_of, start_state
from controllers.minlp.pair import COMMANDS, admitted, later
from controllers.minlp.stages import STATE, stage, tanks
from station.compiled import entry, kernel, numba_type
from station.controller import DECISION, OBSERVATION, PLANT, VECTOR, Decision, Observation
from station.planning import Model

_SEQUENCE = types.int64[::1]
_START = numba_type(((0.0,) * 4,) * 3)


@entry(OBSERVATION(OBSERVATION, PLANT, VECTOR))
def believe(observation: Observation, model: Model, memory: np.ndarray) -> Observation:
    """The observation with the vehicle as the controller believes it to be, as if that had been read.

    What is asked of the result leaves `memory` alone, so a second of a run must pass here once, and first.
    """
    pressure, temperature = estimate_vehicle(observation, model, memory)
    return Observation(
        observation.time, observation.period, observation.pressure, observation.temperature, observation.vehicle,
        pressure, temperature, observation.vehicle_volume, True, observation.queue_length, observation.previous,
        observation.finish_pressure, observation.announced, observation.energy,
        observation.timed,
    )  # fmt: skip


@entry(_START(OBSERVATION, PLANT, VECTOR))
def begin(
    observation: Observation, model: Model, memory: np.ndarray
) -> tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]:
    """Mass [g], temperature [deg C] and pressure [bar] of high, medium, low and vehicle at an observation."""
    return start_state(observation, model, memory)


@entry(types.int64(OBSERVATION, PLANT, VECTOR, VECTOR))
def open_to(observation: Observation, model: Model, settings: np.ndarray, memory: np.ndarray) -> int:
    """The valves that no limit on the state forbids at an observation, as bits of Valve."""
    _, temperature, pressure = start_state(observation, model, memory)
    return admitted(pressure, temperature, observation.previous, search_of(observation, model, settings))


@kernel
def _is_listed(command: int, settings: np.ndarray) -> bool:
    """Whether Eqs (7.17)-(7.19) admit a command."""
    for listed in settings[COMMANDS:]:  # noqa: SIM110  # Numba compiles no generator expressions
        if command == int(listed):
            return True
    return False


@entry(types.float64(OBSERVATION, PLANT, VECTOR, VECTOR, _SEQUENCE))
def evaluate(
    observation: Observation, model: Model, settings: np.ndarray, memory: np.ndarray, commands: np.ndarray
) -> float:
    """The cost (7.24) [bar2] of a sequence of commands from an observation; inf where a limit forbids one.

    `settings` is exact.settings_vector, `memory` exact.memory_vector, `commands` (t + 1,) int64.
    """
    search = search_of(observation, model, settings)
    mass, temperature, pressure = start_state(observation, model, memory)
    states = np.zeros((2, STATE))
    for tank in range(4):
        states[0, tank], states[0, 4 + tank], states[0, 8 + tank] = mass[tank], temperature[tank], pressure[tank]
    previous = observation.previous
    total = 0.0
    for index in range(commands.size):
        state, after = states[index % 2], states[(index + 1) % 2]
        command = commands[index]
        now = search if index == 0 else later(search)
        allowed = admitted(tanks(state, 8), tanks(state, 4), previous, now)
        if command & ~allowed or not _is_listed(command, settings):
            return np.inf
        total += stage(state, command, search, after)
        previous = command
    return total


@entry(DECISION(DECISION, OBSERVATION, PLANT, VECTOR, VECTOR))
def keep_alive(
    decision: Decision, observation: Observation, model: Model, settings: np.ndarray, memory: np.ndarray
) -> Decision:
    """The decision after the liveness rule, the same as the exact engine's."""
    start = start_state(observation, model, memory)
    return kept_alive(decision, start, observation.previous, settings, search_of(observation, model, settings))
