"""Scenarios as requests name or hold them, and as lists show them."""

from __future__ import annotations

from datetime import datetime
from enum import StrEnum
from typing import Annotated, Any

from pydantic import (
    BaseModel,
    BeforeValidator,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    TypeAdapter,
    ValidationError,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, core_schema

from api.http.strict import Body
from station import InputError, Scenario, load_scenario, scenarios
from station.arrivals import COUNT_MAX, TraceVehicle
from station.whole import WHOLE

NAME_PATTERN = r"^[A-Za-z0-9][A-Za-z0-9_-]{0,63}$"
"""Of a stored scenario: a part of a path, and on the command line never the name of a file."""

_NAME_SCHEMA = {
    "type": "string", "pattern": NAME_PATTERN, "title": "Name", "examples": ["S1"],
    "description": "Name of a scenario that ships with the service or is stored in it",
}  # fmt: skip


def _shipped(given: Any) -> Any:
    """A scenario that ships with the service, for its name; files are never opened for a request."""
    if not isinstance(given, str):
        return given
    if given not in scenarios():
        raise ValueError(f"no scenario is called {given!r:.80}; there are {', '.join(scenarios())}")
    try:
        return load_scenario(given)
    except InputError as error:
        raise ValueError(str(error)) from None


PIECE = 100
"""Vehicles that are validated in one call, in which no other thread runs: below a millisecond."""

_PIECES = TypeAdapter(list[TraceVehicle])


def _in_pieces(given: Any) -> Any:
    """A scenario whose long list of vehicles is validated, up to the first piece that holds a wrong one.

    What is behind that piece is left out, so that there are few errors to describe.
    """
    arrivals = given.get("arrivals") if isinstance(given, dict) else None
    vehicles = arrivals.get("vehicles") if isinstance(arrivals, dict) else None
    if not isinstance(arrivals, dict) or not isinstance(vehicles, list) or not PIECE < len(vehicles) <= COUNT_MAX:
        return given
    valid: list[Any] = []
    for begin in range(0, len(vehicles), PIECE):
        piece = vehicles[begin : begin + PIECE]
        try:
            valid += _PIECES.validate_python(piece)
        except ValidationError:
            valid += piece
            break
    return {**given, "arrivals": {**arrivals, "vehicles": valid}}


class _NameOrWhole:
    """Validates a mapping as a scenario and leaves a name to be looked up; one schema, so that errors name one."""

    @classmethod
    def __get_pydantic_core_schema__(cls, _source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        def checked(given: Any, whole: core_schema.ValidatorFunctionWrapHandler) -> Any:
            return given if isinstance(given, str) else whole(_in_pieces(given))

        return core_schema.no_info_wrap_validator_function(checked, handler.generate_schema(Scenario))

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        return {
            "anyOf": [_NAME_SCHEMA, handler(core)],
            "description": "Name of a scenario that ships with the service or is stored in it, or a whole one",
            "examples": ["S1"],
        }


Seed = Annotated[int, Field(ge=0, le=2**63 - 1, description="Seed of replications from 1 on", examples=[0]), WHOLE]
ScenarioInput = Annotated[Scenario | str, _NameOrWhole]
"""A whole scenario, or the name of one: `api.scenarios.service.Scenarios.resolve` finds it."""

WholeScenario = Annotated[Scenario, BeforeValidator(_in_pieces)]
"""A whole scenario, validated in pieces."""

ShippedScenario = Annotated[Scenario, BeforeValidator(_shipped)]
"""A whole scenario, also given by the name of one that ships."""


class Origin(StrEnum):
    """The origin of a scenario that has a name."""

    SHIPPED = "shipped"  # with the service; it does not change
    OWN = "own"  # stored by a user


class ScenarioSummary(BaseModel):
    """A scenario that has a name."""

    name: Annotated[str, Field(description="What requests call it", examples=["S1"])]
    about: Annotated[str, Field(description="One line on it", examples=["5 vehicles in 1000 s, evenly spaced"])]
    station: Annotated[str, Field(description="Its station", examples=["thesis-fit"])]
    vehicles: Annotated[
        int, Field(ge=1, description="Vehicles of replication 0", json_schema_extra={"unit": "vehicles"}, examples=[5])
    ]
    time_limit_s: Annotated[
        float, Field(gt=0, description="It ends here at the latest", json_schema_extra={"unit": "s"}, examples=[16400])
    ]
    origin: Annotated[
        Origin, Field(description="`shipped` with the service, or a user's `own`", examples=["shipped"])
    ] = Origin.SHIPPED
    changed: Annotated[
        datetime | None,
        Field(description="Last change (UTC); null of those that ship", examples=["2026-11-21T09:00:00Z"]),
    ] = None


class StationSummary(BaseModel):
    """A station preset."""

    name: Annotated[str, Field(description="What scenarios call it", examples=["thesis-fit"])]
    about: Annotated[str, Field(description="One line on it", examples=["Fitted to tables 7.4-7.7"])]


VEHICLE_UNITS = {
    "arrival": "s", "start_pressure": "bar", "start_temperature": "degC", "volume": "m3", "finish_pressure": "bar",
}  # fmt: skip
"""Columns of the vehicles of a replication, in the order of `station.arrivals.Vehicles`, with units."""


class ScenarioVehicles(BaseModel):
    """The vehicles of one replication in order of arrival."""

    units: Annotated[dict[str, str], Field(description="Unit of each column", examples=[VEHICLE_UNITS])]
    columns: Annotated[
        dict[str, list[float]], Field(description="One row a vehicle", examples=[{"arrival": [0, 250, 500]}])
    ]


class TraceText(Body):
    """A recorded day as CSV."""

    csv: Annotated[
        str,
        Field(
            description="A header with time_s, start_pressure_bar and, where wanted, volume_m3, finish_pressure_bar; "
            "then one vehicle a line",
            examples=["time_s,start_pressure_bar\n60,120\n410,150\n"],
        ),
    ]
