"""The base of the models of request bodies; light, since the command line imports it."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict


class Body(BaseModel):
    """Base of a request's body: unknown fields are errors, and so are texts and booleans where numbers belong.

    Integers are annotated with `station.whole.WHOLE`, since 1.0 is one in JSON; enumerations, which JSON writes
    as texts, and tuples, which it writes as lists, with `Field(strict=False)`.
    """

    model_config = ConfigDict(extra="forbid", strict=True)
