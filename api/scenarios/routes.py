"""/v1/scenarios and /v1/stations: what ships with the service and what users store in it; what a request would run."""

from __future__ import annotations

from http import HTTPStatus
from typing import Annotated, Any

from fastapi import APIRouter, Path, Query
from pydantic import ValidationError
from starlette.responses import Response

from api.controllers.service import check_scenario
from api.http.authorization import requires
from api.http.bodies import JsonRoute
from api.http.dependencies import SettingsDep
from api.http.etags import ConditionalGetDep, RemovalPreconditions, ReplacementPreconditions
from api.http.problems import not_found
from api.scenarios.schemas import (
    NAME_PATTERN,
    VEHICLE_UNITS,
    ScenarioInput,
    ScenarioSummary,
    ScenarioVehicles,
    Seed,
    StationSummary,
    TraceText,
    WholeScenario,
)
from api.scenarios.service import ScenariosDep
from api.scopes import Scope
from station import InputError, Scenario, Station, load_station, presets
from station.arrivals import Trace
from station.traces import parse_trace

router = APIRouter(prefix="/v1", tags=["scenarios"], route_class=JsonRoute)


Name = Annotated[str, Path(description="Name of a scenario", examples=["S1"])]
OwnName = Annotated[
    str, Path(max_length=64, description=f"Name of a user's scenario: {NAME_PATTERN}", examples=["my-day"])
]

_PUT: dict[int | str, dict[str, Any]] = {
    200: {"description": "The scenario of that name is replaced"},
    201: {"description": "There was none of that name", "model": Scenario},
}


@router.get("/scenarios")
def list_scenarios(scenarios: ScenariosDep) -> list[ScenarioSummary]:
    """The scenarios that ship with the service, then those that users have stored in it (`scenarios_max` at most)."""
    return scenarios.summaries()


@router.get("/scenarios/{name}")
def get_scenario(name: Name, scenarios: ScenariosDep, conditional: ConditionalGetDep) -> Scenario:
    """One scenario with every parameter: change it, and submit it with a run or store it under another name."""
    scenario, tag = scenarios.get(name)
    conditional.tag(tag)
    return scenario


@router.put("/scenarios/{name}", responses=_PUT)
@requires(Scope.RUN)
def put_scenario(
    name: OwnName,
    scenario: WholeScenario,
    scenarios: ScenariosDep,
    settings: SettingsDep,
    conditions: ReplacementPreconditions,
    response: Response,
) -> Scenario:
    """Store a scenario: runs, comparisons and twins then take it by name, as it is when they are submitted."""
    check_scenario(scenario, settings, "")
    tag, made = scenarios.put(name, scenario, conditions)
    response.headers["ETag"] = f'"{tag}"'
    if made:
        response.status_code = HTTPStatus.CREATED
        response.headers["Location"] = f"/v1/scenarios/{name}"
    return scenario


@router.delete("/scenarios/{name}", status_code=204)
@requires(Scope.RUN)
def delete_scenario(name: OwnName, scenarios: ScenariosDep, conditions: RemovalPreconditions) -> None:
    """Forget a user's scenario; jobs and twins that were submitted with it keep theirs."""
    scenarios.remove(name, conditions)


@router.post("/scenarios/resolve")
@requires(Scope.READ)
def resolve_scenario(given: ScenarioInput, scenarios: ScenariosDep, settings: SettingsDep) -> Scenario:
    """Check a scenario without running it: presets and defaults filled in, or what is wrong."""
    scenario = scenarios.resolve(given, "")
    check_scenario(scenario, settings, "")
    return scenario


@router.post("/scenarios/vehicles")
@requires(Scope.READ)
def realise_vehicles(
    given: ScenarioInput,
    scenarios: ScenariosDep,
    settings: SettingsDep,
    replication: Annotated[int, Query(ge=0, le=1_000_000, description="0 is the pattern", examples=[0])] = 0,
    seed: Seed = 0,
) -> ScenarioVehicles:
    """The vehicles of one replication: who arrives when, and with what."""
    scenario = scenarios.resolve(given, "")
    check_scenario(scenario, settings, "")
    vehicles = scenario.vehicles(replication, seed)
    columns = {name: column.tolist() for name, column in zip(VEHICLE_UNITS, vehicles, strict=True)}
    return ScenarioVehicles.model_validate({"units": VEHICLE_UNITS, "columns": columns})


@router.post("/scenarios/trace")
@requires(Scope.READ)
def read_trace(given: TraceText) -> Trace:
    """Arrivals of a CSV text, one vehicle a line: what `arrivals` of a scenario takes."""
    try:
        return Trace.model_validate({"vehicles": parse_trace(given.csv).vehicles})
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
