"""A comparison in numbers: mean and spread of every figure of merit, the thesis's figures, and who is on the front."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from api.comparisons.thesis import COLUMNS, printed
from api.runs.service import Result
from station import Scenario, load_scenario
from station import scenarios as shipped
from station.metrics import units_of

FITTED = "thesis-fit"
"""Stations whose names begin so are set beside the thesis."""


@dataclass(frozen=True)
class Summary:
    """A controller's replications of one scenario; a figure is not finite where that of a run is not."""

    scenario: str
    controller: str
    runs: int
    mean: Mapping[str, float]  # by name of the figure, in the units of station.metrics.units_of
    deviation: Mapping[str, float]  # standard deviation; empty for one run
    thesis: Mapping[str, float]  # what the thesis prints; empty where it prints nothing


def summaries(scenarios: Sequence[Scenario], results: Sequence[Result]) -> list[Summary]:
    """One for each scenario and controller that has run, in the order of the results."""
    fitted = {scenario.name: is_fitted(scenario) for scenario in scenarios}
    groups: dict[tuple[str, str], list[Result]] = {}
    for result in results:
        groups.setdefault((result.scenario, result.controller), []).append(result)
    return [_summary(*key, runs, fitted=fitted[key[0]]) for key, runs in groups.items() if key[0] in fitted]


def is_fitted(scenario: Scenario) -> bool:
    """Whether the thesis's printed figures stand beside ours: its scenario, at a station that was fitted to it.

    A scenario of a user that is called as one of the thesis's is not that one.
    """
    theirs = scenario.name not in shipped() or scenario.arrivals == load_scenario(scenario.name).arrivals
    return theirs and scenario.station.name.startswith(FITTED)


def pareto_front(points: Sequence[tuple[float, float]]) -> list[int]:
    """Places of the points that no other undercuts: none is as low in both and lower in one; from left to right."""
    kept: list[int] = []
    for place in sorted((p for p in range(len(points)) if np.isfinite(points[p]).all()), key=lambda p: points[p]):
        if not kept or points[place][1] < points[kept[-1]][1] or points[place] == points[kept[-1]]:
            kept.append(place)
    return kept


def _summary(scenario: str, controller: str, runs: Sequence[Result], *, fitted: bool) -> Summary:
    figures = {name: np.array([run.metrics[name] for run in runs], dtype=float) for name in units_of([runs[0].metrics])}
    with np.errstate(invalid="ignore"):  # the spread of infinite figures is not a number
        deviation = {name: float(values.std(ddof=1)) for name, values in figures.items()} if len(runs) > 1 else {}
    cells = printed() if fitted else {}
    thesis = {name: cells[key] for name in COLUMNS if (key := (scenario, controller, name)) in cells}
    mean = {name: float(values.mean()) for name, values in figures.items()}
    return Summary(scenario, controller, len(runs), mean, deviation, thesis)
