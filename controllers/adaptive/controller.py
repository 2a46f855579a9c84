"""The adaptive controller: identifies the plant's constants second by second and plans with them as `switched` does."""

from __future__ import annotations

import numpy as np

from controllers.adaptive.estimates import identified
from controllers.adaptive.identification import learn
from controllers.adaptive.memory import (
    ESTIMATE,
    FLAGGED,
    HIGH,
    IDENTIFICATION_SIZE,
    IDENTIFIED,
    LOW,
    start_identification,
)
from controllers.adaptive.settings import AdaptiveSettings
from controllers.estimate import use_station_prediction
from controllers.switched.controller import MEMORY_SIZE, Switched, decide_with
from controllers.switched.vector import price_fills, settings_vector
from station.compiled import callback, kernel
from station.control_model import ControlModel, as_thesis, is_thesis
from station.controller import DECIDE, CompiledController, Decision, Observation
from station.planning import Model

ASSUMED = 0.2
"""Relative error of the constants where the station states none: the plants this controller is measured on."""

REPRICED = 0.01
"""The cost of fills is tabulated anew when a flow coefficient has moved by this share: it takes as long as a plan."""

# Parts of the memory: that of `switched`, the identification, the coefficients of the table, the settings planned with.
_IDENTIFICATION = MEMORY_SIZE
_TABLED = _IDENTIFICATION + IDENTIFICATION_SIZE
_VECTOR = _TABLED + 2


@kernel
def _reprice(model: Model, tabled: np.ndarray, vector: np.ndarray) -> None:
    """Tabulate the cost of fills at the coefficients identified, if they have moved."""
    inlet, outlet = model.inlet_coefficient, model.outlet_coefficient
    if abs(inlet - tabled[0]) > REPRICED * tabled[0] or abs(outlet - tabled[1]) > REPRICED * tabled[1]:
        tabled[0], tabled[1] = inlet, outlet
        price_fills(model, vector)


@callback(DECIDE, counted=False)
def decide_adaptive(
    observation: Observation, model: ControlModel, _settings: np.ndarray, memory: np.ndarray
) -> Decision:
    """Command of `switched` if its model were the plant identified; limits are asked of `model`.

    The settings are read from memory, where the cost of fills is that of the plant identified.
    """
    identification = memory[_IDENTIFICATION:_TABLED]
    learn(observation, model, identification)
    believed = identified(model, identification)
    vector = memory[_VECTOR:]
    if is_thesis(model):
        thesis = as_thesis(believed)
        _reprice(thesis, memory[_TABLED:_VECTOR], vector)
        return decide_with(observation, as_thesis(model), thesis, vector, memory[:MEMORY_SIZE])
    _reprice(believed, memory[_TABLED:_VECTOR], vector)
    return decide_with(observation, model, believed, vector, memory[:MEMORY_SIZE])


class Adaptive(Switched):
    """Plans as `switched` does, with constants identified from telemetry instead of the station's figures.

    Chapter 5's idea: the dynamics of each mode from data, with the set of dynamics the data admit. Limits stay the
    station's, moved by their margins where a disturbance states errors.
    """

    name = "adaptive"
    about = "switched, planning with flow and heat constants identified from telemetry within their uncertainty set"
    settings_type = AdaptiveSettings

    def compiled(self) -> CompiledController:
        """This controller for the compiled loop, with fresh memory."""
        settings: AdaptiveSettings = self.settings_for(self.station)
        plant = self.station.control_constants()
        vector = settings_vector(settings, self.station)
        memory = np.concatenate(
            (
                use_station_prediction(self.station, np.zeros(MEMORY_SIZE)),
                start_identification(self.station, settings.parameters, ASSUMED),
                [plant.inlet_coefficient, plant.outlet_coefficient],
                vector,
            )
        )
        return CompiledController(decide_adaptive, plant, vector, memory, self.obeys_hold)


def identification_of(memory: np.ndarray) -> np.ndarray:
    """The part of an `Adaptive.memory` that belongs to the identification; a view."""
    return memory[_IDENTIFICATION:_TABLED]


def flagged_of(memory: np.ndarray) -> tuple[int, float | None]:
    """Seconds whose readings no constants within their intervals explain, and the time of the last, from a memory.

    Then the plant has changed, or an error exceeds its half-width: the intervals before it may not hold the truth.
    """
    found = identification_of(memory)
    count = int(found[FLAGGED])
    return count, float(found[FLAGGED + 1]) if count else None


def constants_of(memory: np.ndarray) -> dict[str, tuple[float, float, float]]:
    """Least value, estimate and greatest value of each constant identified, from an `Adaptive.memory`."""
    found = identification_of(memory)
    return {
        name: (float(found[LOW + item]), float(found[ESTIMATE + item]), float(found[HIGH + item]))
        for item, name in enumerate(IDENTIFIED)
    }
