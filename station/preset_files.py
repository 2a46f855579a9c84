"""Presets: the stations that ship with the package, files in data/presets, and models identified at them."""

from __future__ import annotations

import tomllib
from importlib.resources import files

from pydantic import ValidationError

from station.errors import InputError
from station.parameters import Station
from station.sections import ControlModelFigures

PRESETS = files("station") / "data" / "presets"

CONTROL_MODELS = files("station") / "data" / "control_models"
"""What `hrs identify PRESET --out` wrote of presets whose controllers plan with the thesis's form all the same."""

DEFAULT_PRESET = "thesis-fit"
"""The fitted station every scenario uses unless it names another."""


def presets() -> list[str]:
    """Names of the stations that ship with the package."""
    return sorted(item.name.removesuffix(".toml") for item in PRESETS.iterdir() if item.name.endswith(".toml"))


def with_identified_model(station: Station) -> Station:
    """A preset whose controllers plan with the model that was identified at it.

    Raises
    ------
    InputError
        if nothing was identified at a station of that name.
    """
    if station.control_model is not None:
        return station
    file = CONTROL_MODELS / f"{station.name}.toml"
    if not file.is_file():
        raise InputError("station", [("control_model", f"nothing was identified at {station.name!r}")])
    section = tomllib.loads(file.read_text())["control_model"]
    return station.model_copy(update={"control_model": ControlModelFigures.model_validate(section)})


def load_station(name: str) -> Station:
    """The preset `name`.

    Raises
    ------
    InputError
        if there is no such preset.
    """
    if name not in presets():
        raise InputError("station", [("", f"no preset is called {name!r}; there are {', '.join(presets())}")])
    given = tomllib.loads((PRESETS / f"{name}.toml").read_text())
    try:
        return Station.model_validate(given)
    except ValidationError as error:
        raise InputError.of(f"preset {name}", error) from None
