"""Forecasts as jobs: a chunk runs the futures of one controller."""

from __future__ import annotations

import base64
import json
from functools import cache, lru_cache
from typing import Any

import numpy as np

from api.jobs.work import JobType, Spec, encoded_rows
from api.runs.job import parsed_scenario
from api.store.records import Chunk, ChunkResult, Lease
from controllers.contenders import contender
from station import Scenario
from station.archives import pack, unpack
from station.forecasting.accounts import Account
from station.forecasting.demand import Demand, Seen, as_seen, by_law, nobody
from station.forecasting.estimate import drawn
from station.forecasting.forecast import Price, forecast
from station.forecasting.fork import Fork, fork_arrays
from station.forecasting.futures import GRID, Outcomes
from station.geometry import BUFFERS
from station.simulation import start_run


def packed(arrays: dict[str, np.ndarray]) -> str:
    """Arrays as a spec holds them."""
    return base64.b64encode(pack(arrays)).decode()


def unpacked(text: str) -> dict[str, np.ndarray]:
    """The arrays that `packed` wrote."""
    return unpack(base64.b64decode(text))


def fork_in(task: dict[str, Any]) -> tuple[Scenario, Fork, dict[str, np.ndarray]]:
    """The scenario of a task, its fork with vehicles counted from the run's first, and all its arrays."""
    scenario = parsed_scenario(json.dumps(task["scenario"]))
    arrays = unpacked(task["fork"])
    _, parameters = start_run(scenario, task["replication"])
    gone = int(arrays.get("gone", 0))
    fork = Fork(arrays["state"], arrays["counters"], arrays["vehicles"], parameters, scenario.plant_faults, gone)
    return scenario, fork.numbered(), arrays


def forecast_spec(
    twin: str, scenario: Scenario, replication: int, fork: Fork, controllers: list[str], memory: np.ndarray | None,
    seen: Seen, events: int, spread: np.ndarray | None, asked: dict[str, Any],
) -> Spec:  # fmt: skip
    """A job of one forecast: where the twin stands, and what was asked; the first controller is the one that acts."""
    arrays = {**fork_arrays(fork), "seen": seen.vehicles}
    if memory is not None:
        arrays["memory"] = memory
    if spread is not None:
        arrays["spread"] = spread
    return {
        "twin": twin, "scenario": scenario.model_dump(mode="json"), "replication": replication,
        "controllers": controllers, "events": events,
        "faults": [each.told() for each in scenario.plant_faults.behind(fork.time)],
        "fork": packed(arrays), "watched_s": seen.seconds, "begin_s": fork.time, **asked,
    }  # fmt: skip


def _summary(spec: Spec) -> dict[str, Any]:
    names = (
        "twin", "begin_s", "horizon_s", "futures", "arrivals", "controllers", "prices", "events", "faults", "mended",
        "doubt",
    )  # fmt: skip
    return {name: spec[name] for name in names}


def _chunks(spec: Spec) -> list[Chunk]:
    return [Chunk(place, {"controller": place}, 1) for place in range(len(spec["controllers"]))]


def _task(spec: Spec, lease: Lease) -> dict[str, Any]:
    return {**spec, "place": lease.items["controller"]}


@lru_cache(maxsize=1)
def _by_law(scenario: str, law: str | None, begin: float, horizon: float, seed: int) -> Demand:
    """`by_law` of scenarios as JSON, of which each future is drawn once for all controllers of a forecast."""
    own = parsed_scenario(scenario)
    return cache(by_law(own if law is None else parsed_scenario(law).on(own.station), begin, horizon, seed))


def _demand(task: dict[str, Any], scenario: Scenario, seen: Seen) -> Demand:
    begin, horizon, seed = task["begin_s"], task["horizon_s"], task["seed"]
    if task["arrivals"] == "law":
        law = None if task["law"] is None else json.dumps(task["law"])
        return _by_law(scenario.model_dump_json(), law, begin, horizon, seed)
    return as_seen(seen, begin, horizon, seed) if task["arrivals"] == "learned" else nobody


def _compute(task: dict[str, Any]) -> ChunkResult:
    """The futures of one controller: figures of each, and the bands of the pressures."""
    scenario, fork, arrays = fork_in(task)
    spread = arrays.get("spread")
    begun = None if spread is None else drawn(scenario, fork, spread, task["seed"])
    horizon, place, prices = task["horizon_s"], task["place"], task["prices"]
    found = forecast(
        fork,
        [contender(task["controllers"][place], scenario, arrays.get("memory") if place == 0 else None, brief=True)],
        _demand(task, scenario, Seen(arrays["seen"], task["watched_s"])),
        Account(scenario, fork, horizon, prices["energy_eur_per_kwh"]),
        horizon=horizon,
        futures=task["futures"],
        price=Price(prices["waiting_eur_per_h"], prices["unserved_eur"]),
        state=begun,
    )
    return ChunkResult(encoded_rows([_row(found.outcomes[0])]), 1)


def _row(outcomes: Outcomes) -> dict[str, Any]:
    """Futures of a controller as JSON holds them; what is not finite is null."""
    figures = np.where(np.isfinite(outcomes.figures), outcomes.figures, np.nan)
    bands = np.quantile(outcomes.pressures, (0.05, 0.5, 0.95), axis=0)
    return {
        "controller": outcomes.name,
        "figures": [[None if np.isnan(each) else each for each in future] for future in figures.tolist()],
        "grid_s": GRID,
        "pressures": {
            name: dict(zip(("low", "median", "high"), np.round(bands[:, :, place], 3).tolist(), strict=True))
            for place, name in enumerate(BUFFERS)
        },
    }  # fmt: skip


FORECAST = JobType(_summary, _chunks, _task, _compute)
