"""Figures and tables of docs/controllers.md: our controllers, the thesis's four and what nobody can do better.

Run as `python -m benchmarks.controllers_document`, or with the names of some parts; some twenty minutes on two cores.
Days are those of `benchmarks.fleet_days_document`.
"""

from __future__ import annotations

import sys
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from api.jobs.cores import cores
from benchmarks import drawn
from benchmarks.actors import SecondBySecond
from benchmarks.documents import DOCS, recompute, seconds, table
from controllers.slot import create_from
from controllers.switched.controller import Switched
from controllers.switched.vector import blocks_of, settings_vector
from station.bounds import FINE, StationPrices, bounds
from station.metrics import metrics
from station.preset_files import load_station
from station.scenario_files import load_scenario
from station.simulation import simulate

DOCUMENT = "controllers.md"

SCENARIOS = ("S1", "S2", "S3", "S4")
FITTED = ("thesis-fit", "thesis-fit-a")
OTHERS = ("thesis-fit-cascade", "thesis-fit-b", "light-duty-700")
FOUR = ("logic", "minlp1", "minlp2", "minlp3")
HORIZONS = (1, 2, 4, 8, 14, 20, 28)
PATIENCES = (0.0, 0.2, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
AGAINST = {  # a setting of `switched` for each of the thesis's controllers
    "thesis-fit": {
        "logic": "switched", "minlp2": "switched", "minlp3": "switched",
        "minlp1": "switched:patience=0.42:sparse_factor=1000",
    },
    "thesis-fit-a": {
        "logic": "switched", "minlp2": "switched:patience=0.78", "minlp3": "switched:patience=0.78",
        "minlp1": "switched:patience=0.25",
    },
}  # fmt: skip

DRAWN = {"thesis-fit": ("switched",), "thesis-fit-a": ("switched",)}

Cell = tuple[float, float, float, float]
"""t_avg, t_comp_restored, t_dis [s], vehicles not finished."""


def cell(preset: str, scenario: str, controller: str) -> Cell:
    """One controller on one scenario."""
    found = metrics(simulate(load_scenario(scenario).on(load_station(preset)), create_from(controller)))
    return found.t_avg, found.t_comp_restored, found.t_dis, found.vehicles_not_finished


def cells(wanted: list[tuple[str, str, str]]) -> dict[tuple[str, str, str], Cell]:
    """All of them, on all cores."""
    with ProcessPoolExecutor(cores(), mp_context=get_context("spawn")) as pool:
        return dict(zip(wanted, pool.map(cell, *zip(*wanted, strict=True)), strict=True))


def _against(new: Cell, old: Cell) -> list[str]:
    def change(ours: float, theirs: float) -> str:
        return f"{100 * (ours / theirs - 1):+.1f} %" if theirs else ("0" if not ours else f"{ours:.1f} s against 0")

    return [change(new[0], old[0]), change(new[1], old[1]), change(new[2], old[2])]


def duels_part() -> str:
    """A setting of `switched` against each of the thesis's controllers, cell by cell."""
    wanted = {(p, s, c) for p in FITTED for s in SCENARIOS for c in (*FOUR, *AGAINST[p].values())}
    found = cells(sorted(wanted))
    rows = [
        [
            preset,
            scenario,
            f"`{ours}`",
            theirs,
            *_against(found[preset, scenario, ours], found[preset, scenario, theirs]),
        ]
        for preset in FITTED
        for theirs, ours in AGAINST[preset].items()
        for scenario in SCENARIOS
    ]
    return table(("station", "scenario", "controller", "against", "t_avg", "t_comp_restored", "t_dis"), rows, 4)


def others_part() -> str:
    """The same code and weights at stations it was not tuned on, against logic."""
    wanted = [(p, s, c) for p in OTHERS for s in SCENARIOS for c in ("logic", "switched")]
    found = cells(wanted)
    rows = [
        [preset, scenario, *_against(found[preset, scenario, "switched"], found[preset, scenario, "logic"])]
        for preset in OTHERS
        for scenario in SCENARIOS
    ]
    return table(("station", "scenario", "t_avg", "t_comp_restored", "t_dis"), rows, 2)


def worst_part() -> str:
    """One setting against the best of the four in every cell."""
    names = [f"switched:patience={patience}" for patience in (0.4, 0.45, 0.5, 0.55, 0.6, 0.65)]
    wanted = [(p, s, c) for p in FITTED for s in SCENARIOS for c in (*FOUR, *names)]
    found = cells(wanted)
    rows = []
    for preset in FITTED:
        for name in names:
            worst = (0.0, "")
            for scenario in SCENARIOS:
                for place, what in enumerate(("t_avg", "t_comp_restored", "t_dis")):
                    best = min(found[preset, scenario, other][place] for other in FOUR)
                    ours = found[preset, scenario, name][place]
                    excess = ours / best - 1 if best else (0.0 if ours == 0 else float("inf"))
                    worst = max(worst, (excess, f"{what}, {scenario}"))
            rows.append([preset, f"`{name}`", f"{100 * worst[0]:.1f} %", worst[1]])
    return table(("station", "controller", "worst cell above the best of the four by", "where"), rows, 2)


def _ahead(blocks: int, preset: str) -> float:
    """How far a plan of so many blocks looks ahead [s]."""
    station = load_station(preset)
    settings = Switched(blocks=blocks).settings_for(station)
    return float(blocks_of(settings_vector(settings, station)).sum())


def horizon_part() -> str:
    """What looking ahead brings: plans of fewer blocks at the same prices and the same worth of the end."""
    names = {blocks: f"switched:blocks={blocks}" for blocks in HORIZONS}
    wanted = [(p, s, c) for p in FITTED for s in ("S1", "S3") for c in names.values()]
    found = cells(wanted)
    rows = []
    for preset in FITTED:
        station = load_station(preset)
        settings = Switched().settings_for(station)
        prices = settings.prices(station)
        for scenario in ("S1", "S3"):
            count = len(load_scenario(scenario).vehicles().arrival)
            costs = {}
            for blocks, name in names.items():
                item = found[preset, scenario, name]
                costs[blocks] = item[1] + prices.dispensing * item[2] + prices.waiting * item[0] * count
            usual = costs[settings.blocks]
            for blocks, name in names.items():
                item = found[preset, scenario, name]
                rows.append([
                    preset, scenario, f"{blocks}", seconds(_ahead(blocks, preset)), f"{item[0]:.0f}",
                    seconds(item[1]), seconds(item[2]), f"{100 * (costs[blocks] / usual - 1):+.1f} %",
                ])  # fmt: skip
    headings = ("station", "scenario", "blocks", "ahead [s]", "t_avg [s]", "t_comp_restored [s]", "t_dis [s]", "cost")
    return table(headings, rows, 2)


def drawn_part() -> str:
    """Drawn scenarios against logic."""
    rows = []
    for preset, names in DRAWN.items():
        for name, found in zip(names, drawn.verdicts(names, preset), strict=True):
            rows.append([
                preset, f"`{name}`", f"{found.days}", f"{found.both} ({100 * found.both / found.days:.0f} %)",
                *(f"{a:.0f} -> {b:.0f}" for a, b in (found.t_avg, found.t_comp_restored, found.t_dis)),
                f"{found.unserved[1]:.0f}",
            ])  # fmt: skip
    headings = (
        "station", "controller", "scenarios", "no worse in both", "mean t_avg [s]", "mean t_comp_restored [s]",
        "mean t_dis [s]", "not served",
    )  # fmt: skip
    return table(headings, rows, 2)


def trade_off_part() -> str:
    """Waiting against compression in S3: the thesis's four, ours at each patience, the proved bound; and a picture."""
    rows, shown = [], {}
    for preset in FITTED:
        ours = [f"switched:patience={patience}" for patience in PATIENCES]
        found = cells([(preset, "S3", name) for name in (*FOUR, *ours)])
        scenario = load_scenario("S3").on(load_station(preset))
        vehicles = scenario.vehicles()
        count = len(vehicles.arrival)
        prices = StationPrices.of([vehicles], scenario, FINE)
        limits = sorted({0.0, 60.0, 300.0, 600.0, *(item[0] for item in found.values())})
        bound = bounds(scenario, [limit * count for limit in limits], prices=prices)
        least = {limit: point.restored for limit, point in zip(limits, bound.trade_off, strict=True)}
        shown[preset] = (found, least)
        for (_, _, name), item in found.items():
            lower = least[item[0]]
            rows.append([
                preset, f"`{name}`", f"{item[0]:.1f}", seconds(item[1]), seconds(item[2]), seconds(lower),
                f"{100 * lower / item[1]:.0f} %",
            ])  # fmt: skip
    _draw(shown)
    headings = (
        "station", "controller", "t_avg [s]", "t_comp_restored [s]", "t_dis [s]", "nobody below [s]", "bound / figure",
    )  # fmt: skip
    return table(headings, rows, 2) + "\n\n![waiting against compressor time in S3](images/controllers-trade-off.png)"


def _draw(shown: dict[str, tuple[dict[tuple[str, str, str], Cell], dict[float, float]]]) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 5), layout="constrained")
    for axes, (preset, (found, least)) in zip(figure.subplots(1, len(shown)), shown.items(), strict=True):
        ours = [(item[0], item[1]) for (_, _, name), item in found.items() if name.startswith("switched")]
        axes.plot(*zip(*ours, strict=True), "o-", color="#1e8449", label="switched, patience 0 to 1")
        for name, color in zip(FOUR, ("#566573", "#c0392b", "#2471a3", "#d68910"), strict=True):
            item = found[preset, "S3", name]
            axes.plot(item[0], item[1], "s", color=color, label=name)
        axes.plot(*zip(*sorted(least.items()), strict=True), "--", color="black", label="proved: nobody is below")
        axes.set(title=f"S3 at {preset}", xlabel="t_avg [s]", ylabel="t_comp_restored [s]", ylim=(0, None))
        axes.legend(fontsize=8)
        axes.grid(alpha=0.3)
    figure.savefig(Path(DOCS) / "images" / "controllers-trade-off.png", dpi=120)


REPEATS = 5
"""Runs whose CPU is measured."""

SEARCHING = ("switched", "scenario", "guarded", "adaptive")
"""Controllers that plan by the beam search of `switched`."""


def computing_part() -> str:
    """CPU of a simulated second of S3 for each controller that searches, and of the decisions of S1 that plan."""
    rows, plans = [], []
    for preset in (*FITTED, *OTHERS):
        rows.append([preset, *(_spent(preset, name) for name in SEARCHING)])
        decisions = _decisions(preset)
        middle, late = decisions[len(decisions) // 2], decisions[int(0.99 * len(decisions))]
        plans.append([preset, *(f"{1e3 * item:.2f}" for item in (middle, late, decisions[-1]))])
    return "\n\n".join((
        table(("station, CPU [us a simulated second]", *(f"`{name}`" for name in SEARCHING)), rows),
        table(("station, plans of `switched`", "median [ms]", "99 % [ms]", "longest [ms]"), plans),
    ))  # fmt: skip


def _spent(preset: str, name: str) -> str:
    """CPU of a simulated second of S3: median, least and greatest of some runs [us]."""
    scenario, controller = load_scenario("S3").on(load_station(preset)), create_from(name)
    simulate(load_scenario("S1").on(load_station(preset)), controller)  # compiles
    spent = []
    for _ in range(REPEATS):
        began = time.process_time()
        record = simulate(scenario, controller)
        spent.append(1e6 * (time.process_time() - began) / float(record["time"][-1]))
    least, usual, most = np.quantile(spent, (0.0, 0.5, 1.0))
    return f"{usual:.0f} ({least:.0f} to {most:.0f})"


def _decisions(preset: str) -> list[float]:
    """Durations of the decisions of S1 that planned, sorted [s]; asked one by one from Python."""
    actor = SecondBySecond(create_from("switched"))
    record = simulate(load_scenario("S1").on(load_station(preset)), actor)
    timing = record.timing.decisions
    if timing is None:
        raise RuntimeError("a controller called from Python has its decisions timed")
    cost = record["decision_cost"][: len(timing)]
    planned = np.diff(cost, prepend=np.nan) != 0.0  # a plan has a cost of its own, and keeps it
    return np.sort(np.asarray(timing)[planned]).tolist()


PARTS = {
    "duels": duels_part,
    "others": others_part,
    "worst": worst_part,
    "horizon": horizon_part,
    "drawn": drawn_part,
    "trade-off": trade_off_part,
    "computing": computing_part,
}


def main() -> None:
    """Recompute the parts named on the command line, or all."""
    recompute(DOCUMENT, PARTS, sys.argv[1:])


if __name__ == "__main__":
    main()
