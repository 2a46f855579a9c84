"""Forecasts against what came: `python -m benchmarks.forecasts [--station thesis-fit] [--days 50]`.

Of each drawn day an hour is forecast at a drawn time, and held against the same hour with the vehicles that came: the
share of pressures within their bands, of served counts within theirs, and how often the controller advised was the
better one. CPU times of the futures stand beside.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from controllers import create_from
from controllers.contenders import contender
from station import parse_scenario
from station.forecasting.accounts import Account
from station.forecasting.demand import as_seen, by_law, nobody
from station.forecasting.forecast import LEVELS, Price, forecast, scores
from station.live import AtEnd, LiveRun, SlotState

PRICE = Price(waiting=20.0, unserved=50.0)
HORIZON, FUTURES = 3600, 200
WIDE = 1.0
"""Bands narrower than this say nothing that could be wrong [bar]."""


def measure(station: str, rate: float, days: int, *, learned: bool, names: tuple[str, str], seed: int) -> list[str]:
    """Lines of figures."""
    law = {"kind": "poisson", "rate_per_h": rate, "period_s": 43_200.0}
    scenario = parse_scenario({"name": "forecasts", "about": "drawn", "station": station, "arrivals": law})
    chance = np.random.default_rng(seed)
    inside = wide = served = right = sure = sure_right = 0
    errors, cpu = [], 0.0
    for day in range(days):
        controller = create_from(names[0])
        controller.start(scenario.known_station)
        beside = contender(names[0], scenario)
        slot = SlotState(controller.decide, controller.obeys_hold, fallback=beside.fallback, liveness=beside.liveness)
        run = LiveRun(scenario, AtEnd.REPEAT, replication=day + 1, seed=seed)
        for _ in range(int(chance.integers(7200, 28_800))):
            run.step(slot)
        fork = run.fork()
        known = fork.known(0.0)
        given = [contender(names[0], scenario, controller.memory), contender(names[1], scenario)]
        account = Account(scenario, known, HORIZON, 0.3)
        begin, drawn = fork.time, 1000 + day
        demand = as_seen(run.seen(), begin, HORIZON, drawn) if learned else by_law(scenario, begin, HORIZON, drawn)
        began = time.process_time()
        told = forecast(known, given, demand, account, horizon=HORIZON, futures=FUTURES, price=PRICE)
        cpu += time.process_time() - began
        came = forecast(fork, given, nobody, account, horizon=HORIZON, futures=1, price=PRICE)
        low, median, high = np.quantile(told.outcomes[0].pressures, LEVELS, axis=0)
        true = came.outcomes[0].pressures[0]
        counts = high - low > WIDE
        inside += int(((true >= low) & (true <= high))[counts].sum())
        wide += int(counts.sum())
        errors.append(float(np.median(np.abs(true - median))))
        least, most = np.quantile(told.outcomes[0]["served"], (LEVELS[0], LEVELS[-1]))
        served += bool(least <= came.outcomes[0]["served"][0] <= most)
        beats = next(each.beats for each in told.ranking() if each.name == names[1])
        score = scores(came.outcomes, PRICE)[:, 0]
        correct = bool((score[1] < score[0]) == (beats >= 0.5) or score[0] == score[1])
        right += correct
        if max(beats, 1.0 - beats) >= 0.9:
            sure += 1
            sure_right += correct
    return [
        f"{station}, {rate:g} vehicles an hour, {'learned' if learned else 'by the law'}: {days} days",
        f"  pressures within 90 % bands wider than {WIDE:g} bar: {inside / max(wide, 1):.1%}",
        f"  median of days' median error: {np.median(errors):.2f} bar",
        f"  served count within its band: {served} of {days}",
        f"  advised rightly: {right} of {days}; where it was sure to 90 %: {sure_right} of {sure}",
        f"  {2 * FUTURES * days / cpu:.0f} futures of an hour a CPU-second ({' and '.join(names)})",
    ]


def main() -> None:
    """Parse the arguments and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--station", default="thesis-fit")
    parser.add_argument("--rate", type=float, default=7.0, help="vehicles an hour")
    parser.add_argument("--days", type=int, default=50)
    parser.add_argument("--controllers", default="logic,minlp1", help="the one that acts, and another")
    parser.add_argument("--seed", type=int, default=5)
    asked = parser.parse_args()
    first, second = asked.controllers.split(",")
    for learned in (False, True):
        for line in measure(
            asked.station, asked.rate, asked.days, learned=learned, names=(first, second), seed=asked.seed
        ):
            print(line, flush=True)


if __name__ == "__main__":
    main()
