"""The exact engine: the optimum of (7.25) by depth-first search with a bound; horizon t = 1 needs no search.

A horizon of t has t + 1 stages, i = 0..t in Eq. (7.24); stage i is priced on the state it leads to. The last two
stages are solved by tables (pair.py), those before are searched in the order of their bounds (bound.py); a search
that takes long is given a good sequence to beat (beam.py).
"""

from __future__ import annotations

import numpy as np

from controllers.estimate import estimate_vehicle
from controllers.minlp.beam import best_by_beam
from controllers.minlp.bound import bound_work, cost_to_go
from controllers.minlp.objective import Objective
from controllers.minlp.pair import (
    COMMANDS,
    HORIZON,
    LIVENESS,
    NODE_LIMIT,
    PAIR_END,
    Search,
    Tanks,
    admitted,
    best_pair,
    later,
)
from controllers.minlp.stages import STATE, stage, tanks
from station.compiled import callback, kernel, uncounted
from station.control_model import ControlModel, as_thesis, is_thesis
from station.controller import DECIDE, Decision, Observation, Status
from station.geometry import OUTLETS
from station.limits import start_limit
from station.planning import Model, gas_mass
from station.valves import commands

_OPTIMAL, _FEASIBLE, _LIVE = int(Status.OPTIMAL), int(Status.FEASIBLE), int(Status.LIVENESS)

BEAM_AFTER = 500.0
"""Nodes after which a search that has not ended looks for a better sequence by beam; t <= 3 needs fewer."""

_CHILDREN = 20  # most commands a stage admits


def settings_vector(
    objective: Objective, horizon: int, node_limit: int, liveness: bool, compressor_count: int
) -> np.ndarray:
    """The settings the compiled engine reads.

    Commands are ordered with fewer inlets first: among equal costs the compressor stays off.
    """
    ordered = sorted(commands(compressor_count), key=lambda command: ((command & 7).bit_count(), command))
    return np.array([*objective, horizon, node_limit, liveness, *ordered], dtype=np.float64)


def memory_vector(horizon: int) -> np.ndarray:
    """Fresh memory for the compiled engine."""
    return np.zeros(PAIR_END + bound_work(horizon) + horizon * (STATE + 2 * _CHILDREN + 1))


@uncounted
def _expand(
    level: int, previous: int, spent: float, horizon: int, settings: np.ndarray, search: Search,
    states: np.ndarray, children: np.ndarray, work: np.ndarray,
) -> None:  # fmt: skip
    """List the commands of a level with cost so far and bound, into children[level] (2, 20)."""
    state = states[level]
    allowed = admitted(tanks(state, 8), tanks(state, 4), previous, search)
    after = states[level + 1]
    for entry in range(_CHILDREN):
        children[level, 1, entry] = np.inf
    for entry in range(settings.size - COMMANDS):
        command = int(settings[COMMANDS + entry])
        if command & ~allowed:
            continue
        cost = spent + stage(state, command, search, after)
        children[level, 0, entry] = cost
        children[level, 1, entry] = cost + cost_to_go(after, horizon - level, search, work)


@kernel
def _least_open(best: float, level: int, children: np.ndarray) -> float:
    """The bound a search leaves behind: no sequence costs less than `best` or the least bound still open."""
    for above in range(level + 1):
        best = min(best, np.min(children[above, 1]))
    return best


@uncounted
def _search(
    start: tuple[Tanks, Tanks, Tanks], previous: int, settings: np.ndarray, search: Search, memory: np.ndarray
) -> tuple[float, float, int]:
    """Least cost, bound on it, and first command; bound < cost where the node limit ended the search.

    `start` is mass, temperature and pressure of the tanks.
    """
    horizon = int(settings[HORIZON])
    if horizon == 1:
        cost, command = best_pair(start[0], start[1], start[2], previous, settings, search, memory)
        return cost, cost, command
    rest = memory[PAIR_END + bound_work(horizon) :]
    work = memory[PAIR_END:]
    states = rest[: horizon * STATE].reshape((horizon, STATE))
    children = rest[horizon * STATE : horizon * (STATE + 2 * _CHILDREN)].reshape((horizon, 2, _CHILDREN))
    chosen = rest[horizon * (STATE + 2 * _CHILDREN) :]
    for tank in range(4):
        states[0, tank], states[0, 4 + tank], states[0, 8 + tank] = start[0][tank], start[1][tank], start[2][tank]
    best, best_command, best_rank = np.inf, 0, _CHILDREN
    nodes = 0.0
    level = 0
    _expand(0, previous, 0.0, horizon, settings, search, states, children, work)
    while level >= 0:
        entry = int(np.argmin(children[level, 1]))
        bound = children[level, 1, entry]
        rank = entry if level == 0 else int(chosen[0])
        if bound > best or (bound == best and rank >= best_rank) or bound == np.inf:
            level -= 1
            continue
        if nodes >= settings[NODE_LIMIT] and best < np.inf:
            break
        if nodes == BEAM_AFTER:
            cost, other, looked_at = best_by_beam(states[0], previous, settings, search, memory, work)
            nodes += looked_at
            if cost < best:
                best, best_rank, best_command = cost, other, int(settings[COMMANDS + other])
        nodes += 1.0
        children[level, 1, entry] = np.inf
        chosen[level] = entry
        command = int(settings[COMMANDS + int(entry)])
        spent = children[level, 0, entry]
        stage(states[level], command, search, states[level + 1])
        if level + 1 < horizon - 1:
            _expand(level + 1, command, spent, horizon, settings, later(search), states, children, work)
            level += 1
            continue
        leaf = states[level + 1]
        cost, _ = best_pair(tanks(leaf, 0), tanks(leaf, 4), tanks(leaf, 8), command, settings, later(search), memory)
        cost += spent
        if cost < best or (cost == best and rank < best_rank):
            best, best_rank = cost, rank
            best_command = int(settings[COMMANDS + int(rank)])
    return best, _least_open(best, level, children), best_command


@uncounted
def _lowest_fillable(pressure: Tanks, allowed: int) -> int:
    """The inlet of the buffer with the lowest pressure among those that may be filled, as a bit, or 0."""
    found = -1
    for buffer in range(3):
        if allowed >> buffer & 1 and (found < 0 or pressure[buffer] < pressure[found]):
            found = buffer
    return 1 << found if found >= 0 else 0


@uncounted
def start_state(observation: Observation, model: Model, memory: np.ndarray) -> tuple[Tanks, Tanks, Tanks]:
    """Mass, temperature and pressure of the tanks as the controller believes them to be."""
    p, t, volume = observation.pressure, observation.temperature, model.buffer_volume
    vehicle_mass, vehicle_pressure, vehicle_temperature = 0.0, 0.0, 0.0
    if observation.vehicle >= 0:
        vehicle_pressure, vehicle_temperature = estimate_vehicle(observation, model, memory)
        vehicle_mass = gas_mass(vehicle_pressure, vehicle_temperature, observation.vehicle_volume, model)
    mass = (
        gas_mass(p[0], t[0], volume[0], model),
        gas_mass(p[1], t[1], volume[1], model),
        gas_mass(p[2], t[2], volume[2], model),
        vehicle_mass,
    )
    return mass, (t[0], t[1], t[2], vehicle_temperature), (p[0], p[1], p[2], vehicle_pressure)


@uncounted
def search_of(observation: Observation, model: Model, settings: np.ndarray) -> Search:
    """Constants of one decision.

    What the slot keeps closed is heeded where a buffer can be too full to begin a fill. Elsewhere it is what minimum
    times keep closed, of which chapter 7 knows nothing: the shield alone keeps these.
    """
    objective = Objective(settings[0], settings[1], settings[2], settings[3], settings[4])
    closed = observation.timed[1] if start_limit(model) < model.compressor_pressure else 0
    return Search(
        model, objective, observation.vehicle >= 0, observation.vehicle_volume, observation.period, closed
    )  # fmt: skip


@uncounted
def kept_alive(
    decision: Decision, start: tuple[Tanks, Tanks, Tanks], previous: int, settings: np.ndarray, search: Search
) -> Decision:
    """The decision; with the liveness rule on, a filling where it would stall a connected vehicle.

    `start` is mass, temperature and pressure of the tanks.
    """
    if search.vehicle and decision.command == 0 and settings[LIVENESS] != 0.0:
        allowed = admitted(start[2], start[1], previous, search)
        inlet = _lowest_fillable(start[2], allowed)
        if allowed & OUTLETS == 0 and inlet != 0:
            return Decision(inlet, _LIVE, decision.cost, decision.bound)
    return decision


@uncounted
def _decide(observation: Observation, model: Model, settings: np.ndarray, memory: np.ndarray) -> Decision:
    search = search_of(observation, model, settings)
    start = start_state(observation, model, memory)
    cost, bound, command = _search(start, observation.previous, settings, search, memory)
    status = _OPTIMAL if bound >= cost else _FEASIBLE
    return kept_alive(Decision(command, status, cost, bound), start, observation.previous, settings, search)


@callback(DECIDE, counted=False)
def decide_exact(observation: Observation, model: ControlModel, settings: np.ndarray, memory: np.ndarray) -> Decision:
    """The optimal command; with the liveness rule on, a filling where the optimum would stall a vehicle."""
    if is_thesis(model):
        return _decide(observation, as_thesis(model), settings, memory)
    return _decide(observation, model, settings, memory)
