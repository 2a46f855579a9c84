"""What planning briefly costs a day and saves a forecast: `python -m benchmarks.brief_plans [--station thesis-fit]`.

Forecasts let some controllers plan with fewer states and less often than the slot does: `controllers.contenders.BRIEF`.
Here both ways run the same drawn days, and the same futures of an hour, one after the other in turn.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from statistics import mean
from typing import NamedTuple

from benchmarks.duel import Outcome, outcome
from benchmarks.fleet_days import day
from controllers import create_from
from controllers.contenders import BRIEF, contender
from station import parse_scenario
from station.forecasting.accounts import Account
from station.forecasting.demand import by_law
from station.forecasting.forecast import Price, forecast
from station.live import AtEnd, LiveRun, SlotState

SEED = 2711
"""Fixed before the brief options were chosen, by days of another."""

DAYS = 60
HORIZON_S, FUTURES, TURNS, BEGIN_S = 3600, 20, 10, 9000


class Costs(NamedTuple):
    """Means over days."""

    t_avg: float  # [s]
    t_comp_restored: float  # [s]
    unserved: float  # vehicles


def told(name: str) -> str:
    """A controller with its brief options, as a text."""
    return ":".join([name, *(f"{option}={str(value).lower()}" for option, value in BRIEF[name].items())])


def costs(text: str, station: str, days: int, seed: int = SEED) -> Costs:
    """Means of a controller over drawn days of 12 h with 20 to 100 vehicles."""
    found: list[Outcome] = [
        outcome(day(place, station, mixed=False, seed=seed), text, replication=place + 1, seed=seed)
        for place in range(days)
    ]
    return Costs(
        mean(each.t_avg for each in found),
        mean(each.t_comp_restored for each in found),
        mean(len(each.unserved) for each in found),
    )


def speeds(name: str, station: str, rate: float) -> tuple[float, float]:
    """Futures of an hour a CPU-second, as in the slot and briefly: the best of some turns."""
    law = {"kind": "poisson", "rate_per_h": rate, "period_s": 43_200.0}
    scenario = parse_scenario({"name": "brief", "about": "drawn", "station": station, "arrivals": law})
    controller, beside = create_from("logic"), contender("logic", scenario)
    controller.start(scenario.known_station)
    slot = SlotState(controller.decide, controller.obeys_hold, fallback=beside.fallback, liveness=beside.liveness)
    run = LiveRun(scenario, AtEnd.REPEAT, replication=1, seed=SEED)
    while run.time < BEGIN_S:
        run.step(slot)
    fork = run.fork().known(0.0)
    account, demand = Account(scenario, fork, HORIZON_S, 0.3), by_law(scenario, fork.time, HORIZON_S, SEED)
    least = [float("inf")] * 2
    for _ in range(TURNS):
        for way in (False, True):
            given = [contender(name, scenario, brief=way)]
            began = time.process_time()
            forecast(fork, given, demand, account, horizon=HORIZON_S, futures=FUTURES, price=Price(20.0, 50.0))
            least[way] = min(least[way], time.process_time() - began)
    return FUTURES / least[0], FUTURES / least[1]


def lines(name: str, station: str, rate: float, days: int) -> Iterator[str]:
    """Lines of figures."""
    usual, brief = costs(name, station, days), costs(told(name), station, days)
    yield f"{station}, {days} days: {name}, and {told(name)}"
    for what, before, after in zip(Costs._fields, usual, brief, strict=True):
        yield f"  {what}: {before:.1f} -> {after:.1f}" + (f" ({after / before - 1:+.2%})" if before else "")
    slow, fast = speeds(name, station, rate)
    yield f"  futures of an hour a CPU-second: {slow:.0f} -> {fast:.0f}, {fast / slow:.2f} times as many"


def main() -> None:
    """Parse the arguments and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--station", default="thesis-fit")
    parser.add_argument("--rate", type=float, default=7.0, help="vehicles an hour of the futures")
    parser.add_argument("--days", type=int, default=DAYS)
    asked = parser.parse_args()
    for name in BRIEF:
        for line in lines(name, asked.station, asked.rate, asked.days):
            print(line, flush=True)


if __name__ == "__main__":
    main()
