"""Expectations of vehicles: when they come, by announcements and mean gap, and how much they ask for."""

from __future__ import annotations

import numpy as np

from station.compiled import uncounted
from station.controller import Observation

ARRIVALS_SIZE = 7
"""Entries of memory `watch_arrivals` and `watch_demand` use: vehicles seen, time of the last, mean gap, whether it has
begun; vehicles connected, the last of them, the mean of what they asked for."""

_SEEN, _LAST, _GAP, _BEGUN, _CONNECTED, _NUMBER, _ASKED = range(ARRIVALS_SIZE)

_FORGET = 0.2
"""Least share a new gap has in the mean: five gaps ago counts for a third."""

_OVERDUE = 0.25
"""A vehicle later than expected is expected after this share of a gap; the gap is at least what has passed."""


@uncounted
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


@uncounted
def mean_gap(memory: np.ndarray) -> float:
    """Mean gap between the vehicles seen [s], by the memory of `watch_arrivals`."""
    return float(memory[_GAP])


@uncounted
def vehicles_seen(memory: np.ndarray) -> float:
    """How many vehicles have come, by the memory of `watch_arrivals`."""
    return float(memory[_SEEN])


@uncounted
def watch_demand(observation: Observation, usual: float, usual_finish: float, memory: np.ndarray) -> None:
    """Note what the vehicle connected asks for: volume times rise of pressure, `usual` for the usual one [m3 bar].

    It leaves at `usual_finish` [bar] unless it says otherwise. `memory` (ARRIVALS_SIZE,) is that of `watch_arrivals`;
    the usual vehicle counts as one seen.
    """
    if memory[_CONNECTED] == 0.0:
        memory[_CONNECTED], memory[_NUMBER], memory[_ASKED] = 1.0, -1.0, 1.0
    if observation.vehicle < 0 or observation.vehicle == memory[_NUMBER]:
        return
    finish = observation.finish_pressure if observation.finish_pressure > 0.0 else usual_finish
    rise = max(finish - observation.vehicle_pressure, 0.0)
    asked = observation.vehicle_volume * rise / usual
    memory[_NUMBER] = observation.vehicle
    memory[_CONNECTED] += 1.0
    if asked > 0.0:
        memory[_ASKED] += max(_FORGET, 1.0 / memory[_CONNECTED]) * (asked - memory[_ASKED])


@uncounted
def mean_demand(memory: np.ndarray) -> float:
    """Mean of what vehicles have asked for by what the usual one does, by the memory of `watch_demand`."""
    return float(memory[_ASKED])


@uncounted
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
