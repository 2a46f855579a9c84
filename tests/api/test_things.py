"""Twins described for the Web of Things: a description of the right form, whose forms work."""

from __future__ import annotations

import re

import httpx
import pytest

from api.things.data_schemas import DataSchemas
from api.twins.messages import sample_columns
from tests.api.conftest import RunningService
from tests.api.here import hrs

WORKERS = 0
OPERATIONS = {
    "properties": {"readproperty", "writeproperty", "observeproperty", "unobserveproperty"},
    "actions": {"invokeaction", "queryaction", "cancelaction"},
    "events": {"subscribeevent", "unsubscribeevent"},
}
KINDS = {
    "minimum": (int, float), "maximum": (int, float), "exclusiveMinimum": (int, float), "minLength": int,
    "maxLength": int, "minItems": int, "maxItems": int, "unit": str, "format": str, "description": str, "title": str,
    "enum": list, "oneOf": list, "required": list, "readOnly": bool,
}  # fmt: skip
TYPES = {"boolean", "integer", "number", "string", "object", "array", "null"}


@pytest.fixture(scope="module")
def thing(http):
    http.post("/v1/twins", json={"scenario": "S1", "id": "thing", "paused": True}).raise_for_status()
    answer = http.get("/v1/twins/thing/thing")
    assert (answer.status_code, answer.headers["content-type"]) == (200, "application/td+json")
    yield answer.json()
    http.post("/v1/twins/thing/stop")


def check_data(schema):
    """A data schema is as the Thing Description 1.1 says (5.3.2), all the way down."""
    assert not schema.keys() & {"$ref", "anyOf", "allOf"}
    assert schema.get("type", "null") in TYPES
    for name, kind in KINDS.items():
        assert name not in schema or isinstance(schema[name], kind), name
    inner = [*schema.get("oneOf", []), *schema.get("properties", {}).values()]
    for each in [*inner, *([schema["items"]] if "items" in schema else [])]:
        check_data(each)


def test_a_description_has_the_form_of_thing_description_1_1(thing):
    """What its JSON schema asks for of context, security, affordances, their data and forms."""
    assert thing["@context"] == "https://www.w3.org/2022/wot/td/v1.1"
    assert {"title", "security", "securityDefinitions", "base"} <= thing.keys()
    assert thing["securityDefinitions"] == {thing["security"]: {"scheme": "nosec"}}
    assert re.fullmatch(r"urn:[a-z0-9-]+:.+", thing["id"])
    for kind, operations in OPERATIONS.items():
        assert thing[kind]
        for name, affordance in thing[kind].items():
            assert affordance["forms"], name
            for form in affordance["forms"]:
                asked = {form["op"]} if isinstance(form["op"], str) else set(form["op"])
                assert asked <= operations
                assert form["href"] == form["href"].strip()
            variables = affordance.get("uriVariables", {})
            named = re.findall(r"\{\??([^}]*)\}", affordance["forms"][0]["href"])
            assert {each for part in named for each in part.split(",")} == set(variables), name
            for schema in variables.values():
                check_data(schema)
    for affordance in thing["properties"].values():
        check_data({name: value for name, value in affordance.items() if name not in {"forms", "uriVariables"}})
    for affordance in thing["actions"].values():
        check_data(affordance.get("input", {}))
        check_data(affordance.get("output", {}))
    for affordance in thing["events"].values():
        check_data(affordance["data"])


def test_every_operation_on_a_twin_and_every_signal_is_there(thing, http):
    document = http.get("/openapi.json").json()
    named = {
        operation["operationId"].removeprefix("get_")
        for path, methods in document["paths"].items()
        if path.startswith("/v1/twins/{twin_id}") and not path.endswith("/thing")
        for method, operation in methods.items()
        if method != "get" or {"application/json", "text/event-stream"} & set(operation["responses"]["200"]["content"])
    }
    signals = set(sample_columns(http.get("/v1/twins/thing").json()["layout"]))
    assert {name for kind in OPERATIONS for name in thing[kind]} == named | signals
    assert thing["properties"]["pressure_high"]["properties"]["value"]["unit"] == "bar"
    assert thing["properties"]["pressure_high"]["forms"][0]["href"].endswith("/hrs/v1/thing/signal/pressure_high")


def test_who_knows_the_description_alone_reads_and_acts(thing):
    """Forms are followed as they stand, with nothing else known of the service."""
    with httpx.Client(base_url=thing["base"], trust_env=False) as client:

        def invoke(affordance, **more):
            form = affordance["forms"][0]
            return client.request(form["htv:methodName"], form["href"].partition("{?")[0], **more)

        for name in ("twin", "history", "days", "events", "alarms", "drills", "twin_scenario"):
            answer = invoke(thing["properties"][name])
            assert answer.status_code == 200, name
            known = thing["properties"][name].get("properties", {})
            assert known == {} or set(answer.json()) <= set(known), name
        change = thing["actions"]["change_twin"]
        assert invoke(change, json={"speed": 60.0}).json()["speed"] == 60.0
        assert change["input"]["properties"].keys() >= {"speed", "paused", "controller"}


def test_a_twin_that_is_not_there_has_no_description(http):
    answer = http.get("/v1/twins/nothing/thing")
    assert (answer.status_code, answer.json()["type"]) == (404, "urn:hrs-twin:problem:not-found")


@pytest.mark.full
def test_where_keys_are_asked_for_the_description_says_so(tmp_path):
    key = hrs("keys", "create", "ann", "--data", tmp_path).stdout.strip()
    running = RunningService(tmp_path, "--host", "0.0.0.0", "--workers", "0")  # noqa: S104  # what needs the keys
    with httpx.Client(base_url=running.url, trust_env=False) as client:
        assert client.get("/v1/twins/any/thing").status_code == 401
        client.headers["Authorization"] = f"Bearer {key}"
        client.post("/v1/twins", json={"scenario": "S1", "id": "any", "paused": True}).raise_for_status()
        found = client.get("/v1/twins/any/thing").json()
    running.stop()
    assert found["securityDefinitions"][found["security"]]["scheme"] == "bearer"


def test_schemas_without_references_and_choices():
    schemas = DataSchemas({
        "Tree": {"type": "object", "properties": {"next": {"$ref": "#/components/schemas/Tree"}}},
        "Name": {"type": "string", "maxLength": 3},
    })  # fmt: skip
    assert schemas.of({"$ref": "#/components/schemas/Tree"}) == {"type": "object", "properties": {"next": {}}}
    either = {"anyOf": [{"$ref": "#/components/schemas/Name"}, {"type": "null"}], "description": "A name"}
    choices = [{"type": "string", "maxLength": 3}, {"type": "null"}]
    assert schemas.of(either) == {"description": "A name", "oneOf": choices}
    assert schemas.of({"allOf": [{"$ref": "#/components/schemas/Name"}]}) == {"type": "string", "maxLength": 3}
    assert schemas.of({"type": ["string", "null"]}) == {"oneOf": [{"type": "string"}, {"type": "null"}]}
