"""The OpenAPI document: what FastAPI finds, plus problems and links on every path and examples from real scenarios."""

from __future__ import annotations

import threading
from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi
from pydantic import BaseModel

from api.http.authentication import is_open
from api.http.problems import MEDIA_TYPE, Problem
from api.server.openapi_links import add_links
from station import load_scenario, load_station, parse_scenario
from station.plants.real_gas.options import RampTableOptions
from station.uncertainty import Disturbance

ABOUT = """
Digital twins of hydrogen refueling stations: run controllers on scenarios, compare them, watch and operate live
twins. Units are those of the glossary: bar, degC, g, g/s, m3, s. Errors are problem documents (RFC 9457). Live
telemetry is published over zenoh.
"""

_VEHICLE = {"time_s": 60.0, "start_pressure_bar": 120.0, "volume_m3": 0.14, "finish_pressure_bar": 690.0}

_LAWS: list[dict[str, Any]] = [
    {"kind": "poisson", "rate_per_h": 12.0, "period_s": 7200.0},
    {"kind": "profile", "count": 17, "hourly_weights": [1.0, 4.0, 2.0]},
    {
        "kind": "trace",
        "vehicles": [{"time_s": 60.0, "start_pressure_bar": 120.0, "volume_m3": 0.14, "finish_pressure_bar": 690.0}],
    },
]

_SOURCES: list[BaseModel] = [
    *(load_scenario(name) for name in ("S1", "S2")),
    *(parse_scenario({"name": law["kind"], "about": "A day of mine", "arrivals": law}) for law in _LAWS),
    load_station("light-duty-700"),
    load_station("h70-light"),
    RampTableOptions(volume_l=[100.0, 250.0], start_bar=[50.0, 200.0], ramp_mpa_per_min=[[15.0, 30.0], [10.0, 20.0]]),
    Disturbance(),
]
"""Shipped scenarios and stations, one scenario of each further law of arrivals, and a disturbance."""


_BODIES: dict[str, Any] = {
    "submit_run": {"scenario": "S1", "controller": "minlp1"},
    "submit_comparison": {"scenarios": ["S1", "S2"], "controllers": ["logic", "minlp1"], "replications": 2},
    "submit_certificate": {
        "ask": "stability", "modes": [{"A": [["0.5", "0.1"], ["0", "0.6"]]}, {"A": [["0.4", "0"], ["0.2", "0.5"]]}],
        "constraint": {"kind": "dwell", "tau": 2},
    },
    "start_twin": {"scenario": "S1", "controller": "minlp1", "at_end": "repeat"},
    "put_scenario": {
        "name": "my-day", "about": "A day of mine", "arrivals": {"kind": "uniform", "count": 20, "period_s": 7200.0},
    },
    "change_twin": {"speed": 60},
    "add_vehicle": {"start_pressure_bar": 120},
    "create_key": {"name": "screen", "scopes": ["read"]},
}  # fmt: skip
"""A body that is accepted as it stands, by operation; examples of single fields need not fit each other."""

_FILLED_IN = {"Scenario": ("station", "time_limit_s")}
"""Fields by schema that a request may leave out: a validator, which no schema shows, fills them in."""


_MAKING = threading.Lock()


def document(app: FastAPI, *, keys_required: bool) -> dict[str, Any]:
    """The document, made for the first who asks: half a second of work, for a thread that may take it."""
    with _MAKING:
        if app.openapi_schema is None:
            app.openapi_schema = _made(app, keys_required=keys_required)
    return app.openapi_schema


def _made(app: FastAPI, *, keys_required: bool) -> dict[str, Any]:
    found = get_openapi(title="hrs-twin", version=app.version, description=ABOUT, routes=app.routes)
    schemas = found["components"]["schemas"]
    for name in ("HTTPValidationError", "ValidationError"):
        schemas.pop(name, None)
    schemas.update(_problem_schemas())
    for name, fields in _FILLED_IN.items():
        schemas[name]["required"] = [field for field in schemas[name]["required"] if field not in fields]
    for path, operations in found["paths"].items():
        for method, operation in operations.items():
            _with_problems(operation["responses"])
            if method == "get" and any(
                given["name"].lower() == "if-none-match" for given in operation.get("parameters", ())
            ):
                operation["responses"]["304"] = {"description": "What If-None-Match names still holds; no body"}
            if operation["operationId"] in _BODIES:
                content = operation["requestBody"]["content"]["application/json"]
                content["example"] = _BODIES[operation["operationId"]]
            if is_open(path):
                operation["security"] = []
    add_links(found["paths"])
    for source in _SOURCES:
        _with_examples(source, schemas)
    found["components"]["securitySchemes"] = {
        "key": {"type": "http", "scheme": "bearer", "description": "Needed unless the service listens on loopback"}
    }
    found["security"] = [{"key": []}] if keys_required else [{}, {"key": []}]
    return found


def _problem_schemas() -> dict[str, Any]:
    schema = Problem.model_json_schema(ref_template="#/components/schemas/{model}")
    inner: dict[str, Any] = schema.pop("$defs")
    return {"Problem": schema, **inner}


def _with_problems(responses: dict[str, Any]) -> None:
    """Any request may end in a problem."""
    responses.pop("422", None)
    responses["default"] = {
        "description": "A problem document",
        "content": {MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/Problem"}}},
    }


def _plain(value: Any) -> Any:
    if isinstance(value, list):
        return [_plain(item) for item in value]
    return value.model_dump(mode="json") if isinstance(value, BaseModel) else value


def _with_examples(value: object, schemas: dict[str, Any]) -> None:
    """Show a shipped scenario's values as examples of the fields of the models it is made of."""
    if isinstance(value, list | tuple):
        for item in value:
            _with_examples(item, schemas)
    if not isinstance(value, BaseModel):
        return
    kind = type(value).__name__
    for schema in (schemas.get(name) for name in (kind, f"{kind}-Input", f"{kind}-Output")):
        for field, about in (schema or {"properties": {}})["properties"].items():
            given = getattr(value, field)
            about.setdefault("examples", [_plain(given)])
            about.setdefault("description", f"See {about['$ref'].rpartition('/')[2]}" if "$ref" in about else field)
    for field in type(value).model_fields:
        _with_examples(getattr(value, field), schemas)
