"""The Thing Description of a twin (W3C, Web of Things Thing Description 1.1), made of the OpenAPI document."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple
from urllib.parse import quote

from api.telemetry.topics import SIGNAL, key
from api.things.data_schemas import DataSchemas
from api.twins.messages import sample_columns

CONTEXT = "https://www.w3.org/2022/wot/td/v1.1"

MEDIA_TYPE = "application/td+json"

_OF_TWIN = "/v1/twins/{twin_id}"

_JSON, _STREAM = "application/json", "text/event-stream"

_IDEMPOTENT = ("patch", "put", "delete")

_SCOPES = {True: "bearer_sc", False: "nosec_sc"}

_SECURITY = {
    "bearer_sc": {"scheme": "bearer", "in": "header", "name": "Authorization", "description": "A key of the service"},
    "nosec_sc": {"scheme": "nosec"},
}


class Place(NamedTuple):
    """Where a thing is."""

    base: str  # of the service's REST routes, with a slash at the end
    zenoh: str  # endpoint of the router, as tcp/127.0.0.1:7447
    keys_required: bool


class _Operation(NamedTuple):
    """An operation on a twin."""

    path: str  # behind the twin's own
    method: str
    document: Mapping[str, Any]

    @property
    def name(self) -> str:
        """Its name without `get_`."""
        return str(self.document["operationId"]).removeprefix("get_")

    def content(self) -> Mapping[str, Any]:
        """What it answers where it succeeds, by media type."""
        answers = self.document["responses"]
        code = next((code for code in answers if code.startswith("2")), None)
        found: Mapping[str, Any] = answers[code].get("content", {}) if code else {}
        return found


def describe(state: Mapping[str, Any], document: Mapping[str, Any], place: Place) -> dict[str, Any]:
    """The Thing Description of the twin with that state, from an OpenAPI document that has its routes."""
    schemas = DataSchemas(document["components"]["schemas"])
    twin = str(state["id"])
    properties: dict[str, Any] = _signals(twin, state["layout"], place)
    actions: dict[str, Any] = {}
    events: dict[str, Any] = {}
    for operation in _operations(document):
        if _STREAM in operation.content():
            events[operation.name] = _event(operation, twin)
        elif operation.method == "get" and _JSON in operation.content():
            properties[operation.name] = _property(operation, twin, schemas)
        elif operation.method != "get":
            actions[operation.name] = _action(operation, twin, schemas)
    secured = _SCOPES[place.keys_required]
    return {
        "@context": CONTEXT, "@type": "Thing", "id": f"urn:hrs-twin:twin:{twin}", "title": twin,
        "description": f"Live twin of station {state['station']} in scenario {state['scenario']}, {state['source']}",
        "created": state["created"], "base": place.base, "securityDefinitions": {secured: _SECURITY[secured]},
        "security": secured, "properties": properties, "actions": actions, "events": events,
    }  # fmt: skip


def _operations(document: Mapping[str, Any]) -> Iterator[_Operation]:
    """Those on one twin, but for its description."""
    for path, methods in document["paths"].items():
        if path.startswith(_OF_TWIN) and not path.endswith("/thing"):
            for method, operation in methods.items():
                yield _Operation(path.removeprefix(_OF_TWIN), method, operation)


def _signals(twin: str, layout: str, place: Place) -> dict[str, Any]:
    """A property for each column: its newest figure, read and observed over zenoh."""
    protocol, _, address = place.zenoh.partition("/")
    return {
        name: {
            "title": name, "type": "object", "readOnly": True, "observable": True,
            "properties": {
                "value": {"unit": unit, "oneOf": [{"type": "number"}, {"type": "null"}]},
                "time": {"type": "number", "unit": "s"},
            },
            "forms": [
                {
                    "href": f"zenoh+{protocol}://{address}/{key(twin, SIGNAL, name)}", "contentType": _JSON,
                    "op": ["readproperty", "observeproperty", "unobserveproperty"],
                }
            ],
        }
        for name, unit in sample_columns(layout).items()
    }  # fmt: skip


def _about(operation: _Operation) -> dict[str, Any]:
    said = operation.document
    return {"title": said["summary"], "description": said.get("description", said["summary"])}


def _variables(operation: _Operation, schemas: DataSchemas) -> dict[str, Any]:
    """What stands in its address: parts of the path, and of the query."""
    found = {
        each["name"]: schemas.of({**each["schema"], "description": each.get("description", each["name"])})
        for each in operation.document.get("parameters", ())
        if each["in"] in {"path", "query"} and each["name"] != "twin_id"
    }
    return {"uriVariables": found} if found else {}


def _href(operation: _Operation, twin: str) -> str:
    """Its address below the base, with a template for what is asked for."""
    query = [each["name"] for each in operation.document.get("parameters", ()) if each["in"] == "query"]
    asked = f"{{?{','.join(query)}}}" if query else ""
    return f"v1/twins/{quote(twin, safe='')}{operation.path}{asked}"


def _property(operation: _Operation, twin: str, schemas: DataSchemas) -> dict[str, Any]:
    answer = schemas.of(operation.content()[_JSON].get("schema", {}))
    form = {"href": _href(operation, twin), "op": "readproperty", "contentType": _JSON, "htv:methodName": "GET"}
    return {**answer, **_about(operation), **_variables(operation, schemas), "readOnly": True, "forms": [form]}


def _action(operation: _Operation, twin: str, schemas: DataSchemas) -> dict[str, Any]:
    form: dict[str, Any] = {
        "href": _href(operation, twin), "op": "invokeaction", "htv:methodName": operation.method.upper(),
        "response": {"contentType": _JSON},
    }  # fmt: skip
    found = {
        **_about(operation), **_variables(operation, schemas), "safe": False,
        "idempotent": operation.method in _IDEMPOTENT, "forms": [form],
    }  # fmt: skip
    body = operation.document.get("requestBody", {}).get("content", {})
    if body:
        media = _JSON if _JSON in body else next(iter(body))
        form["contentType"] = media
        found["input"] = schemas.of(body[media].get("schema", {}))
    if _JSON in operation.content():
        found["output"] = schemas.of(operation.content()[_JSON].get("schema", {}))
    return found


def _event(operation: _Operation, twin: str) -> dict[str, Any]:
    form = {"href": _href(operation, twin), "op": ["subscribeevent", "unsubscribeevent"], "contentType": _STREAM,
            "subprotocol": "sse", "htv:methodName": "GET"}  # fmt: skip
    data = {"type": "object", "properties": {name: {"type": kind} for name, kind in _MESSAGE.items()}}
    return {**_about(operation), "data": data, "forms": [form]}


_MESSAGE = {"twin": "string", "epoch": "integer", "seq": "integer", "values": "object", "kind": "string"}
"""Fields of samples and events in a stream."""
