"""Figures and tables of chapters 5 and 6, ours beside the thesis's: rewrites the generated parts of docs/predictive.md.

Run as `python -m benchmarks.predictive_document`, or with the names of some parts; some five minutes on two cores.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from api.cli import example_plots as plots
from benchmarks.documents import DOCS, recompute, table
from theory.paths.closed_loop import Trajectory, simulate_mission
from theory.paths.examples import mission
from theory.paths.experiments import at_the_limit, many_paths
from theory.paths.scenario_bounds import by_count
from theory.tubes.examples import unknown
from theory.tubes.experiments import Experiment, run_edge_experiments, run_experiment

DOCUMENT = "predictive.md"

SEEDS, EDGES, RUNS, DRAWS = 200, 60, 40, 400


def seeds_part() -> str:
    """Algorithm 1 on Sec. 5.6 in many seeds, noise from its box and from its corners."""
    rows = []
    for corners in (False, True):
        found = [run_experiment(unknown(), seed, corners=corners) for seed in range(SEEDS)]
        entered = [item.entered for item in found if item.entered is not None]
        costs = [pair for item in found for pair in item.costs]
        rows.append([
            "at the corners" if corners else "in the box", f"{len(found)}",
            f"{sum(item.model_in_set for item in found)}", f"{len(entered)}, by sample {max(entered)}",
            f"{sum(item.limits_broken for item in found)}", f"{sum(item.tube_escapes for item in found)}",
            f"{sum(a <= b * (1 + 1e-7) for a, b in costs)} of {len(costs)}",
        ])  # fmt: skip
    headings = ["noise", "seeds", "true model in the set", "in the invariant set", "limits broken", "tube escapes",
                "cost at most the shifted plan's"]  # fmt: skip
    return table(headings, rows)


def edge_part() -> str:
    """Starts at the edge of the region of attraction, beside controllers that know the model."""
    rows = []
    for seed in range(4):
        starts = run_edge_experiments(run_experiment(unknown(), seed), EDGES, seed=seed)
        solved = [item for item in starts if not item.infeasible]
        excess = 100 * np.array([item.excess for item in solved])
        total = 100 * (sum(item.cost for item in solved) / sum(item.known_cost for item in solved) - 1)
        planned = [item for item in solved if not np.isnan(item.rigid_cost)]
        rigid = 100 * np.array([item.cost / item.rigid_cost - 1 for item in planned])
        rows.append([
            f"{seed}", f"{len(starts)}", f"{len(starts) - len(solved)}",
            f"{sum(item.limits_broken for item in solved)}",
            f"{total:+.3f}", f"{np.median(excess):+.4f}", f"{excess.max():+.3f}", f"{len(planned)}",
            f"{np.median(rigid):+.3f}", f"{rigid.max():+.3f}",
        ])  # fmt: skip
    headings = ["seed", "starts", "infeasible", "limits broken", "total [%]", "median [%]", "worst [%]",
                "rigid tube has a plan", "against it, median [%]", "worst [%]"]  # fmt: skip
    return table(headings, rows, left=0)


def runs_part() -> str:
    """Sec. 6.4 in 40 runs: the reading that works, with the line between samples kept free, and as printed."""
    rows = []
    for name, reading, between in (
        ("works", "paths", False), ("works, between samples too", "paths", True), ("as printed", "paths_printed", False)
    ):  # fmt: skip
        task, start = mission(reading, between_samples=between)
        found = [simulate_mission(task, start, seed) for seed in range(RUNS)]
        steps = [step for item in found for step in item.steps]
        near = [kept for item in found for kept, close in zip(item.kept, item.near, strict=True) if close]
        lengths = [len(item.steps) for item in found if item.arrived]
        rows.append([
            name, f"{len(lengths)} of {len(found)}", f"{min(lengths)} to {max(lengths)}" if lengths else "",
            f"{100 * np.mean(near):.2f} of {len(near)}", f"{sum(step.softened for step in steps)} of {len(steps)}",
            f"{sum(len(item.cuts()) for item in found)}", f"{sum(len(item.cuts(safe=True)) for item in found)}",
        ])  # fmt: skip
    headings = ["reading", "arrived", "samples", "kept with an obstacle in sight [%]", "softened", "obstacles cut",
                "safe distances cut"]  # fmt: skip
    return table(headings, rows)


def one_step_part() -> str:
    """Fig. 6.3 with its spread."""
    rows = []
    printed = {39: (97, 95), 19: (92, 90), 9: (84, 80)}
    for scenarios in (39, 19, 9):
        found = at_the_limit(scenarios, DRAWS)
        low, high = found.spread
        rows.append([
            f"{scenarios}", f"{printed[scenarios][0]} (asked {printed[scenarios][1]})", f"{100 * found.expected:.1f}",
            f"{100 * found.mean:.2f} ± {100 * found.error:.2f}", f"{100 * low:.1f} to {100 * high:.1f}",
            f"{100 * found.kept.mean():.1f}",
        ])  # fmt: skip
    headings = ["S", "printed, of 100 [%]", "one half-plane [%]", f"mean of {DRAWS} decisions [%]",
                "nine tenths of them [%]", "one next state each [%]"]  # fmt: skip
    return table(headings, rows, left=0)


def paths_part() -> str:
    """How the violation grows with the paths that are chosen among."""
    rows = []
    for dimension in (1, 2, 4, 8):
        found = many_paths(dimension, draws=2000)
        counted, tail = found.bounds
        rows.append([
            f"{found.paths}", f"{100 * found.violation:.1f} ± {100 * found.error:.1f}", f"{100 * found.expected:.1f}",
            f"{100 * found.claimed:.0f}", f"{100 * by_count(found.paths, found.scenarios, 2).value:.0f}",
            f"{100 * counted.value:.0f}", f"{100 * tail.value:.1f}",
        ])  # fmt: skip
    headings = ["J", "measured [%]", "computed [%]", "2/(1+S) [%]", "2J/(1+S) [%]", "J/(1+S), one row a path [%]",
                "tail, one row a path [%]"]  # fmt: skip
    return table(headings, rows, left=0)


def parts() -> dict[str, Callable[[], str]]:
    """What computes each generated part, by its name."""
    folder = DOCS / "images"
    return {
        "seeds": seeds_part,
        "edge": edge_part,
        "figures of chapter 5": lambda: _chapter_5(folder),
        "runs": runs_part,
        "one step": one_step_part,
        "paths": paths_part,
        "figures of chapter 6": lambda: _chapter_6(folder),
    }


def _chapter_5(folder: Path) -> str:
    found, lines = run_experiment(unknown(), 0), []
    figure = _figure(9, 4.2)
    for row in range(2):
        plots.draw_models(figure.add_subplot(1, 2, 1 + row, projection="3d"), found, row)
    lines.append(
        _saved(figure, folder, "predictive-5-1", "Fig. 5.1: the models that 13 samples allow, a row of A and B each")
    )
    figure = _figure(6, 5)
    plots.draw_sets(figure.subplots(), found)
    lines.append(
        _saved(figure, folder, "predictive-5-3", "Fig. 5.3: region of attraction, invariant set, and the trajectory")
    )
    figure = _figure(10, 3.6)
    plots.draw_series(figure.subplots(1, 2), found)
    lines.append(_saved(figure, folder, "predictive-5-4", "Fig. 5.4: states and inputs from the preparation on"))
    return "\n".join(lines) + f"\n\n{_entered(found)}"


def _entered(found: Experiment) -> str:
    return f"The invariant set is entered at sample {found.entered} (the thesis: the 16th step)."


def _chapter_6(folder: Path) -> str:
    task, start = mission()
    found, lines = simulate_mission(task, start, 0), []
    figure = _figure(10, 4.8)
    left, right = figure.subplots(1, 2)
    plots.draw_path(left, found)
    plots.draw_inputs(right, found)
    lines.append(_saved(figure, folder, "predictive-6-2", "Fig. 6.2: path and inputs with S = 19"))
    figure = _figure(11, 3.6)
    plots.draw_one_step(figure.subplots(1, 3), [at_the_limit(scenarios, DRAWS) for scenarios in (39, 19, 9)])
    lines.append(
        _saved(figure, folder, "predictive-6-3", "Fig. 6.3: next states after 400 decisions beside the first obstacle")
    )
    return "\n".join(lines) + f"\n\n{_beside(found)}"


def _beside(found: Trajectory) -> str:
    first = [i for i, place in enumerate(found.positions) if abs(place[0] - 95) < 5 and place[1] < 205]
    second = [i for i, place in enumerate(found.positions) if abs(place[1] - 245) < 5 and place[0] < 225]
    return (
        f"Within 5 of the first obstacle's safe distance at samples {first[0]} to {first[-1]} (the thesis: 7 to 9), "
        f"of the second's at {second[0]} to {second[-1]} (the thesis: 14 to 17)."
    )


def _figure(width: float, height: float) -> Any:
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def _saved(figure: Any, folder: Path, name: str, caption: str) -> str:
    figure.savefig(folder / f"{name}.png", dpi=110)
    return f"![{caption}](images/{name}.png)\n\n*{caption}*\n"


if __name__ == "__main__":
    recompute(DOCUMENT, parts(), sys.argv[1:])
