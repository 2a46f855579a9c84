"""Keys as requests ask for them and answers show them."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated

from pydantic import AwareDatetime, BaseModel, Field

from api.http.strict import Body
from api.scopes import USUAL, Scope

Name = Annotated[
    str, Field(min_length=1, max_length=64, description="Whose key it is; never used again", examples=["ann"])
]
PRINTED = r"^[^\x00-\x1f\x7f]*$"
"""Names are listed in terminals, where control characters would do things."""

Scopes = Annotated[
    list[Annotated[Scope, Field(strict=False)]],
    Field(min_length=1, max_length=5, description="What it may do; each includes reading", examples=[["read", "run"]]),
]


class KeyRequest(Body):
    """A key to make."""

    name: Annotated[Name, Field(pattern=PRINTED)]
    scopes: Scopes = list(USUAL)  # noqa: RUF012  # pydantic copies it


class KeySummary(BaseModel):
    """A key as lists show it; the key itself is not stored."""

    name: Name
    scopes: Scopes
    created: Annotated[AwareDatetime, Field(description="When", examples=["2026-03-01T08:00:00Z"])]
    revoked: Annotated[datetime | None, Field(description="When it was revoked", examples=[None])]


class ZenohLogin(BaseModel):
    """The login at the service's zenoh router of the holder of a key."""

    user: Annotated[str, Field(description="The key's name, with %XX for what is not plain", examples=["ann"])]
    password: Annotated[str, Field(description="Another text than the key", examples=["1b0c..."])]


class NewKey(KeySummary):
    """A key just made."""

    key: Annotated[str, Field(description="Told this once", examples=["hrs_..."])]
    zenoh: Annotated[
        ZenohLogin | None,
        Field(
            description="User and password at the zenoh router, where that asks for keys",
            examples=[{"user": "ann", "password": "1b0c..."}],
        ),
    ] = None
