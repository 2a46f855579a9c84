"""Controllers as lists show them."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, Field


class ControllerSummary(BaseModel):
    """A controller that is installed."""

    name: Annotated[str, Field(description="What requests call it", examples=["minlp1"])]
    about: Annotated[
        str, Field(description="One line on it", examples=["MINLP with c_eng = c_b = c_v = 1 (Table 7.2)"])
    ]
    options: Annotated[
        dict[str, Any],
        Field(
            description="JSON schema of its options, given as `name:option=value`; a station's preset sets most",
            examples=[{"properties": {"horizon": {"type": "integer", "minimum": 1, "maximum": 20, "default": 1}}}],
        ),
    ]
