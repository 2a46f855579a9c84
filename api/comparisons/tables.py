"""Comparison tables: one a scenario, our figures above the thesis's where it prints any."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from api.comparisons.summary import Summary, is_fitted, summaries
from api.comparisons.thesis import TABLES, cells_of, closeness, printed
from api.runs.service import Result
from station import Scenario

OURS = {
    "t_total": "t_total [s]",
    "t_avg": "t_avg [s]",
    "t_comp": "t_comp [s]",
    "t_comp_restored": "restored [s]",
    "t_dis": "t_dis [s]",
    "wait_p95": "wait p95 [s]",
    "compressor_starts": "starts",
    "vehicles_not_finished": "unserved",
    "vehicles_incomplete": "incomplete",
}
"""Figures a table shows, with its headings; t_comp_restored adds what would refill the buffers."""

COSTS = {
    "total_eur": "total [EUR]",
    "eur_per_kg": "EUR/kg",
    "kwh_per_kg": "kWh/kg",
    "peak_kw": "peak [kW]",
}
"""Figures it shows besides where the scenario's station has a tariff."""

DECIMALS = {"total_eur": 2, "eur_per_kg": 3, "kwh_per_kg": 3, "peak_kw": 1}
"""Of the figures that are not shown as whole numbers."""

RELATIVE = ("t_total", "t_avg", "t_comp", "t_comp_restored", "t_dis", "eur_per_kg")
"""Figures that also show their distance from logic's."""


@dataclass(frozen=True)
class Row:
    """One line: a controller, where its figures come from, and a text for each heading of its table."""

    controller: str
    origin: str
    cells: tuple[str, ...]


@dataclass(frozen=True)
class Table:
    """The table of one scenario."""

    title: str
    headings: tuple[str, ...]
    rows: tuple[Row, ...]


def tables(scenarios: Sequence[Scenario], results: Sequence[Result]) -> list[Table]:
    """A table a scenario, controllers in the order they ran."""
    found = summaries(scenarios, results)
    return [_table(scenario, [each for each in found if each.scenario == scenario.name]) for scenario in scenarios]


def _table(scenario: Scenario, found: Sequence[Summary]) -> Table:
    logic = next((summary for summary in found if summary.controller == "logic"), None)
    theirs = {key[2]: value for key, value in printed().items() if key[:2] == (scenario.name, "logic")}
    shown = OURS if scenario.station.tariff is None else {**OURS, **COSTS}
    rows: list[Row] = []
    for summary in found:
        origin = "ours" if summary.runs == 1 else f"mean of {summary.runs}"
        other = summary is not logic
        rows.append(_row(summary.controller, origin, summary.mean, logic.mean if logic and other else None, shown))
        if summary.deviation:
            rows.append(_row("", "std dev", summary.deviation, None, shown))
        if summary.thesis:
            rows.append(_row("", "thesis", summary.thesis, theirs if other else None, shown))
    number = TABLES.get(scenario.name) if is_fitted(scenario) else None
    title = f"{scenario.name}: {scenario.about or 'a scenario of yours'}; station {scenario.station.name}"
    if not scenario.drawn:
        title += "; nothing in it is drawn: one run each"
    return Table(f"Table {number}  {title}" if number else title, tuple(shown.values()), tuple(rows))


def _row(
    name: str, origin: str, figures: Mapping[str, float], logic: Mapping[str, float] | None, shown: Iterable[str]
) -> Row:
    return Row(name, origin, tuple(_cell(key, figures, logic) for key in shown))


def _cell(key: str, figures: Mapping[str, float], logic: Mapping[str, float] | None) -> str:
    if key not in figures:
        return ""
    text = f"{figures[key]:,.{DECIMALS.get(key, 0)}f}".replace(",", " ")
    base = (logic or {}).get(key, 0.0)
    if key in RELATIVE and base and math.isfinite(base):  # infinite: what is missing can never be restored
        text += f" {100 * (figures[key] / base - 1):+.0f} %"
    return text


def verdict(scenarios: Sequence[Scenario], results: Sequence[Result]) -> str:
    """One sentence on how close replication 0 comes to the printed tables.

    Empty if they do not cover it, or no two controllers have run on one scenario.
    """
    ours = cells_of(results)
    if not ours or not ours.keys() <= printed().keys() or not all(is_fitted(scenario) for scenario in scenarios):
        return ""
    found = closeness(ours)
    if not found.orderings_of:
        return ""
    signs = f"{found.signs} of {found.signs_of} signs against logic and " if found.signs_of else ""
    return (
        f"Against the thesis: {signs}{found.orderings} of {found.orderings_of} pairwise orderings agree; "
        f"|log error| of the figures: median {found.log_error_median:.3f}, 90th percentile {found.log_error_p90:.2f}."
    )
