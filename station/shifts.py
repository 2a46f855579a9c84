"""The shifts of a station: how long each lasts, and at which hour of the day one begins."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, field_validator

DAY_H = 24
"""[h]"""


class Shifts(BaseModel):
    """Shifts that come again each day. A run begins at midnight."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    shift_h: Annotated[
        int, Field(ge=1, le=DAY_H, description="Length; a day holds whole ones", json_schema_extra={"unit": "h"})
    ] = 8
    first_h: Annotated[
        int, Field(ge=0, lt=DAY_H, description="Hour of the day at which one begins", json_schema_extra={"unit": "h"})
    ] = 0

    @field_validator("shift_h")
    @classmethod
    def _divides(cls, shift_h: int) -> int:
        if DAY_H % shift_h:
            raise ValueError(f"must divide {DAY_H} h, so that shifts begin at the same hours each day; given {shift_h}")
        return shift_h
