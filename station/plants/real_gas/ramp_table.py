"""Ramps in the loop: a class of tanks' by volume and start pressure, fixed, given, or chosen by the model."""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from station.compiled import uncounted
from station.errors import InputError, StationError
from station.geometry import KELVIN
from station.plants.real_gas.catalog import DISPENSING, TankKind, full_density
from station.plants.real_gas.hydrogen import BAR
from station.plants.real_gas.leachman import Array, properties
from station.plants.real_gas.ramp import Range, Spread, choose_ramp, usual_spread

if TYPE_CHECKING:
    from station.plants.real_gas.options import DispensingOptions, PrecoolerOptions

PER_MINUTE = 1e6 / 60
"""MPa/min in Pa/s."""

NOMINAL_BAR = (350.0, 700.0)
"""Nominal working pressures that ramps are chosen for, and fills without communication end for [bar]."""

_GRID = DISPENSING["ramp_table"]


class RampTable(NamedTuple):
    """The ramps of tanks of one class, by the volume of a tank and its pressure at the start."""

    volume: Array  # a row holds up to here, the last one beyond it, too [m3]
    pressure: Array  # and so does a column [Pa]
    ramp: Array  # shape (volumes, pressures) [Pa/s]


@uncounted
def ramp_of(table: RampTable, volume: float, pressure: float) -> float:
    """The ramp [Pa/s] of a tank of a volume [m3] with a pressure [Pa]."""
    row = min(int(np.searchsorted(table.volume, volume)), len(table.volume) - 1)
    column = min(int(np.searchsorted(table.pressure, pressure)), len(table.pressure) - 1)
    ramp: float = table.ramp[row, column]
    return ramp


class Known(NamedTuple):
    """Knowledge a station has of a class of tanks before a vehicle of it comes."""

    kind: str  # one of `catalog.CLASSES`
    nominal: float  # nominal working pressure [Pa]
    tank_max: float  # largest single tank [m3]
    ambient: float  # [K]
    start: float  # of the gas in a tank that comes, usually [K]
    delivery: Range  # of the gas at the nozzle [K]
    target: float  # state of charge that ends a fill
    flow_max: float  # of the nozzle [kg/s]


def known_of(
    kind: str, given: DispensingOptions, precooler: PrecoolerOptions, nominal: float, ambient: float, start: float
) -> Known:  # fmt: skip
    """Knowledge from a station's sections of a class at a nominal working pressure [Pa].

    Tanks usually come at the temperature `start` [K], which may be other than that of the ambient air [K].

    The gas is at coldest as cold as the block's set point, and at warmest what the precooler leaves of ambient gas.
    """
    coldest = precooler.set_point_c + KELVIN
    warmest = ambient + precooler.effectiveness * (coldest - ambient)
    return Known(
        kind, nominal, given.tank_max_l * 1e-3, ambient, start, (coldest, warmest), given.target_percent / 100,
        given.flow_max_g_per_s * 1e-3,
    )  # fmt: skip


def ramp_table(given: DispensingOptions, known: Known, *, communication: bool) -> RampTable:
    """The ramps of a class as a section says: fixed, given as a table, or chosen.

    A vehicle that does not report its volume gets the gentlest ramp for its start pressure.

    Raises
    ------
    InputError
        if no ramp keeps a tank of the class cool.
    """
    most = given.ramp_mpa_per_min * PER_MINUTE
    if given.ramp_choice == "auto":
        return _chosen(known, most, communication=communication)
    own = given.ramp_table
    if own is None:
        return RampTable(np.array([np.inf]), np.array([np.inf]), np.array([[most]]))
    volumes, ramps = np.array(own.volume_l) * 1e-3, np.minimum(np.array(own.ramp_mpa_per_min) * PER_MINUTE, most)
    if not communication:
        volumes, ramps = np.array([np.inf]), ramps.min(axis=0, keepdims=True)
    return RampTable(volumes, np.array(own.start_bar) * BAR, ramps)


def _soaked(spread: Spread, ambient: float, start: float) -> Spread:
    """What is uncertain where tanks usually come at a temperature `start` [K] that is not the ambient air's [K]."""
    low, high = spread.soak
    return spread._replace(soak=(low + min(start - ambient, 0.0), high + max(start - ambient, 0.0)))


def full_pressure(nominal: float, ambient: float, start: float) -> float:
    """Pressure [Pa] that ends a fill without communication: a tank still as cold as it came would be full.

    A fill warms the gas however slowly it goes, so that no tank passes 100 % that is within the stated uncertainty
    about the ambient temperature [K] or the usual one at the `start` of a fill [K], and the soak.
    """
    coldest = _soaked(usual_spread(1.0, nominal, ambient, ambient), ambient, start)
    kelvin = coldest.ambient[0] + coldest.soak[0]
    return float(properties(np.array([full_density(nominal)]), np.array([kelvin])).pressure[0])


def _between(edges: Array) -> list[Range]:
    """The ranges that upper edges end."""
    return list(pairwise([float(_GRID["start_pressure_least_bar"]) * BAR, *edges]))


def _spread(known: Known, volume: Range, pressure: Range) -> Spread:
    """What is uncertain of a tank that is known to lie within ranges of volume [m3] and start pressure [Pa]."""
    ends = zip(volume, pressure, known.delivery, strict=True)
    low, high = (usual_spread(of, start, known.ambient, gas) for of, start, gas in ends)
    spread = Spread(*((first[0], last[1]) for first, last in zip(low, high, strict=True)))
    return _soaked(spread, known.ambient, known.start)


def _volumes(known: Known) -> Range:
    """Single tanks of the class [m3]."""
    low = float(_GRID["volume_least_L"]) * 1e-3
    return low, max(known.tank_max, low)


@lru_cache(maxsize=64)
def _chosen(known: Known, most: float, *, communication: bool) -> RampTable:
    """For each cell the largest ramp up to `most` [Pa/s] that keeps the worst tank of the cell cool."""
    low, high = _volumes(known)
    edges = np.geomspace(low, high, int(_GRID["volumes"]) + 1) if communication else np.array([low, high])
    pressures = np.array([bar * BAR for bar in _GRID["start_pressure_bar"]])
    ramps = np.empty((len(edges) - 1, len(pressures)))
    for row, volumes in enumerate(pairwise(edges)):
        for column, between in enumerate(_between(pressures)):
            kind = TankKind(known.kind, volumes[1], known.nominal)
            spread = _spread(known, volumes, between)
            try:
                choice = choose_ramp(kind, spread, known.target if communication else 1.0, known.flow_max)
            except StationError as error:
                raise InputError("station", [("real_gas.dispensing.ramp_choice", str(error))]) from None
            ramps[row, column] = min(choice.ramp, most)
    return RampTable(edges[1:], pressures, ramps)
