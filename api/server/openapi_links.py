"""Links of the OpenAPI document: what can be asked about a thing, from the answers that name it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

MADE = ("201", "202")
"""Statuses of an answer that names what was made."""


def add_links(paths: dict[str, Any]) -> None:
    """Link what makes a thing, and the lists of those that ship, to every operation on one; and a page to the next."""
    for path, methods in paths.items():
        for status in MADE:
            if made := methods.get("post", {}).get("responses", {}).get(status):
                _link(made, _below(paths, path, "$response.body#/"))
        if "get" not in methods or "{" in path:
            continue
        listed = methods["get"]["responses"]["200"]
        if _is_list(listed):
            _link(listed, _below(paths, path, "$response.body#/0/"))
        elif any(parameter["name"] == "cursor" for parameter in methods["get"].get("parameters", ())):
            _link(listed, [(methods["get"]["operationId"], {"cursor": "$response.body#/next"})])


def _below(paths: dict[str, Any], path: str, place: str) -> Iterator[tuple[str, dict[str, str]]]:
    """Operations on one thing of a collection, and the parameter that names it."""
    for child, methods in paths.items():
        name, closed, _ = child.removeprefix(path + "/{").partition("}")
        if not closed or not child.startswith(path + "/{"):
            continue
        where = place + ("name" if name == "name" else "id")
        yield from ((operation["operationId"], {name: where}) for operation in methods.values())


def _is_list(response: dict[str, Any]) -> bool:
    schema = response.get("content", {}).get("application/json", {}).get("schema", {})
    return bool(schema.get("type") == "array")


def _link(response: dict[str, Any], targets: Any) -> None:
    found = {name: {"operationId": name, "parameters": parameters} for name, parameters in targets}
    if found:
        response["links"] = found
