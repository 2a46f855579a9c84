"""Leaks of a second: gas that buffers lose, and that closed outlets give to the vehicle. A kernel for every caller."""

from __future__ import annotations

import numpy as np

from station.compiled import inlined
from station.faults.plant import Rates
from station.geometry import OUTLETS, VEHICLE
from station.plants.interface import P, lose, seep
from station.run import CURRENT, DELIVERED, FLOW_DISPENSER, PERIOD, PREVIOUS, ROW, VOLUME, RunParameters
from station.step import possible_part

ATMOSPHERE = 1.01325
"""A buffer at this pressure leaks no more [bar]."""


@inlined
def leak(
    state: np.ndarray, counters: np.ndarray, vehicles: np.ndarray, values: np.ndarray, rates: Rates,
    parameters: RunParameters,
) -> None:  # fmt: skip
    """Take out of the buffers what leaks [g/s] in the second that is over.

    What the line loses is taken from the buffers whose outlets were open, in equal parts. What flows through closed
    outlets is given to the vehicle connected, while its pressure is below the buffer's, and recorded as dispensed.
    """
    opened = counters[PREVIOUS] & ~parameters.stuck_closed
    if counters[CURRENT] >= 0:
        opened |= possible_part(parameters.stuck_open & OUTLETS, state, True, parameters.plant)
    outlets = (opened >> 3 & 1) + (opened >> 4 & 1) + (opened >> 5 & 1)
    for buffer in range(3):
        rate = rates[buffer] + (rates[3] / outlets if opened >> 3 + buffer & 1 else 0.0)
        if rate > 0.0 and state[P + buffer] > ATMOSPHERE:
            lose(state, buffer, PERIOD * rate, parameters.plant)
    current = counters[CURRENT]
    if current < 0:
        return
    for buffer in range(3):
        rate = rates[4 + buffer]
        if rate > 0.0 and not opened >> 3 + buffer & 1 and state[P + buffer] > state[P + VEHICLE]:
            seep(state, buffer, PERIOD * rate, vehicles[VOLUME, current], parameters.plant)
            vehicles[DELIVERED, current] += PERIOD * rate
            values[FLOW_DISPENSER, counters[ROW] - 1] += rate
