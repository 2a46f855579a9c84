"""Presets: the stations that ship with the package, files in data/presets."""

from __future__ import annotations

import tomllib
from importlib.resources import files

from pydantic import ValidationError

from station.errors import InputError
from station.parameters import Station

PRESETS = files("station") / "data" / "presets"

DEFAULT_PRESET = "thesis-fit"
"""The fitted station every scenario uses unless it names another."""


def presets() -> list[str]:
    """Names of the stations that ship with the package."""
    return sorted(item.name.removesuffix(".toml") for item in PRESETS.iterdir() if item.name.endswith(".toml"))


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
