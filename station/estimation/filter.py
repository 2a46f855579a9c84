"""The filter of a station: the model of its plant, one pass over a record of seconds."""

from __future__ import annotations

from typing import Any

from station.errors import InputError
from station.estimation.interface import (
    FIRST_SECONDS,
    ROBUST,
    STIFF,
    EstimationModel,
    Followed,
    Tuning,
)
from station.estimation.interface import SHARED_STATES as STATES
from station.estimation.real_gas.model import REAL_GAS_MODEL
from station.estimation.thesis import THESIS_MODEL
from station.frames import Frames
from station.parameters import Station

__all__ = [
    "FIRST_SECONDS", "ROBUST", "STATES", "STIFF", "Followed", "Tuning", "follow", "model_of", "model_of_plant",
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

    `plant`: constants instead of the station's own, of its plant.

    Raises
    ------
    InputError
        if stations of its plant are not followed.
    """
    model = model_of(station)
    constants = model.constants_of(station) if plant is None else plant
    s = model.begin(frames, station, tuning, constants)
    return model.advance(frames, len(frames), s, station, tuning, constants)
