"""How many futures a second: `python -m benchmarks.forecast_speed`. Medians, with the least and the greatest.

Futures of an hour of a live run with Poisson arrivals, 2.5 h after its begin: drawn, run and billed in this process;
computed as a job; and asked for over REST of a service with one worker. For one core run it under `taskset -c 0`.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from api.forecasts.job import FORECAST, forecast_spec
from benchmarks.measure import Bar, Row, cells
from benchmarks.served import served
from controllers import create_from
from controllers.contenders import contender
from station import Scenario, parse_scenario
from station.forecasting.accounts import Account
from station.forecasting.demand import Seen, by_law
from station.forecasting.forecast import Price, forecast
from station.forecasting.fork import Fork
from station.live import AtEnd, LiveRun, SlotState

BEGIN, HORIZON = 9000, 3600
PRICES = {"waiting_eur_per_h": 20.0, "unserved_eur": 50.0, "energy_eur_per_kwh": 0.3}
TRIO = ("logic", "minlp1", "reserve")
TRIO_FUTURES = 300


class Case(NamedTuple):
    """Futures that are counted."""

    station: str
    rate: float  # vehicles an hour
    controller: str
    futures: int
    brief: bool  # whether planned as forecasts plan
    bar: Bar | None


CASES = (
    Case("h70-light", 4.0, "logic", 200, True, Bar("at least", 300)),
    Case("thesis-fit", 7.0, "switched", 60, True, Bar("at least", 78)),
    Case("thesis-fit", 7.0, "switched", 20, False, None),
)


def law(rate: float) -> dict[str, object]:
    """Arrivals, so many an hour."""
    return {"kind": "poisson", "rate_per_h": rate, "period_s": 43_200.0}


def begun(station: str, rate: float) -> tuple[Scenario, Fork, Seen, np.ndarray]:
    """A live run by `logic`: its scenario, its fork at BEGIN, the vehicles that came, and what the controller knows."""
    scenario = parse_scenario({"name": "speed", "about": "drawn", "station": station, "arrivals": law(rate)})
    controller = create_from("logic")
    controller.start(scenario.known_station)
    beside = contender("logic", scenario)
    slot = SlotState(controller.decide, controller.obeys_hold, fallback=beside.fallback, liveness=beside.liveness)
    run = LiveRun(scenario, AtEnd.REPEAT, replication=1, seed=5)
    for _ in range(BEGIN):
        run.step(slot)
    return scenario, run.fork().known(0.0), run.seen(), controller.memory


def spent(work: Callable[[int], object], repeats: int) -> list[float]:
    """CPU time of a work after it was done once [s]."""
    work(0)
    found = []
    for number in range(repeats):
        before = time.process_time()
        work(1 + number)
        found.append(time.process_time() - before)
    return found


def counted(case: Case, repeats: int) -> Row:
    """Futures a CPU-second of one controller."""
    scenario, fork, _, memory = begun(case.station, case.rate)
    given = contender(case.controller, scenario, memory if case.controller == "logic" else None, brief=case.brief)
    account = Account(scenario, fork, HORIZON, PRICES["energy_eur_per_kwh"])
    price = Price(PRICES["waiting_eur_per_h"], PRICES["unserved_eur"])

    def work(seed: int) -> None:
        demand = by_law(scenario, fork.time, HORIZON, seed)
        forecast(fork, [given], demand, account, horizon=HORIZON, futures=case.futures, price=price)

    rates = tuple(case.futures / each for each in spent(work, repeats))
    how = "" if case.brief else ", planned as in the slot"
    what = f"{case.controller}{how} at {case.station}, {case.rate:g} vehicles an hour, {case.futures} at a time"
    return Row(f"futures of an hour: {what}", rates, "1/CPU-s", case.bar)


def as_a_job(repeats: int) -> Row:
    """CPU time of the futures of three controllers, as the worker of a service computes them."""
    scenario, fork, seen, memory = begun("thesis-fit", 7.0)

    def work(seed: int) -> None:
        asked = {
            "horizon_s": HORIZON, "futures": TRIO_FUTURES, "arrivals": "law", "law": None, "prices": PRICES,
            "seed": seed,
        }  # fmt: skip
        spec = forecast_spec("speed", scenario, 1, fork, list(TRIO), memory, seen, 0, None, asked)
        for place in range(len(TRIO)):
            FORECAST.compute({**spec, "place": place})

    name = f"{TRIO_FUTURES} futures of an hour at thesis-fit by {', '.join(TRIO)} as a job"
    return Row(name, tuple(spent(work, repeats)), "CPU-s", None)


def over_rest(repeats: int) -> Row:
    """Time from the question to the answer of a service with one worker."""
    found = []
    with served("--workers", "1") as service:
        scenario = {"name": "speed", "station": {"preset": "thesis-fit"}, "arrivals": law(7.0)}
        twin = {"id": "bench", "scenario": scenario, "controller": "logic", "replication": 1, "at_end": "repeat"}
        service.request("POST", "/v1/twins", {**twin, "speed": 50})
        while service.request("GET", "/v1/twins/bench")["samples"] < BEGIN // 6:
            time.sleep(0.5)
        for seed in range(repeats + 1):
            asked = {"controllers": list(TRIO[1:]), "futures": TRIO_FUTURES, "seed": seed}
            before = time.perf_counter()
            answer = service.request("POST", "/v1/twins/bench/forecasts", asked)
            while answer["finished"] is None:
                time.sleep(0.02)
                answer = service.request("GET", f"/v1/forecasts/{answer['id']}")
            found.append(time.perf_counter() - before)
    return Row("the same over REST, from question to answer", tuple(found[1:]), "s", Bar("at most", 1.0))


def rows(repeats: int) -> Iterator[Row]:
    """Every row in turn."""
    for case in CASES:
        yield counted(case, repeats)
    yield as_a_job(repeats)
    yield over_rest(repeats)


def main() -> None:
    """Parse the arguments and print; status 1 where a bar is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=12)
    asked = parser.parse_args()
    missed = False
    for row in rows(asked.repeats):
        print(*cells(row), sep=" | ", flush=True)
        missed |= row.ok is False
    sys.exit(int(missed))


if __name__ == "__main__":
    main()
