"""How well a station is known: parameter and sensor error, and the plant that is drawn within it."""

from __future__ import annotations

from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from pydantic import Field

from station.quantities import Part
from station.whole import WHOLE

C = TypeVar("C", bound=Any)
"""Constants of a plant that have the names below."""

RELATIVE = (
    "inlet_coefficient",
    "outlet_coefficient",
    "inlet_heating",
    "outlet_cooling",
    "vehicle_heating",
    "heat_exchange",
)
"""Constants known to a relative error: flow coefficients, heat rates and the heat exchange."""

READ = {"compressor_pressure": "pressure_bar", "ambient_temperature": "temperature_k"}
"""Constants somebody reads off an instrument, and the error of that instrument."""

TANK = "vehicle_volume"
"""The tank of a vehicle that reports nothing, known as the parameters are."""


def _half_width(unit: str, most: float, about: str) -> Any:
    return Field(ge=0, le=most, allow_inf_nan=False, description=about, json_schema_extra={"unit": unit})


Share = Annotated[float, Field(ge=-1, le=1, allow_inf_nan=False)]
Varying = Literal[
    "inlet_coefficient", "outlet_coefficient", "inlet_heating", "outlet_cooling", "vehicle_heating", "heat_exchange",
    "compressor_pressure", "ambient_temperature", "vehicle_volume",
]  # fmt: skip


class Uncertainty(Part):
    """Half-widths of what is not known exactly. Buffer volumes, limits and finish pressures are exact.

    The compressor's pressure and the ambient temperature are readings: known to the sensors' error.
    """

    parameters: Annotated[
        float, _half_width("1", 0.3, "Relative error of flow coefficients, heat rates and heat exchange")
    ] = 0.05
    pressure_bar: Annotated[float, _half_width("bar", 20, "Error of a pressure reading")] = 1.0
    temperature_k: Annotated[float, _half_width("K", 10, "Error of a temperature reading")] = 0.5


class Disturbance(Part):
    """Disturbances that a run simulates beside the stated uncertainty; the shield's margins hold for all of it."""

    uncertainty: Uncertainty = Uncertainty()
    sensors: Annotated[
        Literal["exact", "uniform", "corner"],
        Field(description="Errors of the readings: none, uniform within the half-widths, or always at their ends"),
    ] = "uniform"
    plant: Annotated[
        Literal["nominal", "uniform", "corner"],
        Field(description="The plant simulated: the station's parameters, or drawn within their error, or at its ends"),
    ] = "uniform"
    shares: Annotated[
        dict[Varying, Share],
        Field(description="Parameters set to this share of their half-width, -1 to 1, instead of drawn"),
    ] = {}  # noqa: RUF012  # pydantic copies it
    seed: Annotated[
        int, Field(ge=0, lt=2**31, description="Of the plant's parameters and the sensors' errors"), WHOLE
    ] = 0

    def drawn(self, *, tanks: bool) -> bool:
        """Whether replications differ; `tanks` says whether vehicles report nothing, so that theirs are drawn."""
        known = self.uncertainty
        if self.sensors != "exact" and (known.pressure_bar or known.temperature_k):
            return True
        widths = {**dict.fromkeys(RELATIVE, known.parameters), TANK: known.parameters if tanks else 0.0}
        widths |= {name: getattr(known, error) for name, error in READ.items()}
        return self.plant != "nominal" and any(widths[name] and name not in self.shares for name in widths)

    def _shares(self, replication: int) -> dict[str, Any]:
        """Share of its half-width by which each varying constant deviates; heat rates have one a buffer."""
        random = np.random.default_rng([self.seed, replication, 1])
        drawn: dict[str, Any] = {}
        for name in (*RELATIVE, *READ):
            count = 3 if name in {"inlet_heating", "outlet_cooling"} else 1
            draw = random.random(count)
            share = {"nominal": 0.0 * draw, "uniform": 2.0 * draw - 1.0, "corner": np.sign(draw - 0.5)}[self.plant]
            share = np.full(count, self.shares[name]) if name in self.shares else share
            drawn[name] = share.tolist() if count == 3 else float(share[0])
        return drawn

    def sample(self, plant: C, replication: int) -> C:
        """The plant that is simulated where `plant` is believed; the same for the same seed and replication."""
        return deviated(plant, self.uncertainty, self._shares(replication))

    def tanks(self, count: int, replication: int) -> np.ndarray:
        """Factors of the volumes of vehicles that report nothing, (count,)."""
        draw = np.random.default_rng([self.seed, replication, 2]).random(count)
        share = {"nominal": 0.0 * draw, "uniform": 2.0 * draw - 1.0, "corner": np.sign(draw - 0.5)}[self.plant]
        if TANK in self.shares:
            share = np.full(count, self.shares["vehicle_volume"])
        return 1.0 + self.uncertainty.parameters * share


def deviated(plant: C, uncertainty: Uncertainty, shares: dict[str, Any]) -> C:
    """`plant` with each named constant moved by a share (-1 to 1) of its half-width, in the numbers of `plant`.

    A share of a heat rate is a number or one number a buffer.
    """
    number = type(plant.heat_exchange)
    moved: dict[str, Any] = {}
    for name, share in shares.items():
        value = getattr(plant, name)
        if name in READ:
            moved[name] = value + number(getattr(uncertainty, READ[name])) * number(share)
            continue
        width = number(uncertainty.parameters)
        if isinstance(value, tuple):
            each = share if isinstance(share, list | tuple) else [share] * len(value)
            moved[name] = tuple(item * (1 + width * number(one)) for item, one in zip(value, each, strict=True))
        else:
            moved[name] = value * (1 + width * number(share))
    return plant._replace(**moved)
