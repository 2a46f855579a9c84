"""The tariff of a station: energy by the time of day, a charge on its peak, and what stock is worth."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

QUARTER = 900.0
"""What the demand charge takes the mean over: a quarter of an hour, counted from midnight [s]."""

DAY = 86_400.0
"""[s]"""

MONTH = 365 * DAY / 12
"""What the demand charge is paid for [s]."""

_HOUR = 3600.0


def _price(unit: str, about: str) -> Any:
    return Field(ge=0, le=1e4, allow_inf_nan=False, description=about, json_schema_extra={"unit": unit})


class _Section(BaseModel):
    """A group of prices; unknown fields are errors, and so are texts where numbers belong."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class Period(_Section):
    """A part of the day in which a kilowatt-hour has one price."""

    from_h: Annotated[float, Field(ge=0, lt=24, description="Hour of the day", json_schema_extra={"unit": "h"})]
    to_h: Annotated[float, Field(gt=0, le=24, description="Hour of the day", json_schema_extra={"unit": "h"})]
    eur_per_kwh: Annotated[float, _price("EUR/kWh", "Price of energy")]

    @model_validator(mode="after")
    def _lasts(self) -> Period:
        if self.from_h >= self.to_h:
            raise ValueError(
                f"from_h must lie before to_h = {self.to_h:g} h; given {self.from_h:g} h (a night is two periods)"
            )
        return self


class Tariff(_Section):
    """Prices of a station's electricity and hydrogen. A run begins at midnight."""

    energy: Annotated[list[Period], Field(min_length=1, max_length=96, description="The day, without gap or overlap")]
    demand_eur_per_kw_month: Annotated[
        float,
        _price(
            "EUR/(kW month)", "On the highest mean power of a quarter of an hour, by the length of the run in months"
        ),
    ] = 0.0
    stock_eur_per_kg: Annotated[
        Annotated[float, _price("EUR/kg", "Of gas that is missing of the initial stock at the end")] | None,
        Field(description="Left out: the energy that restores it, at the day's mean price"),
    ] = None
    hydrogen_eur_per_kg: Annotated[
        Annotated[float, _price("EUR/kg", "At which hydrogen is sold")] | None,
        Field(description="Left out: nothing is said of revenue"),
    ] = None

    @field_validator("energy")
    @classmethod
    def _whole_day(cls, periods: list[Period]) -> list[Period]:
        end = 0.0
        for period in (*sorted(periods, key=lambda each: each.from_h), None):
            begin = 24.0 if period is None else period.from_h
            if begin > end:
                raise ValueError(f"must cover the day from 0 to 24 h; nothing from {end:g} to {begin:g} h")
            if begin < end and period is not None:
                raise ValueError(f"periods must not overlap; two from {begin:g} to {min(end, period.to_h):g} h")
            end = end if period is None else period.to_h
        return sorted(periods, key=lambda each: each.from_h)

    @property
    def mean(self) -> float:
        """Price of energy, mean over a day [EUR/kWh]."""
        return sum(each.eur_per_kwh * (each.to_h - each.from_h) for each in self.energy) / 24

    def price_at(self, time: NDArray[np.float64]) -> NDArray[np.float64]:
        """Price of energy [EUR/kWh] at times after midnight [s], of whatever day."""
        begins = np.array([each.from_h for each in self.energy]) * _HOUR
        prices = np.array([each.eur_per_kwh for each in self.energy])
        found: NDArray[np.float64] = prices[np.searchsorted(begins, time % DAY, side="right") - 1]
        return found

    def changes(self, duration: float) -> NDArray[np.float64]:
        """Times in a run of `duration` [s] at which a period begins, with 0 and the end, in order."""
        days = np.arange(np.ceil(duration / DAY)) * DAY
        begins = (days[:, None] + np.array([each.from_h for each in self.energy]) * _HOUR).ravel()
        return np.append(begins[begins < duration], duration)
