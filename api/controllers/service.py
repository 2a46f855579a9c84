"""The installed controllers, and whether a service's limits let one run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from api.nearest import nearest
from api.settings import Settings
from controllers import controllers, create_from
from controllers.registry import load
from station import InputError, Scenario, Station


def about(name: str) -> str:
    """One line on an installed controller."""
    loaded = load(name)
    lines = (loaded.__doc__ or "").strip().splitlines()
    return getattr(loaded, "about", "") or (lines[0] if lines else "")


def options_schema(name: str) -> dict[str, Any]:
    """JSON schema of a controller's options; empty for one that declares none."""
    settings = getattr(load(name), "settings_type", None)
    return settings.model_json_schema() if settings is not None and settings.model_fields else {}


def check(controller: str, scenarios: Sequence[Scenario], settings: Settings, field: str = "controller") -> None:
    """Raise InputError unless `controller` fits every station and looks no further ahead than the service allows."""
    try:
        actor = create_from(controller)
        for scenario in scenarios:
            actor.start(scenario.known_station)
    except InputError as error:
        raise InputError("request", [(field, _said(controller, error))]) from None
    for scenario in scenarios:
        resolved = actor.settings_for(scenario.known_station) if hasattr(actor, "settings_for") else None
        horizon = getattr(resolved, "horizon", 1)
        if horizon > settings.horizon_max:
            message = f"horizon must be at most {settings.horizon_max} (setting horizon_max); given {horizon}"
            raise InputError("request", [(field, message)])


def check_station(controller: str, station: Station) -> None:
    """Raise InputError unless `controller` fits a station."""
    try:
        create_from(controller).start(station)
    except InputError as error:
        raise InputError("request", [("options", _said(controller, error))]) from None


def check_scenario(scenario: Scenario, settings: Settings, field: str = "scenario") -> None:
    """Raise InputError if a scenario may last longer than the service allows."""
    if scenario.time_limit_s > settings.duration_max_s:
        limit = f"must be at most {settings.duration_max_s:g} s (setting duration_max_s)"
        raise InputError("request", [(f"{field}.time_limit_s", f"{limit}; given {scenario.time_limit_s:g}")])


def _said(controller: str, error: InputError) -> str:
    """The error of a controller as a request names it; of an unknown option, the nearest one that it has."""
    name = controller.partition(":")[0]
    known = getattr(load(name), "settings_type", None) if name in controllers() else None
    fields = getattr(known, "model_fields", {})
    options = {item.partition("=")[0] for item in controller.split(":")[1:]} - set(fields)
    return "; ".join(
        (f"{field}: {message}" if field else message) + (nearest(field, fields) if field in options else "")
        for field, message in error.problems
    )
