"""One stage of the horizon on a state kept in an array: what the searches before the last two stages step with."""

from __future__ import annotations

import numpy as np

from controllers.minlp.objective import buffer_cost, energy_cost, vehicle_cost
from controllers.minlp.pair import Search, Tanks, buffer_after, drawn, vehicle_after
from station.compiled import uncounted
from station.geometry import VEHICLE

STATE = 12
"""Entries of a state: mass, temperature and pressure of high, medium, low and vehicle."""


@uncounted
def tanks(state: np.ndarray, offset: int) -> Tanks:
    """Masses (offset 0), temperatures (4) or pressures (8) of a state."""
    return state[offset], state[offset + 1], state[offset + 2], state[offset + 3]


@uncounted
def stage(state: np.ndarray, command: int, search: Search, after: np.ndarray) -> float:
    """Write the state after one stage into `after` (12,); return the stage's cost."""
    objective = search.objective
    vehicle_pressure = state[8 + VEHICLE]
    inlets, outlets, flow = 0.0, 0.0, 0.0
    cost = 0.0
    for buffer in range(3):
        action, given = 0, 0.0
        if command >> buffer & 1:
            action = 1
            inlets += 1.0
        elif command >> (3 + buffer) & 1:
            action = 2
            outlets += 1.0
            given = drawn(state[8 + buffer], state[VEHICLE], state[4 + VEHICLE], vehicle_pressure, search)
            flow += given
        m, t, p = buffer_after(buffer, action, state[buffer], state[4 + buffer], state[8 + buffer], given, search)
        after[buffer], after[4 + buffer], after[8 + buffer] = m, t, p
        cost += buffer_cost(p, objective)
    if search.vehicle:
        m, t, p = vehicle_after(flow, outlets, state[VEHICLE], state[4 + VEHICLE], search)
        after[VEHICLE], after[4 + VEHICLE], after[8 + VEHICLE] = m, t, p
        cost += vehicle_cost(p, objective)
    return cost + energy_cost(inlets, outlets, objective)
