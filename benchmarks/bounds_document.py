"""Figures of docs/bounds.md: what is proved, beside what controllers need.

Run as `python -m benchmarks.bounds_document`; some ten minutes on two cores.
"""

from __future__ import annotations

import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

from api.jobs.cores import cores
from benchmarks.both_times import Times, ideal_excess, proved_excess
from benchmarks.controllers_document import FITTED, FOUR, SCENARIOS, cells
from benchmarks.documents import recompute, seconds, table
from station.bounds import Bounds, StationPrices, bounds
from station.preset_files import load_station
from station.scenario_files import load_scenario

DOCUMENT = "bounds.md"

OURS = {
    "thesis-fit": ("switched", "switched:patience=1", "switched:patience=1:waiting_price=0.02"),
    "thesis-fit-a": ("switched", "switched:patience=1", "switched:dispensing_price=0.02:waiting_price=0.02"),
}
"""Settings of `switched` at each station, the last one as saving as it gets."""

PATIENCES = (0.5, 0.51, 0.52, 0.53, 0.54, 0.55, 0.6, 0.62, 0.64, 0.65, 0.66, 0.67, 0.68, 0.69)
"""Of `switched`, for both times at once."""


def _proved(preset: str, waits: dict[str, list[float]]) -> list[Bounds]:
    """Bounds of every scenario at these limits on t_total, by potentials that all scenarios share."""
    station = load_station(preset)
    chosen = [load_scenario(name).on(station) for name in SCENARIOS]
    prices = StationPrices.of([scenario.vehicles() for scenario in chosen], chosen[0])
    return [bounds(scenario, waits[scenario.name], prices=prices) for scenario in chosen]


def figures_part() -> str:
    """Bound and figure of each controller on each scenario."""
    found = cells([(p, s, c) for p in FITTED for s in SCENARIOS for c in (*FOUR, *OURS[p])])
    counts = {name: len(load_scenario(name).vehicles().arrival) for name in SCENARIOS}
    limits = [
        {s: [found[p, s, c][0] * counts[s] for c in (*FOUR, *OURS[p])] for s in SCENARIOS} for p in FITTED
    ]  # fmt: skip
    with ProcessPoolExecutor(min(cores(), len(FITTED)), mp_context=get_context("spawn")) as pool:
        proved = list(pool.map(_proved, FITTED, limits))
    rows = []
    for preset, items in zip(FITTED, proved, strict=True):
        for item in items:
            cells_of = []
            for name, point in zip((*FOUR, *OURS[preset]), item.trade_off, strict=True):
                figure = found[preset, item.scenario, name][1]
                share = f"{100 * point.restored / figure:.0f} %"
                cells_of.append(f"{seconds(point.restored)} / {seconds(figure)}, {share}")
            rows.append([
                preset, item.scenario, seconds(item.t_total), seconds(item.t_comp_restored), *cells_of
            ])  # fmt: skip
    headings = ("station", "scenario", "t_total", "any waits", *FOUR, "`switched`", "`patience=1`", "saving most")
    return table(headings, rows, 2)


def both_part() -> str:
    """How near the least of both times of the four a controller can come in S3, and how near `switched` does."""
    settings = [f"switched:patience={patience}" for patience in PATIENCES]
    found = cells([(preset, "S3", name) for preset in FITTED for name in (*FOUR, *settings)])
    rows = []
    for preset in FITTED:
        times = {name: Times(*found[preset, "S3", name][1:3]) for name in (*FOUR, *settings)}
        least = Times(min(times[name].compressing for name in FOUR), min(times[name].dispensing for name in FOUR))
        scenario = load_scenario("S3").on(load_station(preset))
        reached = min(times[name].excess(least) for name in settings)
        shares = proved_excess(scenario, least), ideal_excess(scenario.station, len(scenario.vehicles().arrival), least)
        rows.append([
            preset, seconds(least.compressing), seconds(least.dispensing),
            *(f"{100 * share:+.1f} %" for share in (*shares, reached)),
        ])  # fmt: skip
    headings = ("station", "least t_comp_restored [s]", "least t_dis [s]", "nobody below", "ideal", "`switched`")
    return table(headings, rows, 1)


def main() -> None:
    """Recompute the figures."""
    recompute(DOCUMENT, {"figures": figures_part, "both": both_part}, sys.argv[1:])


if __name__ == "__main__":
    main()
