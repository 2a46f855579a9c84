"""When vehicles arrive, and with what: five laws and a mix of classes, each with a pattern and seeded draws."""

from __future__ import annotations

import math
from statistics import NormalDist
from typing import Annotated, Any, Literal, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, field_validator, model_validator

from station.quantities import Part, Pressure, Volume
from station.sections import VehicleType
from station.whole import WHOLE

Floats = NDArray[np.float64]

COUNT_MAX = 20_000
"""More vehicles than one dispenser can fill in PERIOD_MAX."""

PERIOD_MAX = 7 * 86_400
"""A week: its record takes some 100 MB [s]."""

Count = Annotated[int, Field(ge=1, le=COUNT_MAX, description="Number of vehicles"), WHOLE]
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


Bound = TypeVar("Bound")


def _in_order(limits: list[Any]) -> list[Any]:
    if limits[0] > limits[1]:
        raise ValueError(f"must be the least and then the greatest; given {limits[0]:g} and {limits[1]:g}")
    return limits


class Vehicles(NamedTuple):
    """The vehicles of one replication in order of arrival; every array is float64 of shape (n,)."""

    arrival: Floats  # [s], whole seconds
    start_pressure: Floats  # [bar]
    start_temperature: Floats  # [deg C]
    volume: Floats  # [m3]
    finish_pressure: Floats  # [bar]


Range = Annotated[
    list[Bound],
    Field(
        min_length=2, max_length=2,
        description="Least and greatest; vehicles are drawn evenly between them, replication 0 has the middle",
    ),
    AfterValidator(_in_order),
]  # fmt: skip


class VehicleClass(Part):
    """A class of a mixed fleet; what is left out is the station's usual vehicle's."""

    name: Annotated[str, Field(min_length=1, max_length=64, description="Of the class", examples=["bus"])]
    share: Annotated[
        float,
        Field(
            gt=0,
            le=1e6,
            allow_inf_nan=False,
            description="Of all vehicles, relative to the other classes'",
            examples=[1.0],
        ),
    ] = 1.0
    volume_m3: Annotated[
        Range[Volume] | None,
        Field(description="Tank: least, greatest", json_schema_extra={"unit": "m3"}, examples=[[0.4, 0.6]]),
    ] = None
    start_pressure_bar: Annotated[
        Range[Pressure] | None,
        Field(description="At connection: least, greatest", json_schema_extra={"unit": "bar"}, examples=[[20, 100]]),
    ] = None
    finish_pressure_bar: Annotated[
        Range[Pressure] | None,
        Field(description="On leaving: least, greatest", json_schema_extra={"unit": "bar"}, examples=[[350, 350]]),
    ] = None


class Law(Part):
    """Base of the laws that draw vehicles."""

    fleet: Annotated[
        list[VehicleClass],
        Field(
            default_factory=list, max_length=20,
            description="Classes that vehicles are drawn from; empty: all are the station's usual one",
        ),
    ]  # fmt: skip


class Uniform(Law):
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


class Normal(Law):
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


class Poisson(Law):
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


class Profile(Law):
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


def sample(arrivals: Any, usual: VehicleType, replication: int, seed: int) -> Vehicles:
    """The vehicles of one replication.

    Replication 0 is the quantile pattern with the usual start pressure. Replication k >= 1 draws arrival times
    from the same law and start pressures from a uniform law around the usual one, with a generator seeded by
    (seed, k) alone: every controller meets the same vehicles. Where there is a fleet, classes, tanks, start and finish
    pressures are drawn from it.
    """
    if isinstance(arrivals, Trace):
        return _from_trace(arrivals, usual)
    random = None
    if replication == 0:
        arrival = arrivals.pattern()
        start = np.full(len(arrival), usual.start_pressure_bar)
    else:
        random = np.random.default_rng([seed, replication])
        arrival = arrivals.draw(random)
        spread = usual.start_pressure_spread_bar * (2.0 * random.random(len(arrival)) - 1.0)
        start = usual.start_pressure_bar + spread
    count = len(arrival)
    drawn = Vehicles(
        arrival=np.sort(np.rint(arrival)),
        start_pressure=start,
        start_temperature=np.full(count, usual.start_temperature_c),
        volume=np.full(count, usual.volume_m3),
        finish_pressure=np.full(count, usual.finish_pressure_bar),
    )
    return _mixed(arrivals.fleet, drawn, random) if arrivals.fleet else drawn


def _mixed(fleet: list[VehicleClass], vehicles: Vehicles, random: np.random.Generator | None) -> Vehicles:
    """The same arrivals by vehicles of a fleet's classes; without a generator in turns, with the middle of each range.

    In turns: the next vehicle is of the class that is furthest behind its share.
    """
    count, shares = len(vehicles.arrival), np.array([each.share for each in fleet])
    shares = shares / shares.sum()
    if random is None:
        levels, chosen, had = np.full((3, count), 0.5), np.zeros(count, np.int64), np.zeros(len(fleet))
        for place in range(count):
            chosen[place] = int(np.argmax(shares * (place + 1) - had))
            had[chosen[place]] += 1
    else:
        chosen, levels = random.choice(len(fleet), count, p=shares), random.random((3, count))
    volume, start, finish = (
        column.copy() for column in (vehicles.volume, vehicles.start_pressure, vehicles.finish_pressure)
    )
    for number, each in enumerate(fleet):
        own = chosen == number
        given = (each.volume_m3, each.start_pressure_bar, each.finish_pressure_bar)
        for column, limits, level in zip((volume, start, finish), given, levels, strict=True):
            if limits is not None:
                column[own] = limits[0] + (limits[1] - limits[0]) * level[own]
    return vehicles._replace(volume=volume, start_pressure=start, finish_pressure=finish)


def _from_trace(trace: Trace, usual: VehicleType) -> Vehicles:
    ordered = sorted(trace.vehicles, key=lambda vehicle: vehicle.time_s)
    return Vehicles(
        arrival=np.rint([vehicle.time_s for vehicle in ordered]),
        start_pressure=np.array([vehicle.start_pressure_bar for vehicle in ordered]),
        start_temperature=np.full(len(ordered), usual.start_temperature_c),
        volume=np.array([vehicle.volume_m3 or usual.volume_m3 for vehicle in ordered]),
        finish_pressure=np.array([vehicle.finish_pressure_bar or usual.finish_pressure_bar for vehicle in ordered]),
    )
