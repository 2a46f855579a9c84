"""Schemas of the OpenAPI document in the terms of a Thing Description, which has neither references nor `anyOf`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

TERMS = (
    "title", "description", "type", "unit", "format", "const", "enum", "default", "minimum", "maximum",
    "exclusiveMinimum", "exclusiveMaximum", "multipleOf", "minLength", "maxLength", "pattern", "minItems", "maxItems",
    "required", "readOnly", "writeOnly",
)  # fmt: skip
"""Terms of a data schema that mean in OpenAPI what they mean there (W3C, Thing Description 1.1, 5.3.2)."""

_REFERENCE = "#/components/schemas/"


class DataSchemas:
    """Data schemas made of the schemas of an OpenAPI document.

    Parameters
    ----------
    schemas
        Its components, by name.
    """

    def __init__(self, schemas: Mapping[str, Any]) -> None:
        self._schemas = schemas

    def of(self, schema: Mapping[str, Any], above: tuple[str, ...] = ()) -> dict[str, Any]:
        """A schema as a data schema; one that holds itself (`above` has those around it) says nothing of that."""
        if "$ref" in schema:
            name = str(schema["$ref"]).removeprefix(_REFERENCE)
            if name in above:
                return {}
            inner = self.of(self._schemas[name], (*above, name))
            return inner | {term: schema[term] for term in ("description", "default") if term in schema}
        found = {term: schema[term] for term in TERMS if term in schema}
        if isinstance(found.get("type"), list):
            found["oneOf"] = [{"type": kind} for kind in found.pop("type")]
        for choice in ("anyOf", "oneOf", "allOf"):
            if choice in schema:
                options = [self.of(each, above) for each in schema[choice]]
                found |= options[0] if len(options) == 1 else {"oneOf": options}
        if isinstance(schema.get("items"), Mapping):
            found["items"] = self.of(schema["items"], above)
        if "properties" in schema:
            found["properties"] = {name: self.of(each, above) for name, each in schema["properties"].items()}
        return found
