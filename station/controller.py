"""The interface of a controller: it sees an Observation each second and answers a Decision."""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numba import types

from station.compiled import numba_type
from station.control_model import SAMPLE_MODEL, ControlModel
from station.parameters import Station


class Status(IntEnum):
    """How a command was reached."""

    RULE = 0  # a rule; nothing is claimed
    OPTIMAL = 1  # proven best of the controller's own problem
    FEASIBLE = 2  # a limit on the search ended it: `cost` and `bound` say how far from best it may be
    LIVENESS = 3  # the liveness rule replaced an answer that would have stalled
    FALLBACK = 4  # the controller gave no usable answer in time; logic's command


ANNOUNCED = 4
"""Announced arrivals a controller sees."""

NONE_ANNOUNCED = (np.inf,) * ANNOUNCED


class Observation(NamedTuple):
    """Readings of the sensors at the start of a second. Buffers are ordered high, medium, low."""

    time: float  # [s]
    period: float  # sampling period [s]
    pressure: tuple[float, float, float]  # buffers [bar]
    temperature: tuple[float, float, float]  # buffers [deg C]
    vehicle: int  # index of the vehicle at the dispenser, -1 for none
    vehicle_pressure: float  # [bar]; where it is not read live, the reading at connection
    vehicle_temperature: float  # [deg C]; without communication the reading at connection
    vehicle_volume: float  # [m3]; without communication the station's usual tank
    communication: bool  # whether the vehicle's pressure is read live: it reports it, or the dispenser reads it
    queue_length: int  # vehicles waiting behind it
    previous: int  # command applied in the second before, bits of Valve
    finish_pressure: float = np.nan  # at which the vehicle leaves [bar]; without communication the station's usual
    announced: tuple[float, ...] = NONE_ANNOUNCED  # when the next vehicles arrive that have said so [s]; inf: nobody
    energy: float = np.nan  # electric, of the station since the start: its meter [kWh]; NaN: it has none
    timed: tuple[int, int] = (0, 0)  # valves kept open by minimum times; kept closed, by them or `station.starts`


class Decision(NamedTuple):
    """The command for one second and how it was reached."""

    command: int  # bits of Valve
    status: int = int(Status.RULE)
    cost: float = np.nan  # of the controller's objective, where it has one
    bound: float = np.nan  # no command costs less than this


@runtime_checkable
class Controller(Protocol):
    """A program that sets the six valves.

    `obeys_hold` says whether Eq. (7.16) binds it: the rule-based controller of the thesis is exempt. A controller
    may have two attributes more: `fallback`, the compiled controller asked where the shield closes a valve, and
    `wake_pressure`, three pressures [bar]: a longer idle period ends when a buffer falls below its own.
    """

    name: str
    obeys_hold: bool

    def start(self, station: Station) -> None:
        """Prepare for a run on `station`; forget any run before."""

    def decide(self, observation: Observation) -> Decision:
        """The command for the second that begins with `observation`."""


NEVER = (0.0, 0.0, 0.0)
"""A `wake_pressure` that no buffer falls below [bar]."""


class CompiledController(NamedTuple):
    """A controller as the compiled loop calls it: `decide(observation, model, settings, memory)`."""

    decide: Callable[..., Decision]  # a kernel compiled by station.compiled.callback(DECIDE)
    model: ControlModel  # what the controller believes the station to be
    settings: np.ndarray  # float64, constant during a run
    memory: np.ndarray  # float64, the controller's own state
    obeys_hold: bool
    wake_pressure: tuple[float, float, float] = NEVER


_OBSERVATION = Observation(
    0.0, 1.0, (1.0,) * 3, (1.0,) * 3, 0, 1.0, 1.0, 1.0, True, 0, 0, 1.0, NONE_ANNOUNCED, 1.0, (0, 0)
)

PLANT = numba_type(SAMPLE_MODEL)
OBSERVATION = numba_type(_OBSERVATION)
DECISION = numba_type(Decision(0, 0, 0.0, 0.0))
VECTOR = types.float64[::1]

DECIDE = DECISION(OBSERVATION, PLANT, VECTOR, VECTOR)
"""Numba signature of a compiled `decide`."""
