"""The exact minimum over the last two stages of the horizon, by tables.

After one stage a buffer has one of three states (closed, filled, dispensing) and the vehicle one of four
(idle, or filled from a buffer), whatever the other valves did. So the costs of the second stage are tabulated
over these states, and a pair of commands is a sum of table entries: 169 pairs cost some fifty evaluations of the
plant. Horizon t = 1 is exactly this; longer horizons search the stages before it (see exact.py).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from controllers.estimate import ESTIMATE_SIZE
from controllers.minlp.objective import Objective, buffer_cost, energy_cost, vehicle_cost
from station.compiled import inlined, uncounted
from station.geometry import VEHICLE
from station.planning import Model, gas_pressure, inlet_flow, most_dispensed, vehicle_temperature
from station.plants.thesis import buffer_temperature, next_mass, outlet_flow
from station.valves import admitted_valves, inlet_limit, outlet_limit

# Entries of the settings vector every kernel of the exact engine reads: five of Objective, then these.
HORIZON, NODE_LIMIT, LIVENESS, COMMANDS = 5, 6, 7, 8

PAIR_END = ESTIMATE_SIZE + 74 + 36
"""End of the part of memory that `best_pair` uses as scratch."""

Tanks = tuple[float, float, float, float]
"""One figure of high, medium, low and vehicle."""

_IDLE, _FILL, _DISPENSE = 0, 1, 2

# Offsets into memory, behind the estimate: by buffer and action (3 x 3), or by vehicle state (4).
_MASS, _TEMP, _PRES, _TERM = (ESTIMATE_SIZE + 9 * n for n in range(4))  # buffers after the first stage
_CLOSED, _GAIN = ESTIMATE_SIZE + 36, ESTIMATE_SIZE + 45  # second stage: cost while closed, what filling adds to it
_V_MASS, _V_TEMP, _V_PRES, _V_TERM, _V_CLOSED = (ESTIMATE_SIZE + 54 + 4 * n for n in range(5))  # the vehicle likewise
_OPEN = ESTIMATE_SIZE + 74  # what dispensing in the second stage adds, by vehicle state, buffer and action


class Search(NamedTuple):
    """Constants of one decision."""

    model: Model
    objective: Objective
    vehicle: bool  # whether one is connected
    volume: float  # its tank [m3]
    period: float  # of a stage [s]
    closed: int  # valves that the station keeps closed in the first stage, as bits of Valve


@inlined
def later(search: Search) -> Search:
    """The constants of the stages after the first."""
    return Search(search.model, search.objective, search.vehicle, search.volume, search.period, 0)


@uncounted
def drawn(pressure: float, mass: float, temperature: float, vehicle_pressure: float, search: Search) -> float:
    """Flow [g/s] from a buffer at `pressure` [bar] into the vehicle, of which the rest tells."""
    flow = outlet_flow(pressure, vehicle_pressure, search.model)
    most = most_dispensed(mass, temperature, vehicle_pressure, search.volume, search.model, search.period)
    return min(flow, most)


@uncounted
def buffer_after(
    buffer: int, action: int, mass: float, temperature: float, pressure: float, outflow: float, search: Search
) -> tuple[float, float, float]:
    """Mass, temperature and pressure of a buffer after a stage closed (0), filled (1) or dispensing (2) `outflow`."""
    model = search.model
    inflow = inlet_flow(pressure, model) if action == _FILL else 0.0
    filled = 1.0 if action == _FILL else 0.0
    dispensed = 1.0 if action == _DISPENSE else 0.0
    mass = next_mass(mass, inflow, outflow, search.period)
    temperature = buffer_temperature(buffer, temperature, filled, dispensed, model, search.period)
    return mass, temperature, gas_pressure(mass, temperature, model.buffer_volume[buffer], model)


@uncounted
def vehicle_after(
    flow: float, outlets: float, mass: float, temperature: float, search: Search
) -> tuple[float, float, float]:
    """Mass, temperature and pressure of the vehicle after a stage at `flow` [g/s] from `outlets` outlets."""
    model, volume = search.model, search.volume
    temperature = vehicle_temperature(temperature, outlets, mass, flow, volume, model, search.period)
    mass = next_mass(mass, flow, 0.0, search.period)
    return mass, temperature, gas_pressure(mass, temperature, volume, model)


@uncounted
def admitted(pressure: Tanks, temperature: Tanks, previous: int, search: Search) -> int:
    """The valves that no limit on the state forbids and the station does not keep closed, as bits of Valve."""
    found = admitted_valves(pressure, temperature, search.vehicle, previous, search.model, search.period)
    return found & ~search.closed


@inlined
def _tabulate_buffers(
    mass: Tanks, temperature: Tanks, pressure: Tanks, allowed: int, search: Search,
    work: np.ndarray,
) -> None:  # fmt: skip
    """Buffers after the first stage, and the second stage's costs that do not depend on the vehicle."""
    objective = search.objective
    priced = objective.buffers != 0.0
    for buffer in range(3):
        for action in range(3):
            entry = 3 * buffer + action
            if (action == _FILL and not allowed >> buffer & 1) or (
                action == _DISPENSE and not allowed >> (3 + buffer) & 1
            ):
                continue
            flow = 0.0
            if action == _DISPENSE:
                flow = drawn(pressure[buffer], mass[VEHICLE], temperature[VEHICLE], pressure[VEHICLE], search)
            m, t, p = buffer_after(buffer, action, mass[buffer], temperature[buffer], pressure[buffer], flow, search)
            work[_MASS + entry], work[_TEMP + entry], work[_PRES + entry] = m, t, p
            open_before = action == _FILL
            may_fill = inlet_limit(buffer, p, t, open_before, True, search.model, search.period) == 0
            filling = energy_cost(1.0, 0.0, objective)
            if priced:
                work[_TERM + entry] = buffer_cost(p, objective)
                closed = buffer_cost(buffer_after(buffer, _IDLE, m, t, p, 0.0, search)[2], objective)
                work[_CLOSED + entry] = closed
                if may_fill:
                    filling += buffer_cost(buffer_after(buffer, _FILL, m, t, p, 0.0, search)[2], objective) - closed
            else:
                work[_TERM + entry] = 0.0
                work[_CLOSED + entry] = 0.0
            work[_GAIN + entry] = filling if may_fill else np.inf


@inlined
def _tabulate_vehicle(
    mass: Tanks, temperature: Tanks, pressure: Tanks, allowed: int, search: Search,
    work: np.ndarray,
) -> None:  # fmt: skip
    """The vehicle after the first stage, idle (0) or filled from buffer b (b + 1), and idle after the second."""
    for state in range(4):
        if state > 0 and not allowed >> (2 + state) & 1:
            continue
        flow = 0.0
        if state > 0:
            flow = drawn(pressure[state - 1], mass[VEHICLE], temperature[VEHICLE], pressure[VEHICLE], search)
        m, t, p = vehicle_after(flow, 1.0 if state > 0 else 0.0, mass[VEHICLE], temperature[VEHICLE], search)
        work[_V_MASS + state], work[_V_TEMP + state], work[_V_PRES + state] = m, t, p
        work[_V_TERM + state] = vehicle_cost(p, search.objective)
        work[_V_CLOSED + state] = vehicle_cost(vehicle_after(0.0, 0.0, m, t, search)[2], search.objective)


@inlined
def _opening(state: int, buffer: int, action: int, search: Search, work: np.ndarray) -> float:
    """What opening this outlet in the second stage adds to the cost of a closed stage; inf if not allowed."""
    objective = search.objective
    entry = 3 * buffer + action
    vehicle_pressure = work[_V_PRES + state]
    vehicle_temp = work[_V_TEMP + state]
    pressure = work[_PRES + entry]
    if (
        outlet_limit(
            buffer, pressure, work[_TEMP + entry], True, vehicle_pressure, vehicle_temp, search.model, search.period
        )
        != 0
    ):
        return np.inf
    flow = drawn(pressure, work[_V_MASS + state], vehicle_temp, vehicle_pressure, search)
    filled = vehicle_after(flow, 1.0, work[_V_MASS + state], vehicle_temp, search)[2]
    added = energy_cost(0.0, 1.0, objective) + vehicle_cost(filled, objective) - work[_V_CLOSED + state]
    if objective.buffers != 0.0:
        after = buffer_after(buffer, _DISPENSE, work[_MASS + entry], work[_TEMP + entry], pressure, flow, search)[2]
        added += buffer_cost(after, objective) - work[_CLOSED + entry]
    return added


@inlined
def _best_filling(high: int, medium: int, low: int, outlet: int, compressors: int, work: np.ndarray) -> float:
    """The most negative sum of fillings of the second stage, not of the buffer `outlet`."""
    a = work[_GAIN + high] if outlet != 0 else 0.0
    b = work[_GAIN + 3 + medium] if outlet != 1 else 0.0
    c = work[_GAIN + 6 + low] if outlet != 2 else 0.0
    if compressors == 1:
        return min(0.0, a, b, c)
    a, b, c = min(a, 0.0), min(b, 0.0), min(c, 0.0)
    if compressors == 2:
        return a + b + c - max(a, b, c)
    return a + b + c


@inlined
def _second_stage(
    state: int, high: int, medium: int, low: int, compressors: int, search: Search, work: np.ndarray
) -> float:
    """The least cost of the second stage after these actions of the first."""
    closed = work[_CLOSED + high] + work[_CLOSED + 3 + medium] + work[_CLOSED + 6 + low]
    least = _best_filling(high, medium, low, -1, compressors, work)
    if not search.vehicle:
        return closed + least
    closed += work[_V_CLOSED + state]
    for buffer in range(3):
        action = high if buffer == 0 else (medium if buffer == 1 else low)
        opening = _OPEN + 9 * state + 3 * buffer + action
        if np.isnan(work[opening]):
            work[opening] = _opening(state, buffer, action, search, work)
        least = min(least, work[opening] + _best_filling(high, medium, low, buffer, compressors, work))
    return closed + least


@uncounted
def best_pair(
    mass: Tanks,
    temperature: Tanks,
    pressure: Tanks,
    previous: int,
    settings: np.ndarray,
    search: Search,
    work: np.ndarray,
) -> tuple[float, int]:
    """The least cost of two stages from a state, and the first command that reaches it.

    `settings` holds the commands Eqs (7.17)-(7.19) admit, those with the compressor off first, so that among equal
    costs it stays off; `work` is the controller's memory.
    """
    objective = search.objective
    allowed = admitted(pressure, temperature, previous, search)
    _tabulate_buffers(mass, temperature, pressure, allowed, search, work)
    if search.vehicle:
        _tabulate_vehicle(mass, temperature, pressure, allowed, search, work)
        for entry in range(4 * 9):
            work[_OPEN + entry] = np.nan
    compressors = search.model.compressor_count
    best, best_command = np.inf, 0
    for entry in range(COMMANDS, settings.size):
        command = int(settings[entry])
        if command & ~allowed:
            continue
        state = 0
        for buffer in range(3):
            if command >> (3 + buffer) & 1:
                state = buffer + 1
        inlets = (command & 1) + (command >> 1 & 1) + (command >> 2 & 1)
        high = _DISPENSE if state == 1 else command & 1
        medium = _DISPENSE if state == 2 else command >> 1 & 1
        low = _DISPENSE if state == 3 else command >> 2 & 1
        cost = energy_cost(inlets, 1.0 if state > 0 else 0.0, objective)
        cost += work[_TERM + high] + work[_TERM + 3 + medium] + work[_TERM + 6 + low]
        if search.vehicle:
            cost += work[_V_TERM + state]
        cost += _second_stage(state, high, medium, low, compressors, search, work)
        if cost < best:
            best, best_command = cost, command
    return best, best_command
