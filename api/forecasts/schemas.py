"""Forecasts as requests ask for them, and as answers show them."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Self

from pydantic import BaseModel, Field, model_validator

from api.http.pagination import Next
from api.http.strict import Body
from api.jobs.schemas import ControllerSpec, JobStatus
from api.scenarios.schemas import ScenarioInput, Seed
from api.twins.prices import ForecastPrices
from station.quantities import Pressure, Volume
from station.whole import WHOLE

HORIZON_MAX = 86_400
"""Longest forecast [s]."""

FUTURES_MAX = 2000
"""Most futures of a forecast."""

CONTROLLERS_MAX = 6
"""Most controllers of a forecast, the one that acts among them."""

ANNOUNCED_MAX = 200
"""Most vehicles that a forecast announces."""

WORK_MAX = 20_000_000
"""Most seconds that a forecast simulates: controllers x futures x horizon [s]."""


FIGURE_MAX = 1e12
"""Beyond the figures of any forecast."""


class ForecastDemand(StrEnum):
    """The vehicles of futures besides those at the station and those announced."""

    ANNOUNCED = "announced"  # none
    LEARNED = "learned"  # a Poisson process like what came so far, its rate drawn from its posterior
    LAW = "law"  # as the law of a scenario draws them


class ForecastFaults(StrEnum):
    """What becomes of the faults that the station has now."""

    LAST = "last"  # those found of a twin that follows measurements, those put into a simulated one
    MENDED = "mended"  # there are none


class AnnouncedVehicle(Body):
    """A vehicle that will come; what is left out is the station's usual vehicle's."""

    in_s: Annotated[
        float,
        Field(
            ge=0, le=HORIZON_MAX, allow_inf_nan=False, description="It arrives so long from now",
            json_schema_extra={"unit": "s"}, examples=[600],
        ),
    ]  # fmt: skip
    start_pressure_bar: Annotated[Pressure, Field(examples=[120.0])]
    volume_m3: Annotated[Volume | None, Field(description="Of its tank", examples=[0.14])] = None
    finish_pressure_bar: Annotated[Pressure | None, Field(description="It leaves with this", examples=[690.0])] = None


class ForecastRequest(Body):
    """A question to a live twin: what will each of these controllers make of the time to come."""

    controllers: Annotated[
        list[ControllerSpec],
        Field(
            min_length=1, max_length=CONTROLLERS_MAX,
            description="To be compared; the one that acts is among them in any case", examples=[["logic", "minlp1"]],
        ),
    ]  # fmt: skip
    horizon_s: Annotated[
        int,
        Field(
            ge=60, le=HORIZON_MAX, multiple_of=60, description="Length, in whole minutes",
            json_schema_extra={"unit": "s"}, examples=[3600],
        ),
        WHOLE,
    ] = 3600  # fmt: skip
    futures: Annotated[int, Field(ge=1, le=FUTURES_MAX, description="Futures of each", examples=[200]), WHOLE] = 200
    arrivals: Annotated[
        ForecastDemand,
        Field(
            strict=False,
            description="Vehicles to come besides those announced: none (`announced`), like those that came so far "
            "(`learned`), or by the law of a scenario (`law`)",
            examples=["law"],
        ),
    ] = ForecastDemand.LAW
    law: Annotated[
        ScenarioInput | None,
        Field(description="The scenario whose law draws vehicles; left out: the twin's own", examples=["S3"]),
    ] = None
    announced: Annotated[
        list[AnnouncedVehicle],
        Field(
            default_factory=list, max_length=ANNOUNCED_MAX, description="Vehicles that will come in every future",
            examples=[[]],
        ),
    ]  # fmt: skip
    faults: Annotated[
        ForecastFaults,
        Field(
            strict=False,
            description="Faults that the station has: they `last`, as the twin that follows it has found them (of a "
            "simulated one, as they were put in), or are `mended` when the forecast begins",
            examples=["last"],
        ),
    ] = ForecastFaults.LAST
    prices: Annotated[
        ForecastPrices, Field(description="What energy, waiting and service cost", examples=[{"waiting_eur_per_h": 20}])
    ] = ForecastPrices()
    seed: Seed = 0

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if self.law is not None and self.arrivals is not ForecastDemand.LAW:
            raise ValueError(f"law must be left out where arrivals is {self.arrivals.value!r}")
        work = (1 + len(set(self.controllers))) * self.futures * self.horizon_s
        if work > WORK_MAX:
            raise ValueError(
                f"controllers x futures x horizon_s must not exceed {WORK_MAX} s, with the one that acts; given {work}"
            )
        late = [vehicle.in_s for vehicle in self.announced if vehicle.in_s > self.horizon_s]
        if late:
            raise ValueError(f"announced.in_s must not exceed horizon_s = {self.horizon_s}; given {late[0]:g}")
        return self


FutureFigure = Annotated[float, Field(ge=-FIGURE_MAX, le=FIGURE_MAX)]
"""A figure of futures."""


class ForecastFigure(BaseModel):
    """Quantiles of a figure over the futures, and its mean; null where the station does not tell it."""

    low: Annotated[FutureFigure | None, Field(description="5 % of the futures lie below", examples=[0.0])]
    median: Annotated[FutureFigure | None, Field(description="Half of them", examples=[12.0])]
    high: Annotated[FutureFigure | None, Field(description="95 % of them", examples=[63.0])]
    mean: Annotated[FutureFigure | None, Field(description="Mean", examples=[19.2])]
    unit: Annotated[str, Field(description="Unit", examples=["s"])]


class PressureBand(BaseModel):
    """Quantiles of a buffer's pressure over the futures, at each of `time_s`."""

    low: Annotated[list[float], Field(description="5 %", json_schema_extra={"unit": "bar"}, examples=[[812.0, 790.4]])]
    median: Annotated[
        list[float], Field(description="Half", json_schema_extra={"unit": "bar"}, examples=[[812.0, 803.1]])
    ]
    high: Annotated[
        list[float], Field(description="95 %", json_schema_extra={"unit": "bar"}, examples=[[812.0, 815.7]])
    ]


class ControllerForecast(BaseModel):
    """The futures of one controller."""

    controller: ControllerSpec
    figures: Annotated[
        dict[str, ForecastFigure],
        Field(
            description="`wait` of a vehicle, `vehicles`, `served`, `incomplete`, `waiting` at the end, `shortage` "
            "(a vehicle connected and no outlet open), `delivered`, `compressing`, `energy`, `cost`",
            examples=[{"wait": {"low": 0.0, "median": 12.0, "high": 63.0, "mean": 19.2, "unit": "s"}}],
        ),
    ]
    pressures: Annotated[
        dict[str, PressureBand],
        Field(description="Of each buffer", examples=[{"high": {"low": [812.0], "median": [812.0], "high": [812.0]}}]),
    ]


class RankedController(BaseModel):
    """A controller by its mean score: cost, waiting and vehicles unserved at their prices."""

    controller: ControllerSpec
    score: Annotated[FutureFigure, Field(description="Mean", json_schema_extra={"unit": "EUR"}, examples=[50.5])]
    saves: Annotated[
        FutureFigure | None,
        Field(
            description="Mean cost saved against the one that acts; null where the station tells none",
            json_schema_extra={"unit": "EUR"}, examples=[1.4],
        ),
    ]  # fmt: skip
    waits: Annotated[
        FutureFigure,
        Field(
            description="Mean wait added for each vehicle against it", json_schema_extra={"unit": "s"}, examples=[-20.0]
        ),
    ]
    loses: Annotated[
        FutureFigure,
        Field(
            description="Mean number added to the vehicles that leave before they are full",
            json_schema_extra={"unit": "vehicles"}, examples=[0.0],
        ),
    ]  # fmt: skip
    beats: Annotated[
        float, Field(ge=0, le=1, description="Share of the futures in which it scores better than it", examples=[0.9])
    ]
    best: Annotated[
        float, Field(ge=0, le=1, description="Share of the futures in which nothing scores better", examples=[0.8])
    ]


class ForecastAnswer(BaseModel):
    """What was found."""

    time_s: Annotated[
        list[float],
        Field(
            description="Times of the bands since the twin's start", json_schema_extra={"unit": "s"},
            examples=[[7200.0, 7260.0]],
        ),
    ]  # fmt: skip
    controllers: Annotated[
        list[ControllerForecast], Field(description="By controller, the one that acts first", examples=[[]])
    ]
    ranking: Annotated[list[RankedController], Field(description="Least mean score first", examples=[[]])]
    advice: Annotated[
        str,
        Field(
            description="The ranking in words",
            examples=["minlp1 would save 1.40 EUR and 20 s of waiting a vehicle in 1 h; better in 90 of 100 futures"],
        ),
    ]


class ForecastCame(BaseModel):
    """What came of a forecast, under the controller that acted."""

    covered: Annotated[
        float | None,
        Field(
            ge=0,
            le=1,
            description="Share of the pressures within their bands, where these are wider than 1 bar; null: none is",
            examples=[0.92],
        ),
    ]
    error: Annotated[
        float | None,
        Field(
            ge=0, description="Median distance of the pressures from the medians",
            json_schema_extra={"unit": "bar"}, examples=[1.8],
        ),
    ]  # fmt: skip
    until_s: Annotated[
        float,
        Field(ge=0, description="How far it has come", json_schema_extra={"unit": "s"}, examples=[10_800.0]),
    ]
    changed: Annotated[
        bool, Field(description="Another controller decided meanwhile: then nothing is held against", examples=[False])
    ]


class ForecastFault(BaseModel):
    """A fault of the station in every future."""

    event: Annotated[str, Field(description="Name of the event that tells it", examples=["compressor_weak"])]
    begin_s: Annotated[
        float,
        Field(ge=0, description="From this second of the twin on", json_schema_extra={"unit": "s"}, examples=[5400.0]),
    ]
    end_s: Annotated[
        float | None,
        Field(ge=0, description="Up to this one; null: for ever", json_schema_extra={"unit": "s"}, examples=[None]),
    ]
    size: Annotated[FutureFigure | None, Field(description="How large it is; null: it has no size", examples=[19.6])]
    unit: Annotated[str | None, Field(description="Of its size", examples=["%"])]


class Forecast(JobStatus):
    """A forecast and, when it is done, what was found."""

    twin: Annotated[str, Field(description="Id of the twin", examples=["demo"])]
    begin_s: Annotated[
        float,
        Field(
            ge=0,
            description="When it begins, since the twin's start",
            json_schema_extra={"unit": "s"},
            examples=[7200.0],
        ),
    ]
    horizon_s: Annotated[
        int, Field(ge=60, le=HORIZON_MAX, description="Its length", json_schema_extra={"unit": "s"}, examples=[3600])
    ]
    futures: Annotated[int, Field(ge=1, le=FUTURES_MAX, description="Futures of each controller", examples=[200])]
    arrivals: Annotated[ForecastDemand, Field(description="Vehicles to come", examples=["law"])]
    faults: Annotated[
        list[ForecastFault],
        Field(
            description="Faults of the station in every future",
            examples=[[{"event": "compressor_weak", "begin_s": 5400.0, "end_s": None, "size": 19.6, "unit": "%"}]],
        ),
    ]
    mended: Annotated[
        bool, Field(description="Whether faults that the station has were mended in all futures", examples=[False])
    ]
    doubt: Annotated[
        str,
        Field(description="Why faults that were found are in no future; empty where there is no doubt", examples=[""]),
    ]
    names: Annotated[
        list[ControllerSpec], Field(description="Controllers, the one that acts first", examples=[["logic"]])
    ]
    done: Annotated[int, Field(ge=0, description="Controllers whose futures are run", examples=[1])]
    answer: Annotated[
        ForecastAnswer | None,
        Field(description="Null until done, and in lists", examples=[None]),
    ]
    came: Annotated[
        ForecastCame | None,
        Field(description="What came of it; null before, in lists, and where the twin is gone", examples=[None]),
    ] = None


class ForecastPage(BaseModel):
    """Forecasts, the newest first; without their answers."""

    items: Annotated[list[Forecast], Field(description="Forecasts", examples=[[]])]
    next: Next
