"""The plant: one second of a hydrogen refueling station, and everything that is true of it."""

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
