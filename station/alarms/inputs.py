"""Inputs of alarms from seconds that are simulated."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from station.alarm_signals import INPUTS
from station.columns import CODES, COUNTS, VALUES
from station.controller import Status
from station.geometry import TANKS

Floats = NDArray[np.float64]

_ROW = [*VALUES, *CODES, *COUNTS]
_TANKS = slice(_ROW.index(f"pressure_{TANKS[0]}"), _ROW.index(f"temperature_{TANKS[-1]}") + 1)
_FLOW, _VEHICLE, _QUEUE = (_ROW.index(name) for name in ("flow_dispenser", "vehicle", "queue_length"))
_STATUS = _ROW.index("decision_status")
_KNOWN = INPUTS.index("data_age")  # what stands before it is known of a simulated second


class SecondInputs:
    """Inputs of seconds one by one; each overwrites the one before."""

    def __init__(self) -> None:
        self._times, self._inputs = np.zeros(1), np.full((1, len(INPUTS)), np.nan)

    def of(self, row: tuple[float, ...], wait: float, lateness: float, *, incomplete: bool) -> tuple[Floats, Floats]:
        """Time and inputs of a second.

        Parameters
        ----------
        row
            Of the record.
        wait
            How long the first of the queue has waited [s].
        lateness
            By how much the second came late [s].
        incomplete
            Whether a vehicle has left incomplete.
        """
        self._times[0] = row[0]
        missed = row[_STATUS] == Status.FALLBACK
        self._inputs[0, :_KNOWN] = (
            *row[_TANKS], row[_FLOW], row[_VEHICLE], row[_QUEUE], wait, incomplete, missed, lateness,
        )  # fmt: skip
        return self._times, self._inputs


def left_incomplete(left: int, figures: dict[str, float]) -> bool:
    """Whether a vehicle has left in a second, and without what it came for; arguments as of `station.live.Second`."""
    return left >= 0 and math.isnan(figures["finished"])
