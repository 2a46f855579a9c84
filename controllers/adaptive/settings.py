"""Settings of the adaptive controller: those of `switched`, and how far the constants may be wrong."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from controllers.switched.settings import SwitchedSettings


class AdaptiveSettings(SwitchedSettings):
    """Settings of `adaptive`: those of `switched`, and how far the constants may lie from the station's figures."""

    parameters: Annotated[
        float | None,
        Field(
            ge=0,
            le=0.3,
            allow_inf_nan=False,
            description="Relative error of flow coefficients, heat rates and heat exchange; left out: as the "
            "scenario's disturbance states it, 0.2 where it states none",
            json_schema_extra={"unit": "1"},
        ),
    ] = None
