"""What `adaptive` recovers of what a wrong model costs `switched`: the tables of docs/adaptive.md.

Run as `python -m benchmarks.adaptive`; `--document` rewrites the tables, `--preset` and `--scenario` pick a part of it.

Stations whose parameters are wrong by up to 20 % run under three controllers: `switched` with the station's figures,
`adaptive`, and the same search told the constants simulated. The limits, moved by their margins, are the same for all
three. The loss of a controller is what its runs cost beyond those of the last. Plants and vehicles are drawn with fixed
seeds; the result is the same every time.
"""

from __future__ import annotations

import argparse
import statistics
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from api.jobs.cores import cores
from benchmarks.documents import rewrite, table
from controllers import create
from controllers.adaptive.controller import Adaptive, identification_of
from controllers.adaptive.memory import believe, believed
from station import Metrics, Scenario, Station, load_scenario, load_station, parse_scenario, simulate
from station.controller import CompiledController
from station.plants.thesis import PlantConstants
from station.uncertainty import READ, RELATIVE

PRESETS = ("thesis-fit", "thesis-fit-a", "light-duty-700")
SENSORS = ("exact", "uniform")
KINDS = ("corner", "uniform")
SEEDS = (1, 2, 3, 4)
"""Of the plants of each kind; and the coefficients that decide most are moved alone, to either end."""

ALONE = ("inlet_coefficient", "outlet_coefficient")

ERROR = 0.2
"""Relative half-width of the parameters."""

LOST = 0.02
"""Share of its cost that `switched` must lose before a share of it can be recovered."""

VEHICLES = 40
"""Of a longer scenario, the first so many: the same times, an afternoon of S3."""

REPLICATIONS = {"S1": (1, 2, 3, 4), "S3": (1, 2)}
"""Start pressures differ by replication; the costs of a case are sums over them. A plan is a search, and a run is
five fills or forty: one run alone says less about a model than about luck."""


class Told(Adaptive):
    """The search told the plant: nothing is left to identify."""

    name = "told"

    def __init__(self, plant: PlantConstants) -> None:
        super().__init__()
        self._plant = plant

    def compiled(self) -> CompiledController:
        """With the constants of the plant, known exactly."""
        ready = super().compiled()
        believe(believed(self._plant), 0.0, identification_of(ready.memory))
        return ready


class Cost(NamedTuple):
    """What runs of one controller came to, summed over replications, and the mean wait."""

    cost: float  # t_comp_restored and the times priced as the controller prices them [s of compressor]
    t_avg: float  # [s]
    t_comp_restored: float  # [s]
    t_dis: float  # [s]


class Case(NamedTuple):
    """A plant at a station in a scenario, and what each controller made of it."""

    preset: str
    scenario: str
    sensors: str
    plant: str
    told: Cost
    switched: Cost
    adaptive: Cost

    @property
    def loss(self) -> float:
        """Of `switched`, as a share of the cost with the plant told."""
        return self.switched.cost / self.told.cost - 1

    @property
    def left(self) -> float:
        """The loss of `adaptive`."""
        return self.adaptive.cost / self.told.cost - 1

    @property
    def recovered(self) -> float:
        """Share of the loss of `switched` that `adaptive` does not have."""
        return 1 - self.left / self.loss


def shares_of(kind: str, seed: int) -> dict[str, float]:
    """Share of its half-width by which each constant deviates: `uniform` in -1 to 1, or at a `corner`."""
    names: tuple[str, ...] = (*RELATIVE, *READ)
    draw = np.random.default_rng([seed, KINDS.index(kind)]).uniform(-1, 1, len(names))
    values = draw if kind == "uniform" else np.sign(draw)
    return dict(zip(names, values.tolist(), strict=True))


def plants() -> dict[str, dict[str, float]]:
    """The plants of the study: the share of its half-width by which each constant deviates."""
    alone = {f"{name} {end:+d}": {name: float(end)} for name in ALONE for end in (-1, 1)}
    return {**{f"{kind} {seed}": shares_of(kind, seed) for kind in KINDS for seed in SEEDS}, **alone}


def disturbed(preset: str, name: str, sensors: str, shares: dict[str, float]) -> Scenario:
    """The first vehicles of a scenario at a station whose plant deviates by `shares`."""
    given = load_scenario(name).on(load_station(preset)).model_dump()
    arrivals: dict[str, Any] = given["arrivals"]
    if arrivals["count"] > VEHICLES:
        arrivals["period_s"] *= VEHICLES / arrivals["count"]
        arrivals["count"] = VEHICLES
    del given["time_limit_s"]  # that of these arrivals is filled in
    disturbance = {"sensors": sensors, "plant": "nominal", "shares": shares, "uncertainty": {"parameters": ERROR}}
    return parse_scenario({**given, "disturbance": disturbance})


def priced(metrics: Metrics, station: Station) -> float:
    """What a run costs at the prices `switched` plans with [s of compressor]."""
    switched = create("switched")
    prices = switched.settings_for(station).prices(station)
    return float(metrics.t_comp_restored + prices.dispensing * metrics.t_dis + prices.waiting * metrics.t_total)


def cost_of(scenario: Scenario, controller: Any, replications: Sequence[int]) -> Cost:
    """The runs of a controller, summed."""
    found = [simulate(scenario, controller, replication=replication).metrics() for replication in replications]
    return Cost(
        sum(priced(item, scenario.station) for item in found), statistics.mean(item.t_avg for item in found),
        sum(item.t_comp_restored for item in found), sum(item.t_dis for item in found),
    )  # fmt: skip


def case_of(asked: tuple[str, str, str, str]) -> Case:
    """The three controllers on one plant: preset, scenario, sensors, plant."""
    preset, name, sensors, plant = asked
    scenario = disturbed(preset, name, sensors, plants()[plant])
    controllers = (Told(scenario.plant()), create("switched"), create("adaptive"))
    costs = [cost_of(scenario, controller, REPLICATIONS[name]) for controller in controllers]
    return Case(*asked, *costs)


def cases(presets: Sequence[str], names: Sequence[str], workers: int) -> Iterator[Case]:
    """Every plant at every station in every scenario, in this order; some are worked on at once."""
    with ThreadPoolExecutor(workers) as pool:
        yield from pool.map(case_of, product(presets, names, SENSORS, plants()))


def percent(share: float) -> str:
    """A share as text."""
    return f"{100 * share:.1f} %"


def row_of(case: Case) -> list[str]:
    """A case as text: its names, the three costs, losses, and the times of `switched` and `adaptive`."""
    one, other = case.switched, case.adaptive
    return [
        case.preset, case.scenario, case.sensors, case.plant, f"{case.told.cost:.0f}", percent(case.loss),
        percent(case.left), percent(case.recovered) if case.loss >= LOST else "",
        f"{one.t_avg:.0f} / {other.t_avg:.0f}", f"{one.t_comp_restored:.0f} / {other.t_comp_restored:.0f}",
        f"{one.t_dis:.0f} / {other.t_dis:.0f}",
    ]  # fmt: skip


HEADER = (
    "station", "scenario", "sensors", "plant", "cost, told [s]", "switched loses", "adaptive loses", "recovered",
    "t_avg [s]", "t_comp_restored [s]", "t_dis [s]",
)  # fmt: skip

SUMMARY = (
    "station", "scenario", "cases", "mean loss: switched", "adaptive", "cases of 2 % or more", "their loss: switched",
    "adaptive", "recovered: together", "mean", "median", "worst",
)  # fmt: skip


def summary_of(title: Sequence[str], found: Sequence[Case]) -> list[str]:
    """Losses of all cases, and what is recovered where `switched` loses 2 % or more."""
    losers = [case for case in found if case.loss >= LOST]
    row = [
        *title, f"{len(found)}", percent(statistics.mean(case.loss for case in found)),
        percent(statistics.mean(case.left for case in found)), f"{len(losers)}",
    ]  # fmt: skip
    if not losers:
        return row + [""] * 6
    shares = [case.recovered for case in losers]
    lost, left = (sum(items) for items in zip(*((case.loss, case.left) for case in losers), strict=True))
    return [
        *row, percent(lost / len(losers)), percent(left / len(losers)), percent(1 - left / lost),
        percent(statistics.mean(shares)), percent(statistics.median(shares)), percent(min(shares)),
    ]  # fmt: skip


def summaries(found: Sequence[Case]) -> list[list[str]]:
    """A row for each station and scenario, one for each kind of sensors, and one for all."""
    groups = list(dict.fromkeys((case.preset, case.scenario) for case in found))
    rows = [summary_of(group, [case for case in found if (case.preset, case.scenario) == group]) for group in groups]
    by_sensors = [
        summary_of(("all", f"{sensors} sensors"), [case for case in found if case.sensors == sensors])
        for sensors in SENSORS
    ]
    return [*rows, *by_sensors, summary_of(("all", "all"), found)]


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.adaptive", description=__doc__)
    parser.add_argument("--preset", action="append", choices=PRESETS, help="only this station; may be given again")
    parser.add_argument("--scenario", action="append", choices=sorted(REPLICATIONS), help="only this scenario")
    parser.add_argument("--document", action="store_true", help="rewrite the tables of docs/adaptive.md")
    parser.add_argument("--workers", type=int, default=cores(), help="cases worked on at once; all cores")
    given = parser.parse_args()
    presets, names = given.preset or PRESETS, given.scenario or sorted(REPLICATIONS)
    total = len(presets) * len(names) * len(SENSORS) * len(plants())
    found = []
    for case in cases(presets, names, given.workers):
        found.append(case)
        print(f"{len(found)}/{total}  {'  '.join(row_of(case))}", file=sys.stderr, flush=True)
    total_table = table(SUMMARY, summaries(found), 2)
    print(table(HEADER, [row_of(case) for case in found], 4), total_table, sep="\n\n")
    if given.document:
        losers = [row_of(case) for case in found if case.loss >= LOST]
        rewrite("adaptive.md", {"recovered": total_table, "cases": table(HEADER, losers, 4)})


if __name__ == "__main__":
    main()
