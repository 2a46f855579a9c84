"""When vehicles arrive, and with what: five laws, each with a quantile pattern and seeded draws."""

from __future__ import annotations

import math
from statistics import NormalDist
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator, model_validator

from station.parameters import Part, Pressure, VehicleType, Volume

Floats = NDArray[np.float64]

COUNT_MAX = 20_000
"""More vehicles than one dispenser can fill in PERIOD_MAX."""

PERIOD_MAX = 7 * 86_400
"""A week: its record takes some 100 MB [s]."""

Count = Annotated[int, Field(ge=1, le=COUNT_MAX, description="Number of vehicles")]
Period = Annotated[
    float,
    Field(
        gt=0, le=PERIOD_MAX, allow_inf_nan=False, description="Span of the arrivals", json_schema_extra={"unit": "s"}
    ),
]
Time = Annotated[
    float,
    Field(ge=0, le=PERIOD_MAX, allow_inf_nan=False, description="Arrival", json_schema_extra={"unit": "s"}),
]


class Vehicles(NamedTuple):
    """The vehicles of one replication in order of arrival; every array is float64 of shape (n,)."""

    arrival: Floats  # [s], whole seconds
    start_pressure: Floats  # [bar]
    start_temperature: Floats  # [deg C]
    volume: Floats  # [m3]
    finish_pressure: Floats  # [bar]


class Uniform(Part):
    """Evenly spaced arrivals with both end points; replications draw from the uniform law."""

    kind: Literal["uniform"] = "uniform"
    count: Count
    period_s: Period

    def pattern(self) -> Floats:
        """Arrival times of replication 0 [s]."""
        return np.linspace(0.0, self.period_s, self.count) if self.count > 1 else np.zeros(1)

    def draw(self, random: np.random.Generator) -> Floats:
        """Random arrival times [s], unordered."""
        return self.period_s * random.random(self.count)


class Normal(Part):
    """A peak in the middle: a normal law cut at +-`truncation` standard deviations, stretched over the period."""

    kind: Literal["normal"] = "normal"
    count: Count
    period_s: Period
    truncation: Annotated[
        float,
        Field(
            ge=0.01,
            le=6,
            allow_inf_nan=False,
            description="Small is flat, large is peaked",
            json_schema_extra={"unit": "standard deviations"},
        ),
    ]

    def _times(self, levels: Floats) -> Floats:
        law, cut = NormalDist(), self.truncation
        low, high = law.cdf(-cut), law.cdf(cut)
        scores = np.array([law.inv_cdf(low + (high - low) * level) for level in levels])
        return np.clip((scores + cut) / (2 * cut), 0.0, 1.0) * self.period_s

    def pattern(self) -> Floats:
        """Arrival times of replication 0 [s]: evenly spaced quantiles with both cut points."""
        return self._times(np.linspace(0.0, 1.0, self.count) if self.count > 1 else np.full(1, 0.5))

    def draw(self, random: np.random.Generator) -> Floats:
        """Random arrival times [s], unordered."""
        return self._times(random.random(self.count))


class Poisson(Part):
    """Arrivals at a constant rate; replications also draw their number."""

    kind: Literal["poisson"] = "poisson"
    rate_per_h: Annotated[
        float, Field(gt=0, le=1000, allow_inf_nan=False, description="Mean arrivals", json_schema_extra={"unit": "1/h"})
    ]
    period_s: Period

    @model_validator(mode="after")
    def _expected(self) -> Poisson:
        expected = self.rate_per_h * self.period_s / 3600
        if not 1 <= expected <= COUNT_MAX:
            raise ValueError(f"rate_per_h x period_s must give 1 to {COUNT_MAX} vehicles; given {expected:g}")
        return self

    def pattern(self) -> Floats:
        """Arrival times of replication 0 [s]: the expected number at the middles of equal spans."""
        count = max(1, round(self.rate_per_h * self.period_s / 3600))
        return self.period_s * (np.arange(count) + 0.5) / count

    def draw(self, random: np.random.Generator) -> Floats:
        """Random arrival times [s], in order; at least one."""
        times: list[float] = []
        now = 0.0
        while len(times) < 2 * COUNT_MAX:
            now -= math.log1p(-random.random()) * 3600 / self.rate_per_h
            if now > self.period_s and times:
                break
            times.append(min(now, self.period_s))
        return np.array(times)


class Profile(Part):
    """A demand profile: one weight an hour, constant within the hour."""

    kind: Literal["profile"] = "profile"
    count: Count
    hourly_weights: Annotated[list[float], Field(min_length=1, max_length=168, description="Demand, one an hour")]

    @field_validator("hourly_weights")
    @classmethod
    def _weights(cls, weights: list[float]) -> list[float]:
        if not all(math.isfinite(weight) and weight >= 0 for weight in weights) or sum(weights) <= 0:
            raise ValueError("hourly_weights must be finite, not negative and not all zero")
        return weights

    @property
    def period_s(self) -> float:
        """Span of the profile [s]."""
        return 3600.0 * len(self.hourly_weights)

    def _times(self, levels: Floats) -> Floats:
        share = np.concatenate(([0.0], np.cumsum(self.hourly_weights))) / sum(self.hourly_weights)
        return np.interp(levels, share, 3600.0 * np.arange(len(share)))

    def pattern(self) -> Floats:
        """Arrival times of replication 0 [s]: quantiles at the middles of equal shares."""
        return self._times((np.arange(self.count) + 0.5) / self.count)

    def draw(self, random: np.random.Generator) -> Floats:
        """Random arrival times [s], unordered."""
        return self._times(random.random(self.count))


class TraceVehicle(Part):
    """A vehicle of a recorded day; what is left out is the station's usual vehicle's."""

    time_s: Time
    start_pressure_bar: Pressure
    volume_m3: Volume | None = None
    finish_pressure_bar: Pressure | None = None


class Trace(Part):
    """A recorded day, the same in every replication."""

    kind: Literal["trace"] = "trace"
    vehicles: Annotated[list[TraceVehicle], Field(min_length=1, max_length=COUNT_MAX)]

    @property
    def period_s(self) -> float:
        """Time of the last arrival [s]."""
        return max(vehicle.time_s for vehicle in self.vehicles)


Arrivals = Annotated[Uniform | Normal | Poisson | Profile | Trace, Field(discriminator="kind")]


def realise(arrivals: Any, usual: VehicleType, replication: int, seed: int) -> Vehicles:
    """The vehicles of one replication.

    Replication 0 is the quantile pattern with the usual start pressure. Replication k >= 1 draws arrival times
    from the same law and start pressures from a uniform law around the usual one, with a generator seeded by
    (seed, k) alone: every controller meets the same vehicles.
    """
    if isinstance(arrivals, Trace):
        return _from_trace(arrivals, usual)
    if replication == 0:
        arrival = arrivals.pattern()
        start = np.full(len(arrival), usual.start_pressure_bar)
    else:
        random = np.random.default_rng([seed, replication])
        arrival = arrivals.draw(random)
        spread = usual.start_pressure_spread_bar * (2.0 * random.random(len(arrival)) - 1.0)
        start = usual.start_pressure_bar + spread
    count = len(arrival)
    return Vehicles(
        arrival=np.sort(np.rint(arrival)),
        start_pressure=start,
        start_temperature=np.full(count, usual.start_temperature_c),
        volume=np.full(count, usual.volume_m3),
        finish_pressure=np.full(count, usual.finish_pressure_bar),
    )


def _from_trace(trace: Trace, usual: VehicleType) -> Vehicles:
    ordered = sorted(trace.vehicles, key=lambda vehicle: vehicle.time_s)
    return Vehicles(
        arrival=np.rint([vehicle.time_s for vehicle in ordered]),
        start_pressure=np.array([vehicle.start_pressure_bar for vehicle in ordered]),
        start_temperature=np.full(len(ordered), usual.start_temperature_c),
        volume=np.array([vehicle.volume_m3 or usual.volume_m3 for vehicle in ordered]),
        finish_pressure=np.array([vehicle.finish_pressure_bar or usual.finish_pressure_bar for vehicle in ordered]),
    )
