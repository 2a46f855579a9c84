"""The filter of a station: the model of its plant, one pass over a record of seconds."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from station.errors import InputError
from station.estimation.drift_watch import DriftWatch
from station.estimation.interface import (
    FIRST_SECONDS,
    ROBUST,
    STIFF,
    Drifts,
    EstimationModel,
    Followed,
    Tuning,
)
from station.estimation.interface import SHARED_STATES as STATES
from station.estimation.power import with_flow_of_power
from station.estimation.real_gas.model import REAL_GAS_MODEL
from station.estimation.thesis import THESIS_MODEL
from station.estimation.valves.watch import ValveWatch
from station.frames import Frames
from station.parameters import Station

__all__ = [
    "FIRST_SECONDS", "ROBUST", "STATES", "STIFF", "Drifts", "Followed", "Tuning", "follow", "looks_for_drift",
    "model_of", "model_of_plant",
]  # fmt: skip

_MODELS = {model.plant: model for model in (THESIS_MODEL, REAL_GAS_MODEL)}


def model_of(station: Station) -> EstimationModel:
    """The estimation model of a station.

    Raises
    ------
    InputError
        if stations of its plant are not followed.
    """
    return model_of_plant(station.plant)


def model_of_plant(plant: str) -> EstimationModel:
    """The estimation model of a plant.

    Raises
    ------
    InputError
        if they are not followed.
    """
    if plant not in _MODELS:
        known = ", ".join(sorted(_MODELS))
        raise InputError("station", [("plant", f"must be one of {known}: no other is followed; given {plant!r}")])
    return _MODELS[plant]


def follow(frames: Frames, station: Station, tuning: Tuning = ROBUST, plant: Any = None) -> Followed:
    """Follow a record with the filter; robust where the tuning lets a leak be, else the plant's own states alone.

    Where no flow out of the compressor was read its power tells it. With the usual tuning valves that stick are looked
    for and taken for what they are; of a calibrated station sensors that drift as well, and the drift is taken off.
    `plant`: constants instead of the station's own, of its plant.

    Raises
    ------
    InputError
        if stations of its plant are not followed.
    """
    model = model_of(station)
    constants = model.constants_of(station) if plant is None else plant
    frames = with_flow_of_power(frames, model.power_of(station))
    drifts = stuck = None
    if tuning.leak > 0.0:
        frames, stuck = ValveWatch(station, model, compares=tuning == ROBUST).advance(frames)
    if looks_for_drift(station, tuning):
        frames, drifts = DriftWatch(station, model, constants).advance(frames, len(frames))
    s = model.begin(frames, station, tuning, constants)
    return replace(model.advance(frames, len(frames), s, station, tuning, constants), drifts=drifts, stuck=stuck)


def looks_for_drift(station: Station, tuning: Tuning) -> bool:
    """Whether sensors that drift are looked for: the model must hold, and leaks be states of it."""
    return station.calibrated and tuning.leak > 0.0
