"""The OpenAPI document: what FastAPI finds, plus problems on every path and examples from real scenarios."""

from __future__ import annotations

from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi
from pydantic import BaseModel

from api.problems import MEDIA_TYPE, Problem
from station import load_scenario, load_station

ABOUT = """
Digital twins of hydrogen refueling stations: run controllers on scenarios, compare them, watch and operate live
twins. Units are those of the glossary: bar, degC, g, g/s, m3, s. Errors are problem documents (RFC 9457). Live
telemetry is published over zenoh.
"""

_SOURCES = [load_station("thesis-fit"), *(load_scenario(name) for name in ("S1", "S3", "S4"))]


def document(app: FastAPI) -> dict[str, Any]:
    """The document, made once."""
    if app.openapi_schema is None:
        found = get_openapi(title="hrs-twin", version=app.version, description=ABOUT, routes=app.routes)
        schemas = found["components"]["schemas"]
        for name in ("HTTPValidationError", "ValidationError"):
            schemas.pop(name, None)
        schemas.update(_problem_schemas())
        for path in found["paths"].values():
            for operation in path.values():
                _with_problems(operation["responses"])
        for source in _SOURCES:
            _with_examples(source, schemas)
        found["components"]["securitySchemes"] = {
            "key": {"type": "http", "scheme": "bearer", "description": "Needed unless the service listens on loopback"}
        }
        found["security"] = [{}, {"key": []}]
        app.openapi_schema = found
    return app.openapi_schema


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
            about.setdefault("examples", [given.model_dump(mode="json") if isinstance(given, BaseModel) else given])
            about.setdefault("description", f"See {about['$ref'].rpartition('/')[2]}" if "$ref" in about else field)
    for field in type(value).model_fields:
        _with_examples(getattr(value, field), schemas)
