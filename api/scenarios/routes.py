"""/v1/scenarios and /v1/stations: what ships with the service; /v1/scenarios/resolve: what a request would run."""

from __future__ import annotations

from fastapi import APIRouter

from api.controllers.service import check_scenario
from api.problems import not_found
from api.scenarios.schemas import ScenarioInput, ScenarioSummary, StationSummary
from api.services import Opened
from station import Scenario, Station, load_scenario, load_station, presets, scenarios

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
