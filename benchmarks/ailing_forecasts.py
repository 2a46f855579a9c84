"""Forecasts of a station that ails against what came: `python -m benchmarks.ailing_forecasts [--station h70-light]`.

A fault begins after an hour of a day that a twin follows. At drawn times the next hour is forecast twice from what is
believed: with the faults that the twin has found, and as if there were none.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import numpy as np

from benchmarks.measured_forecasts import HORIZON, Held, day_of, held
from controllers import create_from
from station import Record, Scenario, load_station, simulate
from station.batches import batches_of
from station.estimation.ailments import ailments
from station.estimation.detection import Event, latest
from station.estimation.filter import model_of
from station.estimation.followed import FollowedRun
from station.measured_day import measured_day, tags_of_day

HOURS = 12
BEGIN_S = 3600.0
FAULTS: tuple[dict[str, object], ...] = (
    {"kind": "compressor_weak", "loss_percent": 30.0},
    {"kind": "compressor_tripped"},
    {"kind": "leak", "buffer": "high", "rate_g_per_s": 1.0},
    {"kind": "leak", "buffer": "low", "rate_g_per_s": 2.0},
    {"kind": "line_leak", "rate_g_per_s": 2.0},
    {"kind": "outlet_leak", "valve": "outlet_high", "rate_g_per_s": 2.0},
    {"kind": "dispenser_clogged", "loss_percent": 50.0},
    {"kind": "valve_stuck", "valve": "inlet_high", "position": "closed"},
    {"kind": "valve_stuck", "valve": "outlet_low", "position": "closed"},
)
"""All begin at BEGIN_S."""


def ailing_day(preset: str, rate: float, seed: int, fault: dict[str, object]) -> tuple[Scenario, Record]:
    """A day as its twin knows it, without the fault, and what happened."""
    known = day_of(load_station(preset), rate, HOURS)
    day = Scenario.model_validate({**known.model_dump(mode="json"), "faults": [{**fault, "begin_s": BEGIN_S}]})
    return known, simulate(day, create_from("logic"), replication=1, seed=seed)


def forecasts(known: Scenario, record: Record, seed: int, count: int) -> Iterator[tuple[Held, Held]]:
    """Forecasts of the day with what was found, and without it, at times drawn from an hour behind the begin on."""
    tags = tags_of_day()
    run, last = FollowedRun(known.station, tags), int(record["time"][-1]) - HORIZON - 60
    begins = sorted(np.random.default_rng([seed, 4]).integers(int(BEGIN_S) + 3600, last, count).tolist())
    names = tuple(model_of(known.station).states)
    told: list[Event] = []
    for batch in batches_of(measured_day(record, seed), tags, 10.0):
        found = run.push(batch)
        told.extend(found.events)
        if not begins or not len(found) or found.time[-1] + 1 < begins[0]:
            continue
        begins.pop(0)
        belief = run.belief()
        if belief is None:
            raise AssertionError("hours have been followed")
        begin = int(found.time[-1]) + 1
        estimates = dict(zip(names, found.states[-1].tolist(), strict=True))
        faults = ailments(latest(told), run.active, estimates, 0.0)
        ailing = known.model_copy(update={"faults": faults})
        yield held(record, ailing, begin, belief, seed), held(record, known, begin, belief, seed)


def main() -> None:
    """Parse the arguments and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--station", default="h70-light")
    parser.add_argument("--rate", type=float, default=4.0, help="vehicles an hour")
    parser.add_argument("--forecasts", type=int, default=10, help="of each day")
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    print(
        f"{asked.station}, {asked.rate:g} vehicles an hour: median error of the buffers' pressures over the hour [bar]"
    )
    for fault in FAULTS:
        known, record = ailing_day(asked.station, asked.rate, asked.seed, fault)
        pairs = list(forecasts(known, record, asked.seed, asked.forecasts))
        lasting, mended = (np.median(np.abs([each[k].errors for each in pairs])) for k in range(2))
        served = [
            np.mean([round(each[k].served[0]) == each[k].served[1] for each in pairs]) for k in range(2)
        ]  # fmt: skip
        about = " ".join(str(value) for value in fault.values())
        print(
            f"  {about}: {lasting:.2f} with the faults found, {mended:.2f} as if there were none; served count right "
            f"in {served[0]:.0%} and {served[1]:.0%} of {len(pairs)}",
            flush=True,
        )


if __name__ == "__main__":
    main()
