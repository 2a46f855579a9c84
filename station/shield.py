"""The shield: the limits of a second, and the command that it makes of a decision."""

from __future__ import annotations

import numpy as np

from station.compiled import inlined
from station.controller import CompiledController, Decision, Observation
from station.geometry import CLOSED, INLETS, OUTLETS
from station.limits import Limit
from station.plants.interface import Constants, P, T, timed_valves
from station.run import PERIOD, REFUSED, RunParameters, kept_closed
from station.sensors import OFF, tightened_limits
from station.valves import ValveLimits, limits_at, refused_limit, shield

_MINIMUM_TIME, _BEGIN = int(Limit.MINIMUM_TIME), int(Limit.BEGIN)


@inlined
def limits_of(state: np.ndarray, connected: bool, previous: int, obeys_hold: bool, plant: Constants) -> ValveLimits:
    """The limit on each valve in the true state."""
    return limits_at(
        (state[P], state[P + 1], state[P + 2], state[P + 3]),
        (state[T], state[T + 1], state[T + 2], state[T + 3]),
        connected,
        previous,
        obeys_hold,
        plant,
        PERIOD,
    )


@inlined
def _or(limit: int, code: int, valve: int, closed: int) -> int:
    """The limit on a valve, or `code` where it is one of `closed` that nothing else forbids."""
    return code if limit == 0 and closed >> valve & 1 else limit


@inlined
def _closing(limits: ValveLimits, closed: int, code: int) -> ValveLimits:
    """The limits, with `code` on the valves in `closed` that none forbids."""
    if closed == 0:
        return limits
    inlet, outlet = limits.inlet, limits.outlet
    return ValveLimits(
        (_or(inlet[0], code, 0, closed), _or(inlet[1], code, 1, closed), _or(inlet[2], code, 2, closed)),
        (_or(outlet[0], code, 3, closed), _or(outlet[1], code, 4, closed), _or(outlet[2], code, 5, closed)),
    )


@inlined
def valve_limits(
    state: np.ndarray, observation: Observation, obeys_hold: bool, parameters: RunParameters
) -> ValveLimits:
    """The limit on each valve: in the true state, or with margins at what the sensors report of it."""
    if parameters.sensors.kind == OFF:
        found = limits_of(state, observation.vehicle >= 0, observation.previous, obeys_hold, parameters.plant)
        found = _closing(found, timed_valves(state, parameters.plant)[1], _MINIMUM_TIME)
    else:
        found = tightened_limits(state, observation, obeys_hold, parameters.sensors)
    return _closing(found, kept_closed(observation, parameters), _BEGIN)


@inlined
def _ask_fallback(
    kept: int, refused: int, state: np.ndarray, parameters: RunParameters, observation: Observation,
    fallback: CompiledController,
) -> int:  # fmt: skip
    """`kept` and what the fallback opens beside it on the sides where a valve was refused."""
    asked = (INLETS if refused & INLETS else 0) | (OUTLETS if refused & OUTLETS else 0)
    answer = fallback.decide(observation, fallback.model, fallback.settings, fallback.memory)
    limits = valve_limits(state, observation, fallback.obeys_hold, parameters)
    return shield(answer.command & asked, kept, limits, parameters.plant.compressor_count)[0]


@inlined
def shielded_command(
    state: np.ndarray, decision: Decision, unseen: bool, limits: ValveLimits, parameters: RunParameters,
    observation: Observation, fallback: CompiledController, codes: np.ndarray, row: int,
) -> int:  # fmt: skip
    """The command that the shield makes of a decision; what it refuses is recorded."""
    count = parameters.plant.compressor_count
    kept = shield(timed_valves(state, parameters.plant)[0], CLOSED, limits, count)[0]
    command, refusals = shield(decision.command, kept, limits, count)
    for valve in range(6):
        codes[REFUSED + valve, row] = refused_limit(refusals, valve)
    refused = decision.command & ~command
    if refused != 0:
        command = _ask_fallback(command, refused, state, parameters, observation, fallback)
        if unseen and refused & OUTLETS and command & OUTLETS == 0:  # nobody else knows what the interval admits
            command = shield(OUTLETS, command, limits, count)[0]
    return command
