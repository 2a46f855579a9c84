"""A stretch of a twin's time as a job: every controller runs it from the same state, with the vehicles that came."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np

from api.forecasts.job import fork_in, packed, unpacked
from api.jobs.work import JobType, Spec, encoded_rows, single_chunk, whole_spec
from api.store.records import ChunkResult
from api.twins.shadow_log import Stretch
from api.twins.shadow_schemas import ShadowRequest
from controllers.contenders import contender
from station import Scenario
from station.archives import arrays_under
from station.arrivals import Trace, Vehicles
from station.forecasting.accounts import Account
from station.forecasting.forecast import Forecast, Price, forecast, scores
from station.forecasting.futures import UNITS
from station.geometry import BUFFERS


def shadow_spec(
    twin: str, scenario: Scenario, replication: int, stretch: Stretch, asked: ShadowRequest
) -> Spec:  # fmt: skip
    """A job of a stretch that is over; the first controller is the one that acted, or that others are held against."""
    acting = (stretch.controller,) if stretch.controller else ()
    came = {
        "came": np.array(stretch.came, np.float64).reshape(-1, len(Vehicles._fields)).T,
        "pressures": np.array(stretch.pressures, np.float64).reshape(-1, len(BUFFERS)),
    }
    return {
        "twin": twin, "scenario": _without_trace(scenario).model_dump(mode="json"), "replication": replication,
        "controllers": list(dict.fromkeys((*acting, *asked.controllers))),
        "begin_s": stretch.begin, "horizon_s": stretch.end - stretch.begin, "every_s": asked.every_s,
        "prices": asked.prices.model_dump(), "changed": stretch.changed, "acted": bool(acting),
        "fork": base64.b64encode(stretch.state).decode(), "came": packed(came),
    }  # fmt: skip


def _without_trace(scenario: Scenario) -> Scenario:
    """A scenario without its recorded day, which may be megabytes: the vehicles that came are told beside it."""
    arrivals = scenario.arrivals
    if not isinstance(arrivals, Trace) or scenario.disturbance is not None:
        return scenario
    return scenario.model_copy(update={"arrivals": Trace(vehicles=arrivals.vehicles[:1])})


def _summary(spec: Spec) -> dict[str, Any]:
    names = ("twin", "begin_s", "horizon_s", "every_s", "controllers", "changed", "acted", "prices")
    return {name: spec[name] for name in names}


def _compute(task: dict[str, Any]) -> ChunkResult:
    """Figures and score of each controller, and how far the one that acted is from what was told."""
    scenario, fork, arrays = fork_in(task)
    came = unpacked(task["came"])
    memories, horizon, prices = arrays_under(arrays, "memory_"), task["horizon_s"], task["prices"]
    names = task["controllers"]
    contenders = [
        contender(name, scenario, memories.get("controller"), memories.get("fallback"))
        if task["acted"] and name == names[0]
        else contender(name, scenario)
        for name in names
    ]
    account = Account(scenario, fork, horizon, prices["energy_eur_per_kwh"])
    price = Price(prices["waiting_eur_per_h"], prices["unserved_eur"])
    vehicles = Vehicles(*came["came"])
    found = forecast(fork, contenders, lambda _: vehicles, account, horizon=horizon, futures=1, price=price)
    told = came["pressures"]
    return ChunkResult(encoded_rows(_rows(found, price, told if task["acted"] else told[:0])), 1)


def _rows(found: Forecast, price: Price, told: np.ndarray) -> list[dict[str, Any]]:
    """A row a controller, as JSON holds it; what is not finite is null."""
    acting = found.outcomes[0].pressures[0]
    error = float(np.abs(acting - told).max()) if told.shape == acting.shape else None
    rows = []
    for each, score in zip(found.outcomes, scores(found.outcomes, price)[:, 0].tolist(), strict=True):
        figures = dict(zip(UNITS, each.figures[0].tolist(), strict=True))
        plain = {name: value if np.isfinite(value) else None for name, value in figures.items()}
        rows.append({"controller": each.name, "figures": plain, "score": score, "error_bar": error})
        error = None  # what was told is of the one that acted
    return rows


SHADOW = JobType(_summary, single_chunk, whole_spec, _compute)
