"""Stations by name and from files: a preset, a preset with changes, or a whole station."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import ValidationError

from station.errors import InputError
from station.files import parse_file
from station.parameters import Station
from station.preset_files import load_station


def load_station_file(name: str) -> Station:
    """The preset of that name, or the station of a TOML or JSON file: a whole one, or a `preset` with changes.

    Raises
    ------
    InputError
        naming each wrong field with its limit, or the file that cannot be read.
    """
    path = Path(name)
    if path.suffix not in (".toml", ".json"):
        return load_station(name)
    given = parse_file(path, name)
    try:
        if "preset" in given:
            given = with_changes(given)
        return Station.model_validate(given)
    except ValidationError as error:
        raise InputError.of(name, error) from None


def with_changes(given: dict[str, Any]) -> dict[str, Any]:
    """The preset that `given` names with the rest of it laid over; its own description only where nothing differs.

    Raises
    ------
    InputError
        if there is no such preset.
    """
    changes = {key: value for key, value in given.items() if key != "preset"}
    base = load_station(str(given["preset"])).model_dump()
    if differing := ", ".join(sorted(changes.keys() - {"name", "about", "source"})):
        base["about"] = f"{base['name']} with changes in {differing}"
    return _merged(base, changes)


def _merged(base: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """`base` with `changes` laid over it, group by group."""
    merged = dict(base)
    for key, value in changes.items():
        below = merged.get(key)
        merged[key] = _merged(below, value) if isinstance(below, dict) and isinstance(value, dict) else value
    return merged
