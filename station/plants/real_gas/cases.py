"""Measured cases: a fill or a discharge as a file of JSON tells it, checked field by field."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, field_validator, model_validator

from station.errors import InputError
from station.plants.real_gas.leachman import Array
from station.plants.real_gas.tables import PRESSURE_MAX, TEMPERATURE_MAX, TEMPERATURE_MIN

TIME_MAX = 86_400.0
"""No case is longer [s]."""

POINTS_MAX = 100_000
"""Of a series."""

VALUE_MAX = 1e6
"""No quantity of a case is larger, in K, MPa or kg/s."""

_PERIOD_MIN = 0.01  # no case is shorter [s]

_MPA = 1e6
_TANK_MAX = 1000.0  # [m3]
_ROUND = 2.0  # by this factor a tank's ends may make it another volume than its cylinder [1]
OUTER_COEFFICIENT = 8.0
"""Where a case names none [W/(m2 K)]; the manual of HydDown's figure for still air with radiation."""


def _number(*, gt: float | None = None, ge: float | None = None, le: float | None = None) -> Any:
    return Field(gt=gt, ge=ge, le=le, allow_inf_nan=False)


Number = TypeVar("Number")
Points = Annotated[list[Number], Field(min_length=1, max_length=POINTS_MAX)]
Pressure = Annotated[float, _number(gt=0, le=PRESSURE_MAX / _MPA)]
Temperature = Annotated[float, _number(ge=TEMPERATURE_MIN, le=TEMPERATURE_MAX)]
Length = Annotated[float, _number(gt=0, le=100)]
Seconds = Annotated[float, _number(gt=0, le=TIME_MAX)]


class _Fields(BaseModel):
    """Fields of a case; those that only describe it are let pass."""

    model_config = ConfigDict(extra="ignore", frozen=True, strict=True)


class Series(_Fields):
    """Values over time, linear between its points and constant beyond them."""

    time_s: Points[Annotated[float, _number(ge=-TIME_MAX, le=TIME_MAX)]]
    value: Points[Annotated[float, _number(ge=-VALUE_MAX, le=VALUE_MAX)]]

    @model_validator(mode="after")
    def _paired(self) -> Series:
        if len(self.time_s) != len(self.value):
            raise ValueError(f"time_s and value must be as many; given {len(self.time_s)} and {len(self.value)}")
        for before, after in zip(self.time_s, self.time_s[1:], strict=False):
            if after < before:
                raise ValueError(f"time_s must not fall; {after:g} s comes after {before:g} s")
        return self

    def at(self, time: Array) -> Array:
        """Values at times [s]."""
        return np.interp(time, self.time_s, self.value)


def _constant(given: Any) -> Any:
    """A number as a series that holds it always."""
    if isinstance(given, int | float) and not isinstance(given, bool):
        return {"time_s": [0.0], "value": [given]}
    return given


Driven = Annotated[Series, BeforeValidator(_constant)]
"""A series, or a number that holds always."""


class LayerFields(_Fields):
    """A layer of the wall."""

    name: str = "layer"
    thickness_m: Annotated[float, _number(gt=0, le=1)]
    density_kg_m3: Annotated[float, _number(gt=0, le=30_000)]
    heat_capacity_J_kgK: Annotated[float, _number(gt=0, le=20_000)]
    conductivity_W_mK: Annotated[float, _number(gt=0, le=5_000)]


class TankFields(_Fields):
    """The tank: a flat-ended cylinder and its layers from the inside out."""

    volume_m3: Annotated[float, _number(gt=0, le=_TANK_MAX)]
    inner_diameter_m: Length
    inner_length_m: Length | None = None
    layers: Annotated[list[LayerFields], Field(max_length=20)]  # none: no heat is exchanged
    inlet_diameter_m: Length | None = None

    @model_validator(mode="after")
    def _is_a_cylinder(self) -> TankFields:
        length = self.inner_length_m or 0.0
        cylinder = math.pi / 4 * self.inner_diameter_m**2 * length
        if length and not 1 / _ROUND <= self.volume_m3 / cylinder <= _ROUND:
            raise ValueError(
                f"volume_m3 must be that of inner_diameter_m and inner_length_m, {cylinder:.4g} m3, to a factor of "
                f"{_ROUND:g}; given {self.volume_m3:g} m3"
            )
        return self


class State(_Fields):
    """Pressure and temperature at the beginning."""

    pressure_MPa: Pressure
    temperature_K: Temperature
    wall_temperature_K: Temperature | None = None


class Ambient(_Fields):
    """The surroundings."""

    temperature_K: Temperature
    outer_coefficient_W_m2K: Annotated[float, _number(ge=0, le=10_000)] = OUTER_COEFFICIENT


class _Strict(_Fields):
    """Fields that drive a tank: a quantity of an unknown name is an error, a text beside them a remark."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    @model_validator(mode="before")
    @classmethod
    def _without_remarks(cls, given: Any) -> Any:
        if not isinstance(given, dict):
            return given
        known = cls.model_fields
        return {name: value for name, value in given.items() if name in known or not _is_remark(value)}


def _is_remark(value: Any) -> bool:
    """Whether a value is text alone."""
    return isinstance(value, str) or (isinstance(value, list) and all(isinstance(item, str) for item in value))


class Orifice(_Strict):
    """An orifice between the tank and what it empties into, or the supply that fills it."""

    diameter_m: Annotated[float, _number(gt=0, le=1)] | None = None
    discharge_coefficient: Annotated[float, _number(gt=0, le=2)] = 1.0
    back_pressure_MPa: Driven | None = None


DRIVERS = ("mass_flow_kg_s", "orifice", "pressure_ramp_MPa_per_min", "pressure_MPa")
"""What can drive a tank; a case has one."""

_FLOW_MAX = 100.0  # [kg/s]
_RANGES = {
    "mass_flow_kg_s": (-_FLOW_MAX, _FLOW_MAX),
    "pressure_MPa": (0.0, PRESSURE_MAX / _MPA),
    "inlet_pressure_MPa": (0.0, PRESSURE_MAX / _MPA),
    "supply_pressure_MPa": (0.0, PRESSURE_MAX / _MPA),
    "inlet_temperature_K": (TEMPERATURE_MIN, TEMPERATURE_MAX),
    "supply_temperature_K": (TEMPERATURE_MIN, TEMPERATURE_MAX),
}


class Boundary(_Strict):
    """Conditions that drive the tank, and the gas that comes in."""

    mass_flow_kg_s: Driven | None = None
    mass_flow_factor: Annotated[float, _number(gt=0, le=10)] = 1.0
    orifice: Orifice | None = None
    pressure_ramp_MPa_per_min: Annotated[float, _number(ge=-1000, le=1000)] | None = None
    end_pressure_MPa: Pressure | None = None
    pressure_MPa: Driven | None = None
    inlet_temperature_K: Driven | None = None
    inlet_pressure_MPa: Driven | None = None
    supply_temperature_K: Driven | None = None
    supply_pressure_MPa: Driven | None = None

    @model_validator(mode="after")
    def _one_driver(self) -> Boundary:
        given = [name for name in DRIVERS if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(f"one of {', '.join(DRIVERS)} must drive the tank; given {', '.join(given) or 'none'}")
        if self.pressure_ramp_MPa_per_min is not None and self.end_pressure_MPa is None:
            raise ValueError("end_pressure_MPa must say where pressure_ramp_MPa_per_min ends")
        if self.orifice is not None and self.orifice.back_pressure_MPa is None and self.supply_pressure_MPa is None:
            raise ValueError("orifice.back_pressure_MPa, or supply_pressure_MPa for a fill, must be given")
        if self.pressure_ramp_MPa_per_min == 0:
            raise ValueError("pressure_ramp_MPa_per_min must not be 0")
        for name, (low, high) in _RANGES.items():
            series: Series | None = getattr(self, name)
            _check_range(name, series.value if series else (), low, high)
        if self.orifice is not None and self.orifice.back_pressure_MPa is not None:
            _check_range("orifice.back_pressure_MPa", self.orifice.back_pressure_MPa.value, 0, PRESSURE_MAX / _MPA)
        return self

    @property
    def inlet_kelvin(self) -> Series | None:
        """Temperature of the gas that comes in: measured at the inlet, or that of the supply [K]."""
        return self.inlet_temperature_K or self.supply_temperature_K

    @property
    def inlet_pressure(self) -> Series | None:
        """Pressure at which that temperature gives the enthalpy [MPa]; None for the tank's own."""
        return self.inlet_pressure_MPa if self.inlet_temperature_K else self.supply_pressure_MPa


def _check_range(name: str, values: Iterable[float], low: float, high: float) -> None:
    """Raise ValueError for a value outside its limits."""
    for value in values:
        if not low <= value <= high:
            raise ValueError(f"{name} must lie between {low:g} and {high:g}; given {value:g}")


class Case(_Fields):
    """A measured fill or discharge."""

    case: Annotated[str, Field(min_length=1, max_length=200)]
    kind: Literal["fill", "discharge"] | None = None
    gas: Literal["hydrogen"] = "hydrogen"
    tank: TankFields
    initial: State
    ambient: Ambient
    boundary: Boundary
    measured: dict[str, Series]
    end_time_s: Seconds | None = None
    compare_until_s: Seconds | None = None
    notes: list[str] | str = []

    @field_validator("measured", mode="before")
    @classmethod
    def _series_only(cls, measured: Any) -> Any:
        """Series whose names say a quantity and its unit; remarks between them are let pass."""
        if not isinstance(measured, dict):
            return measured
        return {name: given for name, given in measured.items() if isinstance(given, dict)}

    @model_validator(mode="after")
    def _gas_is_known(self) -> Case:
        boundary = self.boundary
        if self.fills and boundary.inlet_kelvin is None:
            raise ValueError("boundary.inlet_temperature_K or boundary.supply_temperature_K must say what gas comes in")
        if self.fills and boundary.inlet_temperature_K is None and boundary.supply_pressure_MPa is None:
            raise ValueError("boundary.supply_pressure_MPa must stand beside supply_temperature_K")
        ramp, last = boundary.pressure_ramp_MPa_per_min, boundary.end_pressure_MPa
        if ramp is not None and last is not None and (last - self.initial.pressure_MPa) * ramp < 0:
            raise ValueError(
                f"boundary.pressure_ramp_MPa_per_min must lead from initial.pressure_MPa = "
                f"{self.initial.pressure_MPa:g} to boundary.end_pressure_MPa = {last:g}; given {ramp:g}"
            )
        if boundary.orifice and boundary.orifice.diameter_m is None and "pressure_MPa" not in self.measured:
            raise ValueError("boundary.orifice.diameter_m, or measured.pressure_MPa to fit it to, must be given")
        if not _PERIOD_MIN <= self.end <= TIME_MAX:
            raise ValueError(
                f"end_time_s, or the last measured second, must lie between {_PERIOD_MIN:g} and {TIME_MAX:g} s; "
                f"given {self.end:g}"
            )
        return self

    @property
    def fills(self) -> bool:
        """Whether gas comes in at any time."""
        drive = self.boundary
        if drive.mass_flow_kg_s is not None:
            return max(drive.mass_flow_kg_s.value) > 0
        if drive.orifice is not None:
            return drive.orifice.back_pressure_MPa is None
        if self.kind is not None:
            return self.kind == "fill"
        last = drive.pressure_MPa.value[-1] if drive.pressure_MPa else drive.end_pressure_MPa
        return last is not None and last > self.initial.pressure_MPa

    @property
    def end(self) -> float:
        """The last second that is computed [s]."""
        last = [series.time_s[-1] for series in self.measured.values()]
        return self.end_time_s or max([*last, self.compare_until_s or 0.0])

    @property
    def area_is_unpublished(self) -> bool:
        """Whether the area of the orifice is not a published figure, as its absence or a note says."""
        if self.boundary.orifice is None:
            return False
        notes = [self.notes] if isinstance(self.notes, str) else self.notes
        words = [note for note in notes if any(word in note for word in ("valve", "orifice", "opening"))]
        unknown = any("not published" in note or "unpublished" in note or "unknown" in note for note in words)
        return self.boundary.orifice.diameter_m is None or unknown


class OrificePoints(_Fields):
    """Measured choked flow at pressures and temperatures."""

    pressure_MPa: Annotated[list[Pressure], Field(min_length=1, max_length=POINTS_MAX)]
    temperature_K: Annotated[list[Temperature], Field(min_length=1, max_length=POINTS_MAX)]
    mass_flow_g_s: Annotated[list[Annotated[float, _number(gt=0)]], Field(min_length=1, max_length=POINTS_MAX)]

    @model_validator(mode="after")
    def _alike(self) -> OrificePoints:
        if not len(self.pressure_MPa) == len(self.temperature_K) == len(self.mass_flow_g_s):
            raise ValueError("pressure_MPa, temperature_K and mass_flow_g_s must be as many")
        return self


class OrificeCase(_Fields):
    """Choked flow through an orifice at steady states: there is no tank to compare."""

    case: Annotated[str, Field(min_length=1, max_length=200)]
    kind: Literal["orifice"]
    gas: Literal["hydrogen"] = "hydrogen"
    orifice_diameter_m: Annotated[float, _number(gt=0, le=1)]
    points: OrificePoints


def parse_case(given: dict[str, Any], source: str) -> Case | OrificeCase:
    """A case from the fields of its file; `source` is what errors call it.

    Raises
    ------
    InputError
        naming every field that is missing or wrong, with the value and the limit.
    """
    form = OrificeCase if given.get("kind") == "orifice" else Case
    try:
        return form.model_validate(given)
    except ValidationError as error:
        raise InputError.of(source, error) from None
