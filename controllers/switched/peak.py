"""The quarter's mean power, which a demand charge is paid on: when the compressor stays off for its sake."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from station.compiled import kernel
from station.controller import Observation
from station.geometry import INLETS, OUTLETS
from station.tariff import DAY, QUARTER

METER_SIZE = 4
"""Entries of memory `watch_meter` uses: whether it has begun, the meter's reading [kWh], the quarter, the reading at
its begin."""

_BEGUN, _READING, _QUARTER, _AT_BEGIN = range(METER_SIZE)

QUARTERS = int(DAY / QUARTER)
"""Of a day."""

EMPTY_FACTOR = 2.0
"""On the peak where the banks are empty."""

RUN = 180.0
"""A compressor that has stopped starts where the quarter leaves room for so long [s]."""

HOUR = 3600.0
"""[s]"""


class Peak(NamedTuple):
    """The limits that the compressor heeds on the quarter's mean power."""

    most: float  # the mean that it does not pass [kW]; infinite: it heeds nothing
    compressor: float  # power of those that run together [kW]
    precooler: float  # while it dispenses [kW]
    reserve: float  # what precooling takes in a quarter with a fill [kWh]
    enough: float  # pressure from which a bank ends a usual fill [bar]
    empty: float  # mean pressure of the banks below which fills are slow [bar]
    scarce: float  # mean pressure below which banks hold little above their least pressures; 0: have none [bar]
    above: float  # by how much a bank exceeds the pressure at which a fill ends, to end it [bar]


UNHEEDED = Peak(np.inf, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
"""Nothing bars the compressor."""

SHARES = len(Peak._fields)
"""Where the share of `most` that is heeded in each quarter of the day begins in the entries of the settings."""

PEAK_SIZE = SHARES + QUARTERS


@kernel
def peak_in(entries: np.ndarray) -> Peak:
    """The peak in PEAK_SIZE entries of the settings."""
    return Peak(entries[0], entries[1], entries[2], entries[3], entries[4], entries[5], entries[6], entries[7])


@kernel
def watch_meter(observation: Observation, peak: Peak, memory: np.ndarray) -> None:
    """Read the meter; a station without one is reckoned by its powers and the command in force.

    `memory` (METER_SIZE,) belongs to this function and to `is_barred`.
    """
    if observation.energy >= 0.0:
        memory[_READING] = observation.energy
    elif observation.previous != 0:
        inlets, outlets = observation.previous & INLETS, observation.previous & OUTLETS
        power = (peak.compressor if inlets != 0 else 0.0) + (peak.precooler if outlets != 0 else 0.0)
        memory[_READING] += power * observation.period / HOUR
    quarter = observation.time // QUARTER
    if memory[_BEGUN] == 0.0 or quarter != memory[_QUARTER]:
        memory[_BEGUN], memory[_QUARTER], memory[_AT_BEGIN] = 1.0, quarter, memory[_READING]


@kernel
def is_barred(observation: Observation, entries: np.ndarray, memory: np.ndarray) -> bool:
    """Whether the compressor stays off, lest the quarter's mean pass the peak.

    What precooling takes is set aside for the rest of the quarter, and before a start what RUN takes. The peak is less
    where energy is dear, and more where the banks are empty, for fills would be slow. Where somebody waits, or no bank
    can end the fill of the vehicle connected or of a usual one, or all hold little above their least pressures, nothing
    is barred. `entries` (PEAK_SIZE,) are of the settings, `memory` is that of `watch_meter`.
    """
    peak, p = peak_in(entries), observation.pressure
    enough = peak.enough
    if observation.vehicle >= 0 and observation.finish_pressure > 0.0:
        enough = max(enough, observation.finish_pressure + peak.above)
    if max(p[0], p[1], p[2]) < enough or observation.queue_length > 0:
        return False
    mean = (p[0] + p[1] + p[2]) / 3.0
    if mean < peak.scarce:
        return False
    if mean < peak.empty:
        most = EMPTY_FACTOR * peak.most
    else:
        most = peak.most * entries[SHARES + int(memory[_QUARTER]) % QUARTERS]
    left = QUARTER * (memory[_QUARTER] + 1.0) - observation.time
    run = observation.period if observation.previous & INLETS != 0 else RUN
    ahead = peak.reserve * left / QUARTER + peak.compressor * min(run, left) / HOUR
    return bool(memory[_READING] - memory[_AT_BEGIN] + ahead > most * QUARTER / HOUR)
