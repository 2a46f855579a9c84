"""Comparison tables: one a scenario, our figures above the thesis's where it prints any."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

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
}
"""Figures a table shows, with its headings; t_comp_restored adds what would refill the buffers."""

RELATIVE = ("t_total", "t_avg", "t_comp", "t_comp_restored", "t_dis")
"""Figures that also show their distance from logic's."""

FITTED = "thesis-fit"
"""Stations whose names begin so are set beside the thesis."""


@dataclass(frozen=True)
class Row:
    """One line: a controller, where its figures come from, and a text for each figure of OURS."""

    controller: str
    origin: str
    cells: tuple[str, ...]


@dataclass(frozen=True)
class Table:
    """The table of one scenario."""

    title: str
    rows: tuple[Row, ...]


def tables(scenarios: Sequence[Scenario], results: Sequence[Result]) -> list[Table]:
    """A table a scenario, controllers in the order they ran."""
    return [_table(scenario, [r for r in results if r.scenario == scenario.name]) for scenario in scenarios]


def _table(scenario: Scenario, results: list[Result]) -> Table:
    means: dict[str, dict[str, float]] = {}
    rows: list[Row] = []
    for name in dict.fromkeys(result.controller for result in results):
        figures = {
            key: np.array([result.metrics[key] for result in results if result.controller == name]) for key in OURS
        }
        means[name] = {key: float(values.mean()) for key, values in figures.items()}
        count = len(figures["t_total"])
        rows.append(_row(name, "ours" if count == 1 else f"mean of {count}", means[name], means.get("logic")))
        if count > 1:
            spread = {key: float(values.std(ddof=1)) for key, values in figures.items()}
            rows.append(_row("", "std dev", spread, None))
        thesis = _printed_row(scenario, name)
        if thesis:
            rows.append(thesis)
    number = TABLES.get(scenario.name) if scenario.station.name.startswith(FITTED) else None
    title = f"{scenario.name}: {scenario.about or 'a scenario of yours'}; station {scenario.station.name}"
    return Table(f"Table {number}  {title}" if number else title, tuple(rows))


def _printed_row(scenario: Scenario, controller: str) -> Row | None:
    if not scenario.station.name.startswith(FITTED):
        return None
    cells = printed()
    if (scenario.name, controller, "t_total") not in cells:
        return None
    theirs = {key: cells[scenario.name, controller, key] for key in OURS if (scenario.name, controller, key) in cells}
    logic = {key: cells[scenario.name, "logic", key] for key in theirs}
    return _row("", "thesis", theirs, None if controller == "logic" else logic)


def _row(name: str, origin: str, figures: dict[str, float], logic: dict[str, float] | None) -> Row:
    return Row(name, origin, tuple(_cell(key, figures, logic if name != "logic" else None) for key in OURS))


def _cell(key: str, figures: dict[str, float], logic: dict[str, float] | None) -> str:
    if key not in figures:
        return ""
    text = f"{figures[key]:,.0f}".replace(",", " ")
    if key in RELATIVE and logic and logic.get(key):
        text += f" {100 * (figures[key] / logic[key] - 1):+.0f} %"
    return text


def verdict(results: Sequence[Result]) -> str:
    """One sentence on how close replication 0 comes to the printed tables; empty if they do not cover it."""
    cells = {key: value for key, value in cells_of(results).items() if key in printed()}
    if len(cells) < len(cells_of(results)) or len({key[1] for key in cells}) < 2:
        return ""
    found = closeness(cells)
    signs = f"{found.signs} of {found.signs_of} signs against logic and " if found.signs_of else ""
    return (
        f"Against the thesis: {signs}{found.orderings} of {found.orderings_of} pairwise orderings agree; "
        f"|log error| of the figures: median {found.log_error_median:.3f}, 90th percentile {found.log_error_p90:.2f}."
    )
