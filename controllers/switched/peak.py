"""The quarter's mean power, which a demand charge is paid on: when the compressor stays off for its sake."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from station.compiled import kernel
from station.controller import Observation
from station.geometry import INLETS, OUTLETS
from station.tariff import QUARTER

METER_SIZE = 5
"""Entries of memory `watch_meter` uses: whether it has begun, the meter's reading [kWh], the quarter, the reading at
its begin, the highest mean of a quarter so far [kW]."""

_BEGUN, _READING, _QUARTER, _AT_BEGIN, _HIGHEST = range(METER_SIZE)

PEAK_SIZE = 7
HOUR = 3600.0
"""[s]"""


class Peak(NamedTuple):
    """What the compressor heeds of the quarter's mean power."""

    most: float  # the mean that it does not pass [kW]; infinite: it heeds nothing
    rises: float  # 1 where `most` rises to the highest mean so far and with what the banks lack, else 0
    compressor: float  # power of those that run together [kW]
    precooler: float  # [kW] while it dispenses
    reserve: float  # what precooling a usual fill takes [kWh]
    enough: float  # pressure from which a bank ends a usual fill [bar]
    spare: float  # bar above that, below which `most` rises, where it does


UNHEEDED = Peak(np.inf, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
"""Nothing bars the compressor."""


@kernel
def peak_in(entries: np.ndarray) -> Peak:
    """The peak in PEAK_SIZE entries of the settings."""
    return Peak(entries[0], entries[1], entries[2], entries[3], entries[4], entries[5], entries[6])


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
    mean = (memory[_READING] - memory[_AT_BEGIN]) * HOUR / QUARTER
    memory[_HIGHEST] = max(memory[_HIGHEST], mean)


@kernel
def is_barred(observation: Observation, keep_on: float, peak: Peak, memory: np.ndarray) -> bool:
    """Whether the compressor stays off, lest the quarter's mean pass the peak.

    What precooling a usual fill takes is set aside for the rest of the quarter, and the compressor's energy for the
    `keep_on` seconds that it stays on at least. Where no bank can end the fill of the vehicle connected, or of a usual
    one, somebody would wait, and nothing is barred.
    """
    best = max(observation.pressure[0], observation.pressure[1], observation.pressure[2])
    enough = peak.enough
    if observation.vehicle >= 0 and observation.finish_pressure > 0.0:
        enough = max(enough, observation.finish_pressure)
    if best < enough:
        return False
    most = peak.most
    if peak.rises != 0.0:
        lacking = max(0.0, 1.0 - (best - enough) / peak.spare) if peak.spare > 0.0 else 0.0
        most = max(most + lacking * max(0.0, peak.compressor + peak.precooler - most), memory[_HIGHEST])
    left = QUARTER * (memory[_QUARTER] + 1.0) - observation.time
    ahead = peak.reserve * left / QUARTER + peak.compressor * min(keep_on, left) / HOUR
    return memory[_READING] - memory[_AT_BEGIN] + ahead > most * QUARTER / HOUR
