"""Inputs of alarms from seconds that are followed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from station.alarm_signals import DETECTED, INPUTS
from station.estimation.followed import FollowedSeconds
from station.estimation.interface import SHARED_STATES
from station.geometry import TANKS
from station.sensor_names import DETECTABLE, SENSORS

_READ = {name: SENSORS.index(name) for name in (*(f"pressure_{tank}" for tank in TANKS), "flow_dispenser", "vehicle")}
_ESTIMATED = {name: SHARED_STATES.index(name) for name in (f"temperature_{tank}" for tank in TANKS)}
_FIRST_EVENT = INPUTS.index(DETECTED + DETECTABLE[0])


def inputs_of(found: FollowedSeconds) -> NDArray[np.float64]:
    """Inputs of seconds, (n, len(INPUTS)): pressures as they are read, temperatures as they are estimated."""
    inputs = np.full((len(found), len(INPUTS)), np.nan)
    for name, place in _READ.items():
        inputs[:, INPUTS.index(name)] = found.measured[:, place]
    for name, place in _ESTIMATED.items():
        inputs[:, INPUTS.index(name)] = found.states[:, place]
    inputs[:, INPUTS.index("data_age")] = 0.0
    inputs[:, INPUTS.index("clock_skew")] = np.abs(found.skew)
    inputs[:, _FIRST_EVENT : _FIRST_EVENT + len(DETECTABLE)] = found.lasting
    return inputs
