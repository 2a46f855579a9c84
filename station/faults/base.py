"""When a fault is there, and what every kind of fault tells of itself."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import Annotated, Any, ClassVar

from pydantic import Field, model_validator

from station.quantities import Part

Seconds = Annotated[float, Field(ge=0, le=1e9, allow_inf_nan=False, json_schema_extra={"unit": "s"})]


class BaseFault(Part, ABC):
    """When a fault is there: from `begin_s` on, up to `end_s` or for ever."""

    OF_PLANT: ClassVar[bool] = False

    begin_s: Annotated[Seconds, Field(description="From this second of the run on", examples=[20_000.0])]
    end_s: Annotated[
        Seconds | None,
        Field(description="Up to this second; left out: to the end of the run", examples=[24_000.0]),
    ] = None

    @model_validator(mode="after")
    def _ordered(self) -> BaseFault:
        if self.end_s is not None and self.end_s <= self.begin_s:
            raise ValueError(f"end_s must lie behind begin_s {self.begin_s:g} s; given {self.end_s:g}")
        return self

    def there(self, time: float) -> bool:
        """Whether it is there at a time [s]."""
        return self.begin_s <= time < self.until

    @property
    def until(self) -> float:
        """When it ends [s]; infinite: never."""
        return math.inf if self.end_s is None else self.end_s

    @property
    @abstractmethod
    def event(self) -> str:
        """The name of the event that tells it."""

    @property
    def size(self) -> tuple[float, str] | None:
        """How large it is, in the unit of its event; None where it has no size."""
        return None

    def told(self) -> dict[str, Any]:
        """The event that tells it, when it is there [s], its size and the unit of that, as answers show a fault."""
        size, unit = self.size or (None, None)
        return {"event": self.event, "begin_s": self.begin_s, "end_s": self.end_s, "size": size, "unit": unit}
