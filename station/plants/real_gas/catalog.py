"""Tanks of vehicles by class and volume, and the limits of a fill: the data files as numbers."""

from __future__ import annotations

import math
import re
from functools import cache
from typing import Any, NamedTuple

from station.errors import InputError
from station.geometry import KELVIN
from station.plants.real_gas.hydrogen import load_data
from station.plants.real_gas.leachman import density
from station.plants.real_gas.tank import Shape, Tank, tank_of
from station.plants.real_gas.wall import Layer

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
    return float(density(nominal, float(_LIMITS["reference_temperature_C"]) + KELVIN))


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


def _layer(given: dict[str, Any], factor: float) -> Layer:
    return Layer(
        given["name"], given["thickness_m"] * factor, given["density_kg_m3"], given["heat_capacity_J_kgK"],
        given["conductivity_W_mK"],
    )  # fmt: skip


def vehicle_tank(kind: TankKind, period: float) -> Tank:
    """The tank for kernels, for steps of one period [s]."""
    data = _TANKS[kind.kind]
    growth = (kind.volume / (data["volume_L"] * 1e-3)) ** (1 / 3)
    diameter = data["inner_diameter_m"] * growth
    length = kind.volume / (math.pi / 4 * diameter**2)
    stronger = growth * kind.nominal / (data["nominal_working_pressure_MPa"] * 1e6)
    layers = [_layer(item, 1.0) for item in data["liner"]] + [_layer(item, stronger) for item in data["shell"]]
    return tank_of(Shape(kind.volume, diameter, length), layers, _OUTER, period, data["inlet_diameter_m"])
