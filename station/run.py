"""The state of a run in progress, the record it writes, and the rules that stay the same while it runs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from station.columns import CODES, COUNTS, VALUES, VEHICLE_COLUMNS
from station.compiled import inlined
from station.controller import Observation
from station.geometry import VALVES
from station.plants.interface import Constants
from station.sensors import SensorModel
from station.starts import Starts, barred_inlets


def _places(table: dict[str, str], *names: str) -> list[int]:
    """Where columns of a block of the record stand."""
    return [list(table).index(name) for name in names]


TIME, PRESSURE, TEMPERATURE, MASS = _places(VALUES, "time", "pressure_high", "temperature_high", "mass_high")
FLOW_COMPRESSOR, FLOW_DISPENSER = _places(VALUES, "flow_compressor", "flow_dispenser")
COST, BOUND = _places(VALUES, "decision_cost", "decision_bound")
REFUSED, STATUS = _places(CODES, f"refused_{VALVES[0]}", "decision_status")
CONNECTED_VEHICLE, QUEUE = _places(COUNTS, "vehicle", "queue_length")
ARRIVAL, CONNECTED, FINISHED = _places(VEHICLE_COLUMNS, "arrival", "connected", "finished")
VOLUME, START_PRESSURE, START_TEMPERATURE, FINISH_PRESSURE = _places(
    VEHICLE_COLUMNS, "volume", "start_pressure", "start_temperature", "finish_pressure"
)
FINAL_PRESSURE, DELIVERED = _places(VEHICLE_COLUMNS, "final_pressure", "delivered")

# Entries of RunState.state behind those of the tanks (see `station.plants.interface`), and of RunState.counters.
READING, CLOCK, STALLED, DRY, NEAREST = 12, 14, 15, 16, 17
ROW, ARRIVED, NEXT, CURRENT, PREVIOUS = range(5)

PERIOD = 1.0
"""Sampling period of the plant and its controllers, Sec. 7.4 [s]."""


class RunState(NamedTuple):
    """The state of a run in progress, and the record it writes."""

    state: (
        np.ndarray
    )  # (18,) or (OWN + own,) pressures [bar], temperatures [deg C], masses [g], first reading, clock [s], seconds
    # without gas from the controller (beyond the limit it is stood in for), seconds in which nothing could be given,
    # how near a buffer has been to giving gas since [bar]; see sensors
    counters: np.ndarray  # (5,) row, vehicles arrived, next to connect, connected, previous command
    vehicles: np.ndarray  # (len(VEHICLE_COLUMNS), n)
    values: np.ndarray  # (len(VALUES), rows)
    codes: np.ndarray  # (len(CODES), rows)
    counts: np.ndarray  # (len(COUNTS), rows)


class RunParameters(NamedTuple):
    """Constants of a run."""

    plant: Constants  # of the plant that is simulated
    usual_volume: float  # the tank a controller assumes without communication [m3]
    usual_finish: float  # and the pressure at which it leaves [bar]
    communication: bool
    announcement: float  # how long before they arrive vehicles say so [s]
    idle_period: float  # [s]
    time_limit: float  # [s]
    liveness: float  # logic stands in when a vehicle has been given nothing for so long [s]; infinite: never
    incomplete: float  # a fill ends when nothing could be given for so long [s]; infinite: never
    sensors: SensorModel  # what a disturbed run knows of `plant`
    stuck_open: int = 0  # valves that are open whatever they are told, as bits of Valve
    stuck_closed: int = 0  # and those that are closed
    starts: Starts = Starts()  # one buffer is kept able to begin a fill, where `liveness` is finite


@inlined
def kept_closed(observation: Observation, parameters: RunParameters) -> int:
    """The inlet that the slot keeps closed in this second, as a bit of Valve, or 0; see `station.starts`."""
    if parameters.liveness == np.inf:
        return 0
    return barred_inlets(observation.pressure, observation.temperature, parameters.starts)


def ailing(parameters: RunParameters, plant: Constants, stuck: tuple[int, int]) -> RunParameters:
    """The parameters of a station with these constants, and valves stuck open and closed."""
    return parameters._replace(plant=plant, stuck_open=stuck[0], stuck_closed=stuck[1])
