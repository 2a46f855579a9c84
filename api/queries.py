"""Query parameters: those that an operation does not know are refused, as fields of bodies are."""

from __future__ import annotations

from fastapi import FastAPI, Request

from api.nearest import nearest
from api.problems import invalid


async def check_query(request: Request) -> None:
    """Refuse a request with a query parameter that its operation does not know; async, so that no thread is taken.

    Raises
    ------
    ProblemError
        422 `invalid`, which names each and what it may have meant.
    """
    if not request.query_params:
        return
    known = _known(request.app)[request.scope["route"].name]
    none = "" if known else ": it takes none"
    unknown = [name for name in request.query_params if name not in known]
    if unknown:
        raise invalid([(name, f"is no parameter of this request{none}{nearest(name, known)}") for name in unknown])


def _known(app: FastAPI) -> dict[str, list[str]]:
    """Names of the query parameters of each operation, as the OpenAPI document has them; read once."""
    found: dict[str, list[str]] | None = getattr(app.state, "query_parameters", None)
    if found is None:
        operations = [each for methods in app.openapi()["paths"].values() for each in methods.values()]
        found = app.state.query_parameters = {
            operation["operationId"]: [
                parameter["name"] for parameter in operation.get("parameters", ()) if parameter["in"] == "query"
            ]
            for operation in operations
        }
    return found
