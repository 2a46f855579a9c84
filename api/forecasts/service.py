"""Answers of forecasts: from the rows of a job, and against what came afterwards."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from api.forecasts.schemas import (
    ControllerForecast,
    Forecast,
    ForecastAnswer,
    ForecastCame,
    ForecastFigure,
    ForecastRequest,
    PressureBand,
    RankedController,
)
from api.http.timeseries import Selection
from api.jobs.schemas import status_of
from api.store.records import Job, JobState
from api.twins.fork import TwinFork
from api.twins.messages import EventKind
from api.twins.queries import TwinQueries
from api.twins.schemas import of_faults
from controllers.contenders import contender
from station import InputError, Scenario
from station.forecasting.forecast import Band, Price, Ranked, ranked
from station.forecasting.fork import Fork
from station.forecasting.futures import UNITS, Outcomes
from station.geometry import BUFFERS
from station.run import ARRIVAL, DELIVERED, FINISH_PRESSURE, START_PRESSURE, START_TEMPERATURE, VOLUME

CERTAIN_BAR = 1.0
"""Where a band is not wider than this, it says nothing that could be wrong [bar]."""

_LOSES = 0.005
"""A smaller difference of vehicles that leave before they are full would be told as 0."""

EVENTS_MAX = 1000
"""Events looked at for a change of the controller."""


def contenders(fork: TwinFork, asked: ForecastRequest) -> list[str]:
    """The controllers of a forecast, each once; first the one that acts, or the first asked for where it is unknown."""
    acting = (fork.controller,) if fork.controller else ()
    return list(dict.fromkeys((*acting, *asked.controllers)))


def check_forecast(name: str, scenario: Scenario, field: str) -> None:
    """Raise InputError unless a controller runs in the compiled loop: a forecast is hundreds of hours."""
    try:
        contender(name, scenario)
    except InputError as error:
        raise InputError("request", [(field, "; ".join(reason for _, reason in error.problems))]) from None


def mended(fork: TwinFork) -> TwinFork:
    """The fork without the faults of its station."""
    return fork._replace(scenario=of_faults(fork.scenario, [])) if fork.scenario.faults else fork


def announced(fork: TwinFork, asked: ForecastRequest) -> Fork:
    """The fork with what has been announced: by the scenario's announcement so far, and by the request.

    Raises
    ------
    InputError
        naming a vehicle that the station could not fill.
    """
    known = fork.fork.known(fork.scenario.announcement_s)
    usual, station = fork.scenario.station.vehicle, fork.scenario.station
    more = np.full((len(known.vehicles), len(asked.announced)), np.nan)
    for place, vehicle in enumerate(asked.announced):
        field = f"announced.{place}"
        volume, finish = vehicle.volume_m3 or usual.volume_m3, vehicle.finish_pressure_bar or usual.finish_pressure_bar
        try:
            station.check_finish(f"{field}.finish_pressure_bar", finish)
            station.check_tank(f"{field}.volume_m3", volume)
        except ValueError as error:
            raise InputError("request", [("", str(error))]) from None
        if vehicle.start_pressure_bar >= finish:
            reason = f"must lie below the finish pressure {finish:g} bar; given {vehicle.start_pressure_bar:g}"
            raise InputError("request", [(f"{field}.start_pressure_bar", reason)])
        arrival = math.ceil(known.time + vehicle.in_s)
        figures = (arrival, vehicle.start_pressure_bar, usual.start_temperature_c, volume, finish, 0.0)
        more[[ARRIVAL, START_PRESSURE, START_TEMPERATURE, VOLUME, FINISH_PRESSURE, DELIVERED], place] = figures
    return known._replace(vehicles=np.hstack((known.vehicles, more)))


def forecast_of(job: Job, rows: Sequence[dict[str, Any]] = (), came: ForecastCame | None = None) -> Forecast:
    """A stored forecast as answers show it; `rows` hold the futures, one a controller."""
    about = job.summary
    done = job.state is JobState.SUCCEEDED and len(rows) == len(about["controllers"])
    return Forecast(
        **status_of(job),
        twin=about["twin"],
        begin_s=about["begin_s"],
        horizon_s=about["horizon_s"],
        futures=about["futures"],
        arrivals=about["arrivals"],
        faults=about.get("faults", []),  # forecasts of versions before have none
        mended=about.get("mended", False),
        doubt=about.get("doubt", ""),
        names=about["controllers"],
        done=job.runs_done,
        answer=_answer(about, rows) if done else None,
        came=came,
    )


def _answer(about: dict[str, Any], rows: Sequence[dict[str, Any]]) -> ForecastAnswer:
    outcomes = [
        Outcomes(row["controller"], np.array(row["figures"], np.float64), np.empty((0, 0, len(BUFFERS))))
        for row in rows
    ]
    prices = about["prices"]
    order = ranked(outcomes, Price(prices["waiting_eur_per_h"], prices["unserved_eur"]))
    times = about["begin_s"] + rows[0]["grid_s"] * np.arange(len(rows[0]["pressures"][BUFFERS[0]]["low"]))
    return ForecastAnswer(
        time_s=times.tolist(),
        controllers=[
            ControllerForecast(
                controller=each.name,
                figures={name: _figure(each[name], unit) for name, unit in UNITS.items()},
                pressures={name: PressureBand(**band) for name, band in row["pressures"].items()},
            )
            for each, row in zip(outcomes, rows, strict=True)
        ],
        ranking=[
            RankedController(
                controller=each.name, score=each.score, saves=_finite(each.saves), waits=each.waits, loses=each.loses,
                beats=each.beats,
                best=each.best,
            )
            for each in order
        ],
        advice=advice(order, outcomes[0].name, about["horizon_s"], about["futures"]),
    )  # fmt: skip


def _figure(values: np.ndarray, unit: str) -> ForecastFigure:
    band = Band.of(values)
    return ForecastFigure(**{name: _finite(value) for name, value in band._asdict().items()}, unit=unit)


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def advice(order: Sequence[Ranked], acting: str, horizon_s: int, futures: int) -> str:
    """A ranking in words: the best against the controller that acts."""
    best, hours = order[0], f"{horizon_s / 3600:g} h"
    if best.name == acting:
        if len(order) == 1:
            return f"{acting} acts; nothing else was asked for"
        second = order[1]
        share = round((1 - second.beats) * futures)
        return (
            f"{acting}, which acts, is the best for {hours}: better than {second.name} in {share} of {futures} futures"
        )
    money = (
        "" if not math.isfinite(best.saves) else f"{_does('save', 'cost', best.saves)} {abs(best.saves):.2f} EUR and "
    )
    waiting = f"{_does('save', 'cost', -best.waits)} {abs(best.waits):.0f} s of waiting a vehicle"
    full = "" if abs(best.loses) < _LOSES else _incomplete(best.loses)
    share = round(best.beats * futures)
    return (
        f"{best.name} would {money}{waiting}{full} in {hours} against {acting}; better in {share} of {futures} futures"
    )


def _incomplete(loses: float) -> str:
    more = "more" if loses > 0 else "fewer"
    return f", with {abs(loses):.2f} {more} vehicles that leave before they are full,"


def _does(gains: str, loses: str, value: float) -> str:
    return gains if value >= 0 else loses


def came_of(twins: TwinQueries, job: Job, events: int, rows: Sequence[dict[str, Any]]) -> ForecastCame | None:
    """Outcome of a forecast that is done, as far as the twin has come; None where it is gone or has not gone on.

    Nothing comes of one whose faults were mended.

    `events` is how many the twin had told when the forecast began.
    """
    about = job.summary
    twin_id, begin = about["twin"], about["begin_s"]
    if not twins.known(twin_id) or about.get("mended", False):
        return None
    if twins.created(twin_id) > job.created:
        return None  # another twin of that name
    step, head = rows[0]["grid_s"], "measured_" if twins.measures(twin_id) else ""
    names = tuple(f"{head}pressure_{name}" for name in BUFFERS)
    found = twins.columns(twin_id, Selection(names, begin + step, begin + about["horizon_s"], float(step)))
    count = len(found["time"])
    if not count:
        return None
    until = float(found["time"][-1])
    changed = any(
        event["kind"] == EventKind.CONTROLLER_CHANGED and event["time"] <= until
        for event in twins.events(twin_id, events - 1, EVENTS_MAX)
    )
    if changed:
        return ForecastCame(covered=None, error=None, until_s=until, changed=True)
    true = np.array([found[name] for name in names])
    low, median, high = (
        np.array([rows[0]["pressures"][name][level][1 : count + 1] for name in BUFFERS])
        for level in ("low", "median", "high")
    )
    read = np.isfinite(true)
    inside = ((true >= low) & (true <= high))[read & (high - low > CERTAIN_BAR)]
    return ForecastCame(
        covered=float(inside.mean()) if inside.size else None,
        error=float(np.median(np.abs(true - median)[read])) if read.any() else None,
        until_s=until,
        changed=False,
    )
