"""The plant: one second of a hydrogen refueling station, and everything that is true of it."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from station.controller import Controller, Decision, Observation, Status
    from station.errors import ControllerError, InputError, StationError
    from station.limits import Limit, Valve
    from station.metrics import Metrics
    from station.parameters import Station, load_station, presets
    from station.record import Record
    from station.scenario import Scenario, load_scenario, parse_scenario, scenarios
    from station.simulation import simulate

__all__ = [
    "Controller",
    "ControllerError",
    "Decision",
    "InputError",
    "Limit",
    "Metrics",
    "Observation",
    "Record",
    "Scenario",
    "Station",
    "StationError",
    "Status",
    "Valve",
    "load_scenario",
    "load_station",
    "parse_scenario",
    "presets",
    "scenarios",
    "simulate",
]

_PLACES = {
    "station.controller": ("Controller", "Decision", "Observation", "Status"),
    "station.errors": ("ControllerError", "InputError", "StationError"),
    "station.limits": ("Limit", "Valve"),
    "station.metrics": ("Metrics",),
    "station.parameters": ("Station", "load_station", "presets"),
    "station.record": ("Record",),
    "station.scenario": ("Scenario", "load_scenario", "parse_scenario", "scenarios"),
    "station.simulation": ("simulate",),
}
"""Where each name is made, and imported from when it is first asked for: an error's type does not wait for kernels."""

_PLACE_OF = {name: place for place, names in _PLACES.items() for name in names}


def __getattr__(name: str) -> Any:
    """A name of this room, from the module that makes it."""
    if name not in _PLACE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = globals()[name] = getattr(import_module(_PLACE_OF[name]), name)
    return found
