"""The interface of a plant: its kernels, the formulas that limits need, its constants and its name.

A plant is known by the class of its constants, a NamedTuple. Kernels that are given such constants are compiled for
their class, so that the plant is chosen when a kernel is compiled and costs nothing when it runs; called from Python
the functions here choose by the class as well. `station.plants` registers every plant there is.

A run's state begins with the entries that every plant keeps, `P`, `T` and `M`: they are what sensors read of it and
what a record holds. A plant may have `own` entries more, from `OWN` on, from which it derives them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from inspect import signature
from typing import Any, NamedTuple, Protocol

import numpy as np

from station.compiled import specialised
from station.limit_figures import LimitFigures

P, T, M = 0, 4, 8
"""Where the pressures [bar], temperatures [deg C] and masses [g] of the four tanks stand in a run's state."""

OWN = 22
"""Where a plant's own entries begin in it."""

REFERENCE_TEMPERATURE = 25.0
"""At which buffers are refilled in `Plant.restoring_time` [deg C]."""

GOES_ON, COMPLETE, CUT_SHORT = 0, 1, 2
"""What `fill_end` gives."""

Number = Any
"""A float, or a symbol of CasADi or Pyomo."""


class Constants(Protocol):
    """A plant's constants that limits read; every plant's have these names."""

    @property
    def compressor_pressure(self) -> float:
        """p_com [bar]: the compressor fills no buffer that is not below it."""

    @property
    def outlet_coefficient(self) -> float:
        """c_f_out [g/(s bar)]: how fast the flow to a vehicle grows with the pressure difference."""

    @property
    def limits(self) -> LimitFigures:
        """The figures that limits compare with."""

    @property
    def compressor_count(self) -> int:
        """n_com of Eq. (7.18)."""


SHARED = tuple(name for name in vars(Constants) if isinstance(vars(Constants)[name], property))
"""Names of the constants that every plant has."""


class Spent(NamedTuple):
    """Consumption of a plant in a second, mean over it."""

    compressed: float  # what flowed out of the compressor [g/s]
    dispensed: float  # and to the vehicle [g/s]


@dataclass(frozen=True)
class Plant:
    """A plant. The functions named as those of this module are compiled in their place, with the same arguments."""

    name: str  # as station files give it
    constants: type[Any]  # class of its constants: a NamedTuple with the names of `Constants`
    constants_of: Callable[..., Any]  # of a Station and `communication`: whether vehicles report
    sample: Any  # constants of the types that the kernels are compiled for
    own: int  # entries of the state that are its own; they begin with those that records show:
    rates: dict[str, str]  # columns that hold until the next row, and their units,
    levels: dict[str, str]  # columns that hold at the time of a row,
    figures: dict[str, str]  # and columns of the table of vehicles
    begin: Callable[..., None]
    advance: Callable[..., Spent]
    rest: Callable[..., None]
    fill_end: Callable[..., int]
    leaves_at: Callable[..., float]
    leave: Callable[..., None]
    lose: Callable[..., None]
    seep: Callable[..., None]
    own_columns: Callable[..., tuple[int, int, int]]
    reads_nozzle: Callable[..., bool]
    metered: Callable[..., float]
    outlet_flow: Callable[..., Number]
    filled_to: Callable[..., Number]
    emptied_to: Callable[..., Number]
    timed_valves: Callable[..., tuple[int, int]]
    warmed: Callable[..., Number]
    vehicle_temperature: Callable[..., Number]
    held: Callable[[Any, Any, Any], Any]  # mass [g] at a pressure [bar] and temperature [deg C] in a volume [m3]
    stiffness: Callable[[float, float], float]  # most by which a gram raises a tank's pressure [bar/g]; 0: no limit
    restoring_time: Callable[[int, Any, float, Any], Any]  # of a buffer, masses now, mass wanted [g], constants: [s]
    ailing: Callable[[Any, float, float, float], Any]  # constants with faults: parts left of what the compressor gives
    # and of the dispenser's opening [1], 1 for all of it; by how much the precooler is warmer [K]
    restoring_energy: Callable[[int, Any, float, Any], Any] | None = None  # electric [kWh]; None: no account
    notes: int = 0  # entries that a state may have behind its own, with which seconds are faster and their rows lack
    # levels: for futures, which keep no record; 0 at first, then the plant's
    precools: bool = False  # whether what the precooler does is in its equations

    @property
    def powers(self) -> list[str]:
        """Its rates that are electric powers [kW]; none where it keeps no account of energy."""
        return [name for name, unit in self.rates.items() if unit == "kW"]

    @property
    def columns(self) -> dict[str, str]:
        """Columns of its records behind those of every record, with their units."""
        return {**self.rates, **self.levels}


_PLANTS: dict[str, Plant] = {}
_BY_CONSTANTS: dict[type[Any], Plant] = {}


def register(plant: Plant) -> None:
    """Make a plant known, before any kernel is compiled.

    Raises
    ------
    ValueError
        if its constants lack one that limits read, a function has other arguments than the interface's, or its name
        or the class of its constants is another plant's.
    """
    if missing := [name for name in SHARED if name not in plant.constants._fields]:
        raise ValueError(f"plant {plant.name}: its constants lack {', '.join(missing)}")
    for function in (
        begin, advance, rest, fill_end, leaves_at, leave, lose, own_columns, reads_nozzle, metered, outlet_flow,
        filled_to, emptied_to, timed_valves, warmed, vehicle_temperature,
    ):  # fmt: skip
        given = getattr(plant, function.__name__)
        if list(signature(given).parameters) != list(signature(function).parameters):
            raise ValueError(f"plant {plant.name}: arguments of {function.__name__} must be those of the interface")
    if plant.name in _PLANTS or plant.constants in _BY_CONSTANTS:
        raise ValueError(f"plant {plant.name}: there is one of that name, or with those constants")
    _PLANTS[plant.name] = _BY_CONSTANTS[plant.constants] = plant


def register_model(model: Plant) -> None:
    """Make what controllers believe of a station known to the limits: it is no plant that a station can follow."""
    _BY_CONSTANTS[model.constants] = model


def plants() -> list[str]:
    """Names of the plants there are."""
    return sorted(_PLANTS)


def plant_named(name: str) -> Plant:
    """The plant of that name.

    Raises
    ------
    ValueError
        naming those there are.
    """
    if name not in _PLANTS:
        raise ValueError(f"must be one of {', '.join(plants())}; given {name!r}")
    return _PLANTS[name]


def plant_of(constants: type[Any]) -> Plant:
    """The plant whose constants are of that class."""
    return _BY_CONSTANTS[constants]


def samples() -> list[Any]:
    """Constants of every plant, as kernels are compiled for them."""
    return [plant.sample for plant in _PLANTS.values()]


_specialised = specialised(plant_of)


@_specialised
def begin(
    state: np.ndarray, tank: int, pressure: float, temperature: float, volume: float, finish_pressure: float, plant: Any
) -> None:
    """Let a tank of `volume` [m3] hold gas at a pressure [bar] and temperature [deg C]: at first, or at connection.

    `finish_pressure` [bar] is what the vehicle connected asks for; of a buffer it means nothing.
    """
    plant_of(type(plant)).begin(state, tank, pressure, temperature, volume, finish_pressure, plant)


@_specialised
def advance(state: np.ndarray, volume: float, command: int, period: float, plant: Any) -> Spent:
    """Apply a command for `period` seconds.

    `volume`: of the tank of the vehicle connected [m3], 0 where none is.
    """
    return plant_of(type(plant)).advance(state, volume, command, period, plant)


@_specialised
def rest(state: np.ndarray, period: float, plant: Any) -> None:
    """Let `period` seconds pass with every valve closed and no vehicle connected."""
    plant_of(type(plant)).rest(state, period, plant)


@_specialised
def fill_end(state: np.ndarray, finish_pressure: float, plant: Any) -> int:
    """Whether the vehicle connected leaves, and how: `GOES_ON`, `COMPLETE` or `CUT_SHORT`.

    It is full when what its finish pressure [bar] asks for is reached, cut short where a limit ends its fill before.
    """
    found: int = plant_of(type(plant)).fill_end(state, finish_pressure, plant)
    return found


@_specialised
def leave(state: np.ndarray, plant: Any) -> None:
    """Let the vehicle connected go, filled or not."""
    plant_of(type(plant)).leave(state, plant)


@_specialised
def lose(state: np.ndarray, buffer: int, mass: float, plant: Any) -> None:
    """Let so much gas [g] leak out of a buffer."""
    plant_of(type(plant)).lose(state, buffer, mass, plant)


@_specialised
def seep(state: np.ndarray, buffer: int, mass: float, volume: float, plant: Any) -> None:
    """Let so much gas [g] flow from a buffer to the vehicle connected, whose tank holds `volume` [m3]."""
    plant_of(type(plant)).seep(state, buffer, mass, volume, plant)


@_specialised
def leaves_at(state: np.ndarray, finish_pressure: float, plant: Any) -> float:
    """The pressure [bar] at which the vehicle connected leaves, as far as it is known now: what controllers are told.

    `finish_pressure` [bar] is what it asks for.
    """
    found: float = plant_of(type(plant)).leaves_at(state, finish_pressure, plant)
    return found


@_specialised
def own_columns(plant: Any) -> tuple[int, int, int]:
    """How many `rates`, `levels` and `figures` the plant has; they stand in the state from `OWN` on, in this order.

    A rate is the mean of the second last advanced, a figure that of the vehicle connected.
    """
    shown: tuple[int, int, int] = plant_of(type(plant)).own_columns(plant)
    return shown


@_specialised
def reads_nozzle(plant: Any) -> bool:
    """Whether the dispenser itself reads the pressure of the vehicle connected, which then need not report it."""
    found: bool = plant_of(type(plant)).reads_nozzle(plant)
    return found


@_specialised
def metered(state: np.ndarray, plant: Any) -> float:
    """Electric energy of the station since the start [kWh]; NaN where the plant keeps no account of it."""
    found: float = plant_of(type(plant)).metered(state, plant)
    return found


@_specialised
def outlet_flow(pressure: Number, vehicle_pressure: Number, plant: Any) -> Number:
    """Flow [g/s] that an outlet would give now, between two pressures [bar]."""
    return plant_of(type(plant)).outlet_flow(pressure, vehicle_pressure, plant)


@_specialised
def filled_to(buffer: int, plant: Any) -> Number:
    """The pressure [bar] below which a buffer must lie to be filled."""
    return plant_of(type(plant)).filled_to(buffer, plant)


@_specialised
def emptied_to(buffer: int, plant: Any) -> Number:
    """The pressure [bar] below which nothing may flow out of a buffer; 0 for no limit."""
    return plant_of(type(plant)).emptied_to(buffer, plant)


@_specialised
def timed_valves(state: np.ndarray, plant: Any) -> tuple[int, int]:
    """The valves that minimum times keep open, and those that they keep closed, as bits of Valve."""
    found: tuple[int, int] = plant_of(type(plant)).timed_valves(state, plant)
    return found


@_specialised
def warmed(buffer: int, pressure: Number, temperature: Number, plant: Any, period: Number) -> Number:
    """The temperature [deg C] that a buffer does not pass within `period` seconds of being filled.

    `pressure` [bar] and `temperature` [deg C] are those it has.
    """
    return plant_of(type(plant)).warmed(buffer, pressure, temperature, plant, period)


@_specialised
def vehicle_temperature(temperature: Number, outlets: Number, plant: Any, period: Number) -> Number:
    """Temperature [deg C] of the vehicle's tank `period` seconds on, with so many outlets open."""
    return plant_of(type(plant)).vehicle_temperature(temperature, outlets, plant, period)
