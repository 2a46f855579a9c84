"""/v1/scenarios and /v1/stations: what ships with the service; /v1/scenarios/resolve: what a request would run."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query
from pydantic import ValidationError

from api.controllers.service import check_scenario
from api.problems import not_found
from api.runs.schemas import Seed
from api.scenarios.schemas import (
    VEHICLE_UNITS,
    ScenarioInput,
    ScenarioSummary,
    ScenarioVehicles,
    StationSummary,
    TraceText,
)
from api.services import Opened
from station import InputError, Scenario, Station, load_scenario, load_station, presets, scenarios
from station.arrivals import Trace
from station.scenario import parse_trace

router = APIRouter(prefix="/v1", tags=["scenarios"])


@router.get("/scenarios")
def list_scenarios() -> list[ScenarioSummary]:
    """The scenarios that ship with the service."""
    found = [load_scenario(name) for name in scenarios()]
    return [
        ScenarioSummary(
            name=scenario.name,
            about=scenario.about,
            station=scenario.station.name,
            vehicles=len(scenario.vehicles().arrival),
            time_limit_s=scenario.time_limit_s,
        )
        for scenario in found
    ]


@router.get("/scenarios/{name}")
def get_scenario(name: str) -> Scenario:
    """One scenario with every parameter: change it, and submit it with a run."""
    if name not in scenarios():
        raise not_found("scenario", name, scenarios())
    return load_scenario(name)


@router.post("/scenarios/resolve")
def resolve_scenario(given: ScenarioInput, opened: Opened) -> Scenario:
    """Check a scenario without running it: presets and defaults filled in, or what is wrong."""
    check_scenario(given, opened.settings, "")
    return given


@router.post("/scenarios/vehicles")
def realise_vehicles(
    given: ScenarioInput,
    opened: Opened,
    replication: Annotated[int, Query(ge=0, le=1_000_000, description="0 is the pattern", examples=[0])] = 0,
    seed: Seed = 0,
) -> ScenarioVehicles:
    """The vehicles of one replication: who arrives when, and with what."""
    check_scenario(given, opened.settings, "")
    vehicles = given.vehicles(replication, seed)
    columns = {name: column.tolist() for name, column in zip(VEHICLE_UNITS, vehicles, strict=True)}
    return ScenarioVehicles.model_validate({"units": VEHICLE_UNITS, "columns": columns})


@router.post("/scenarios/trace")
def read_trace(given: TraceText) -> Trace:
    """Arrivals of a CSV text, one vehicle a line: what `arrivals` of a scenario takes."""
    try:
        return Trace.model_validate({"vehicles": parse_trace(given.csv)})
    except ValidationError as error:
        raise InputError.of("trace", error) from None


@router.get("/stations")
def list_stations() -> list[StationSummary]:
    """The station presets."""
    return [StationSummary(name=name, about=load_station(name).about) for name in presets()]


@router.get("/stations/{name}")
def get_station(name: str) -> Station:
    """One preset with every parameter."""
    if name not in presets():
        raise not_found("station", name, presets())
    return load_station(name)
