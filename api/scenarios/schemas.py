"""Scenarios as requests name or hold them, and as lists show them."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from station import InputError, Scenario, load_scenario, scenarios


def _by_name(given: Any) -> Any:
    """A scenario that ships with the service, for its name; files are never opened for a request."""
    if not isinstance(given, str):
        return given
    if given not in scenarios():
        raise ValueError(f"no scenario is called {given!r:.80}; there are {', '.join(scenarios())}")
    try:
        return load_scenario(given)
    except InputError as error:
        raise ValueError(str(error)) from None


class _NameOrWhole:
    """Tells the schema that a name will do."""

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        return {
            "anyOf": [{"type": "string", "enum": scenarios(), "title": "Name"}, handler(core)],
            "description": "Name of a scenario that ships with the service, or a whole one",
            "examples": ["S1"],
        }


ScenarioInput = Annotated[Scenario, BeforeValidator(_by_name), _NameOrWhole]
"""A scenario, or the name of one."""


class ScenarioSummary(BaseModel):
    """A scenario that ships with the service."""

    name: Annotated[str, Field(description="What requests call it", examples=["S1"])]
    about: Annotated[str, Field(description="One line on it", examples=["5 vehicles in 1000 s, evenly spaced"])]
    station: Annotated[str, Field(description="Its station", examples=["thesis-fit"])]
    vehicles: Annotated[
        int, Field(ge=1, description="Vehicles of replication 0", json_schema_extra={"unit": "vehicles"}, examples=[5])
    ]
    time_limit_s: Annotated[
        float, Field(gt=0, description="It ends here at the latest", json_schema_extra={"unit": "s"}, examples=[16400])
    ]


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


class TraceText(BaseModel):
    """A recorded day as CSV."""

    model_config = ConfigDict(extra="forbid")

    csv: Annotated[
        str,
        Field(
            description="A header with time_s, start_pressure_bar and, where wanted, volume_m3, finish_pressure_bar; "
            "then one vehicle a line",
            examples=["time_s,start_pressure_bar\n60,120\n410,150\n"],
        ),
    ]
