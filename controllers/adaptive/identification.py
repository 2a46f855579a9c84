"""Constants of the running plant from its readings: what the errors admit of each, and the estimate inside.

A window is a time in which a buffer is filled or rests, or gives or rests, or the stay of a vehicle. Over a window the
mass changes by a flow coefficient times the sum of pressure differences, Eqs (7.1) and (7.6), and the temperature by a
heat rate times the seconds open plus c_Tn times the sum of differences to the ambient temperature, Eqs (7.4) and (7.9):
each is a line in what is unknown.

The set is an interval a constant: whatever errors within their half-widths, the change from the window's first reading
to the present one admits no other value. The estimate is the line of least squares through all readings of a window,
each window with a level of its own, pooled over windows and with the station's figure as one observation more; then it
is moved into the interval. So no difference of two readings a second apart decides anything on its own, and a constant
error of a sensor cancels.
"""

from __future__ import annotations

import math

import numpy as np

from controllers.adaptive.estimates import estimate_constants
from controllers.adaptive.memory import (
    ENTRIES,
    ERROR,
    FLAGGED,
    PRESSURE,
    SEEN,
    TEMPERATURE,
    TIME,
    WINDOWS,
    restart,
)
from controllers.adaptive.windows import MODE, NONE, learn_buffer, learn_vehicle
from station.compiled import inlined, kernel
from station.controller import Observation
from station.geometry import VEHICLE
from station.planning import Model


@inlined
def _finite(observation: Observation) -> bool:
    """Whether every reading is a number."""
    total = 0.0
    for buffer in range(3):
        total += observation.pressure[buffer] + observation.temperature[buffer]
    if observation.communication and observation.vehicle >= 0:
        total += observation.vehicle_pressure + observation.vehicle_temperature + observation.vehicle_volume
    return math.isfinite(total)


@kernel
def learn(observation: Observation, model: Model, memory: np.ndarray) -> None:
    """Take in the readings of this second and the command of the one before; `memory` (IDENTIFICATION_SIZE,).

    Buffer volumes come from `model`. Readings that do not follow on those before, a second earlier, and readings after
    one that is no number begin every window anew; readings no constant can explain begin the whole identification
    anew, and are flagged with their number and time: the plant has changed, or errors exceed their half-widths.
    Readings whose errors are infinite tell nothing.
    """
    if math.isinf(memory[ERROR]):
        return
    usable = _finite(observation)
    if usable and observation.time - memory[TIME] == observation.period:
        consistent = learn_vehicle(observation, memory)
        for buffer in range(3):
            consistent = learn_buffer(buffer, observation, model, memory) and consistent
        if not consistent:
            memory[FLAGGED] += 1.0
            memory[FLAGGED + 1] = observation.time
            restart(memory)
        estimate_constants(memory)
    else:
        for tank in range(4):
            memory[WINDOWS + tank * ENTRIES + MODE] = NONE
    memory[TIME] = observation.time if usable else math.nan
    reports = observation.communication and observation.vehicle >= 0
    memory[SEEN] = observation.vehicle if reports else -1.0
    for buffer in range(3):
        memory[PRESSURE + buffer] = observation.pressure[buffer]
        memory[TEMPERATURE + buffer] = observation.temperature[buffer]
    memory[PRESSURE + VEHICLE] = observation.vehicle_pressure if reports else math.nan
    memory[TEMPERATURE + VEHICLE] = observation.vehicle_temperature if reports else math.nan
