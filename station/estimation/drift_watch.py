"""A calibrated station's record with drift taken off what its sensors read."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from station.archives import refuse_other_shapes
from station.estimation.interface import DRIFTING, Drifts, EstimationModel
from station.frames import Frames
from station.parameters import Station
from station.sensor_names import ANALOG, BANK_SENSORS

_CHANNELS = np.array([ANALOG.index(name) for name in BANK_SENSORS])
_METERS = ("flow_compressor", "flow_dispenser")


class DriftWatch:
    """Look for drifting sensors of a calibrated station, and take the drift off what they read.

    Parameters
    ----------
    station : Station
        The station as it was calibrated.
    model : EstimationModel
        Of its plant.
    constants
        Of the plant, as `model.constants_of` gives them.
    """

    def __init__(self, station: Station, model: EstimationModel, constants: Any) -> None:
        self._station, self._model, self._constants = station, model, constants
        self._scratch: Any = None

    def advance(self, frames: Frames, rows: int) -> tuple[Frames, Drifts]:
        """Judge the first `rows` seconds; the frames as they would be without drift, and what was found.

        The first call's frames must hold the first minute; see `EstimationModel`. Without both meters nothing is
        judged, since what flows is not known.
        """
        if not set(_METERS) <= set(frames.measured):
            return frames, Drifts.of_nothing()
        if self._scratch is None:
            self._scratch = self._model.begin(frames, self._station, DRIFTING, self._constants)
        followed = self._model.advance(frames, rows, self._scratch, self._station, DRIFTING, self._constants)
        biases, begins, lasts, taken, falls = np.split(followed.states, len(BANK_SENSORS) * np.arange(1, 5), axis=1)
        values = frames.values.copy()
        values[:rows, _CHANNELS] -= taken
        return replace(frames, values=values), Drifts(biases, begins, lasts, falls)

    def snapshot(self) -> dict[str, np.ndarray]:
        """Everything needed to go on, as arrays; none before the first second."""
        return {} if self._scratch is None else dict(self._scratch._asdict())

    def restore(self, arrays: dict[str, np.ndarray]) -> None:
        """Go on from the arrays of a watch of the same station.

        Raises
        ------
        InputError
            naming what none could have written; the watch is as it was.
        """
        fresh = self._model.scratch()
        if arrays:
            refuse_other_shapes(arrays, fresh._asdict())
        self._scratch = type(fresh)(*(arrays[name] for name in fresh._fields)) if arrays else None
