"""Shadows as requests ask for them: controllers that are held against the one that acts."""

from __future__ import annotations

import math
from typing import Annotated, Self

from pydantic import ConfigDict, Field, model_validator

from api.http.strict import Body
from api.jobs.schemas import ControllerSpec
from api.twins.prices import ForecastPrices
from station.whole import WHOLE

SHADOWS_MAX = 5
"""Most controllers beside the one that acts."""

EVERY_MIN, EVERY_MAX = 300, 86_400
"""Bounds of the time between the begins of two stretches [s]."""

STRETCH_MIN, STRETCH_MAX = 300, 21_600
"""Bounds of the length of a stretch [s]."""

OPEN_MAX = 24
"""Most stretches of a twin that last at the same time."""

_MINUTE = 60


class ShadowRequest(Body):
    """Controllers beside the one that acts: what each would have made of the same stretches of time."""

    model_config = ConfigDict(frozen=True)

    controllers: Annotated[
        list[ControllerSpec],
        Field(
            min_length=1, max_length=SHADOWS_MAX, description="Beside the one that acts",
            examples=[["minlp1", "reserve"]],
        ),
    ]  # fmt: skip
    every_s: Annotated[
        int,
        Field(
            ge=EVERY_MIN, le=EVERY_MAX, multiple_of=_MINUTE, description="A stretch begins so often",
            json_schema_extra={"unit": "s"}, examples=[900],
        ),
        WHOLE,
    ] = 900  # fmt: skip
    horizon_s: Annotated[
        int,
        Field(
            ge=STRETCH_MIN, le=STRETCH_MAX, multiple_of=_MINUTE, description="Length of a stretch",
            json_schema_extra={"unit": "s"}, examples=[3600],
        ),
        WHOLE,
    ] = 3600  # fmt: skip
    prices: Annotated[
        ForecastPrices, Field(description="What energy, waiting and service cost", examples=[{"waiting_eur_per_h": 20}])
    ] = ForecastPrices()

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if again := next((name for name in self.controllers if self.controllers.count(name) > 1), None):
            raise ValueError(f"controllers must differ; {again!r} stands there twice")
        lasting = math.ceil(self.horizon_s / self.every_s)
        if lasting > OPEN_MAX:
            raise ValueError(
                f"horizon_s must be at most {OPEN_MAX} x every_s; given {self.horizon_s} and {self.every_s}"
            )
        return self
