"""Prices by which controllers are compared at a twin."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field

from api.http.strict import Body


def _price(unit: str, about: str, example: float) -> Any:
    return Field(
        ge=0, le=1e4, allow_inf_nan=False, description=about, json_schema_extra={"unit": unit}, examples=[example]
    )


class ForecastPrices(Body):
    """Prices by which controllers are ranked, besides the tariff of the station."""

    energy_eur_per_kwh: Annotated[float, _price("EUR/kWh", "Of energy, where the station has no tariff", 0.3)] = 0.3
    waiting_eur_per_h: Annotated[float, _price("EUR/h", "Of an hour that a vehicle waits", 20)] = 20.0
    unserved_eur: Annotated[float, _price("EUR", "Of a vehicle that leaves before it is full", 50)] = 50.0
