"""What a controller expects of arrivals: those announced, then one after each mean gap between those seen."""

from __future__ import annotations

import numpy as np

from station.compiled import kernel
from station.controller import Observation

ARRIVALS_SIZE = 4
"""Entries of memory `watch_arrivals` uses: vehicles seen, time of the last, mean gap, whether it has begun."""

_SEEN, _LAST, _GAP, _BEGUN = range(ARRIVALS_SIZE)

_FORGET = 0.2
"""Least share a new gap has in the mean: five gaps ago counts for a third."""

_OVERDUE = 0.25
"""A vehicle later than expected is expected after this share of a gap; the gap is at least what has passed."""


@kernel
def watch_arrivals(observation: Observation, first_gap: float, memory: np.ndarray) -> None:
    """Note the arrivals this second shows. `first_gap` [s] is believed until two vehicles have come.

    `memory` (ARRIVALS_SIZE,) belongs to this function and to `expected_arrivals`.
    """
    if memory[_BEGUN] == 0.0:
        memory[_SEEN], memory[_LAST], memory[_GAP], memory[_BEGUN] = 0.0, -1.0, first_gap, 1.0
    seen = memory[_SEEN]
    if observation.vehicle >= 0:
        seen = observation.vehicle + 1.0 + observation.queue_length
    if seen <= memory[_SEEN]:
        return
    if memory[_LAST] >= 0.0:
        gap = (observation.time - memory[_LAST]) / (seen - memory[_SEEN])
        memory[_GAP] += max(_FORGET, 1.0 / memory[_SEEN]) * (gap - memory[_GAP])
    memory[_SEEN], memory[_LAST] = seen, observation.time


@kernel
def mean_gap(memory: np.ndarray) -> float:
    """Mean gap between the vehicles seen [s], by the memory of `watch_arrivals`."""
    return float(memory[_GAP])


@kernel
def expected_arrivals(observation: Observation, memory: np.ndarray, due: np.ndarray) -> None:
    """Write into `due` (n,) in how many seconds the next n vehicles are expected, in order."""
    last = 0.0
    place = 0
    for time in observation.announced:
        if time < np.inf and place < due.size:
            last = max(0.0, time - observation.time)
            due[place] = last
            place += 1
    since = observation.time - memory[_LAST] if memory[_LAST] >= 0.0 else 0.0
    gap = max(memory[_GAP], since, observation.period)
    if place == 0:
        last = max(-since, (_OVERDUE - 1.0) * gap)
    for later in range(place, due.size):
        last += gap
        due[later] = last
