"""Tanks of vehicles by class and volume, and the limits of a fill: the data files as numbers."""

from __future__ import annotations

import math
import re
from functools import cache
from typing import NamedTuple

import numpy as np

from station.compiled import uncounted
from station.errors import InputError
from station.geometry import KELVIN
from station.plants.real_gas.hydrogen import load_data
from station.plants.real_gas.leachman import Array, density
from station.plants.real_gas.tank import Tank, stirring
from station.plants.real_gas.wall import CELLS_PER_LAYER, Layer, Wall, build_wall, layer_rows

_TANKS = load_data("tanks.toml")
_OUTER = float(_TANKS["surroundings"]["outer_coefficient_W_m2K"])
_NAME = re.compile(r"(type[134])-(\d+(?:\.\d+)?)")

CLASSES = ("type1", "type3", "type4")
"""Classes of tanks: steel, aluminium in fibre, polymer in fibre."""

DISPENSING = load_data("dispensing.toml")
"""Limits of a fill, the usual settings, and what is uncertain about a vehicle."""

_LIMITS = DISPENSING["limits"]
TEMPERATURE_LIMIT = float(_LIMITS["temperature_max_C"]) + KELVIN
"""Of the gas in a tank [K]."""

REFERENCE = float(_LIMITS["reference_temperature_C"]) + KELVIN
"""At which a tank at its nominal working pressure is full [K]."""


class TankKind(NamedTuple):
    """A tank of a class: its proportions follow from the volume, its wall from the nominal working pressure too."""

    kind: str  # one of CLASSES
    volume: float  # [m3]
    nominal: float  # nominal working pressure [Pa]

    @property
    def name(self) -> str:
        """As `tank_kind` reads it."""
        return f"{self.kind}-{self.volume * 1e3:g}"

    @property
    def full_mass(self) -> float:
        """The mass at a state of charge of 100 % [kg]: at the nominal working pressure and 15 degC, SAE J2601."""
        return self.volume * full_density(self.nominal)

    @property
    def pressure_max(self) -> float:
        """The highest pressure of a fill [Pa]."""
        return float(_LIMITS["pressure_factor"]) * self.nominal


@cache
def full_density(nominal: float) -> float:
    """Density at a state of charge of 100 % [kg/m3] of a nominal working pressure [Pa]."""
    return float(density(nominal, REFERENCE))


def tank_kind(name: str, nominal: float | None = None) -> TankKind:
    """The tank that a name like type4-122 means: class and volume [L], at a nominal working pressure [Pa] or its usual.

    Raises
    ------
    InputError
        if the name is none, or the volume is outside its class.
    """
    found = _NAME.fullmatch(name)
    if found is None:
        known = ", ".join(f"{kind}-<litres> ({_TANKS[kind]['about']})" for kind in CLASSES)
        raise InputError("tank", [("tank", f"must be one of {known}, such as type4-122; given {name!r:.100}")])
    kind, litres = found[1], float(found[2])
    low, high = _TANKS[kind]["volume_range_L"]
    if not low <= litres <= high:
        raise InputError("tank", [("tank", f"{kind} must have {low:g} to {high:g} litres; given {litres:g}")])
    usual = float(_TANKS[kind]["nominal_working_pressure_MPa"]) * 1e6
    return TankKind(kind, litres * 1e-3, nominal or usual)


class TankClass(NamedTuple):
    """A class of tanks as kernels use it: a tank of another volume keeps the proportions."""

    volume: float  # [m3]
    diameter: float  # inner, of a tank of that volume [m]
    inlet: float  # diameter of its inlet, of any volume [m]
    nominal: float  # its wall is made for this nominal working pressure [Pa]
    layers: Array  # see `layer_rows`


@cache
def tank_class(kind: str) -> TankClass:
    """The class of that name, one of CLASSES."""
    data = _TANKS[kind]
    names = ("thickness_m", "density_kg_m3", "heat_capacity_J_kgK", "conductivity_W_mK")
    layers = [Layer(item["name"], *(item[name] for name in names)) for item in (*data["liner"], *data["shell"])]
    return TankClass(
        data["volume_L"] * 1e-3, data["inner_diameter_m"], data["inlet_diameter_m"],
        data["nominal_working_pressure_MPa"] * 1e6, layer_rows(layers, len(data["shell"])),
    )  # fmt: skip


@uncounted
def build_tank(
    kind: TankClass, volume: float, nominal: float, period: float, capacity: Array, rate: Array, conductance: Array,
    passed: Array, inverse: Array,
) -> tuple[float, float, float, float, float]:  # fmt: skip
    """A tank of a class by volume [m3] and nominal working pressure [Pa]; its cells go into arrays, see `Wall`.

    The wall that holds the pressure grows with diameter and pressure (constant hoop stress), the liner does not. Gives
    the factors `forced` and `free` of `Tank`, and `first`, `skin` and `area` of `Wall`.
    """
    growth = (volume / kind.volume) ** (1 / 3)
    diameter = kind.diameter * growth
    length = volume / (math.pi / 4 * diameter**2)
    first, skin, area = build_wall(
        kind.layers, growth * nominal / kind.nominal, diameter, length, _OUTER, period, CELLS_PER_LAYER, capacity, rate,
        conductance, passed, inverse,
    )  # fmt: skip
    forced, free = stirring(area, diameter, kind.inlet)
    return forced, free, first, skin, area


def vehicle_tank(kind: TankKind, period: float) -> Tank:
    """The tank for kernels, for steps of one period [s]."""
    of = tank_class(kind.kind)
    capacity, rate, conductance, passed, inverse = np.zeros((5, len(of.layers) * CELLS_PER_LAYER))
    forced, free, first, skin, area = build_tank(
        of, kind.volume, kind.nominal, period, capacity, rate, conductance, passed, inverse
    )
    wall = Wall(capacity, rate, conductance, passed, inverse, first, skin, area)
    return Tank(kind.volume, forced, free, -1.0, wall)
