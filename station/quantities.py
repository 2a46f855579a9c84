"""Quantities in files and requests, with their units and bounds, and the strict model whose fields they are."""

from __future__ import annotations

from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, ConfigDict, Field

from station.geometry import KELVIN

_Name = TypeVar("_Name", bound=str)

PRESSURE_MAX = 2000.0
"""Twice the pressure of today's 1000 bar compressors: above it a figure is a mistake of unit [bar]."""


VOLUME_MAX = 1000.0
"""No tank is larger [m3]."""


def finite(unit: str, *, gt: float | None = None, ge: float | None = None, le: float | None = None, about: str) -> Any:
    """A field for a finite number of a unit, within its bounds; `about` describes it."""
    return Field(gt=gt, ge=ge, le=le, allow_inf_nan=False, description=about, json_schema_extra={"unit": unit})


Pressure = Annotated[float, finite("bar", gt=0, le=PRESSURE_MAX, about="Absolute pressure")]
Temperature = Annotated[float, finite("degC", gt=-KELVIN, le=200, about="Temperature")]
Volume = Annotated[float, finite("m3", gt=0, le=VOLUME_MAX, about="Inner volume")]
Coefficient = Annotated[float, finite("g/(s bar)", gt=0, le=10, about="Flow per bar of difference")]
HeatingRate = Annotated[float, finite("K/s", ge=0, le=10, about="Temperature rate while a valve is open")]
Power = Annotated[float, finite("kW", ge=0, le=1e5, about="Electric power while it runs")]


def unique(names: list[_Name]) -> list[_Name]:
    """The names; raise ValueError where one is there twice."""
    if len(set(names)) != len(names):
        raise ValueError(f"must differ from one another; given {', '.join(names)}")
    return names


class Part(BaseModel):
    """A group of parameters; unknown fields are errors, and so are texts and booleans where numbers belong."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)
