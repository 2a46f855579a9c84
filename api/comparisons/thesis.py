"""The thesis's printed tables 7.4-7.7, and how close a set of figures comes to them."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from itertools import combinations

import numpy as np

from api.runs.service import Result

COLUMNS = ("t_total", "t_avg", "t_comp", "t_dis")
"""Columns of the printed tables [s]."""

SIGN_COLUMNS = ("t_total", "t_comp", "t_dis")
"""Columns that carry information of their own: t_avg is t_total by the number of vehicles."""

TABLES = {"S1": "7.4", "S2": "7.5", "S3": "7.6", "S4": "7.7"}

Cells = Mapping[tuple[str, str, str], float]
"""Figure by (scenario, controller, column)."""


@cache
def printed() -> Cells:
    """The printed figures [s], with the slips corrected that the data file names."""
    text = (files("api.comparisons") / "data" / "thesis_tables.toml").read_text()
    return {
        (scenario, controller, column): float(value)
        for scenario, rows in tomllib.loads(text).items()
        for controller, row in rows.items()
        for column, value in zip(COLUMNS, row, strict=True)
    }


@dataclass(frozen=True)
class Closeness:
    """How close figures come to the printed tables."""

    signs: int  # of MINLP 1-3 against logic
    signs_of: int
    orderings: int  # of pairs of controllers
    orderings_of: int
    log_error_median: float  # of |log(ours / printed)| over all cells
    log_error_p90: float


def cells_of(results: Sequence[Result]) -> Cells:
    """The cells of replication 0."""
    return {
        (result.scenario, result.controller, column): result.metrics[column]
        for result in results
        if result.replication == 0
        for column in SIGN_COLUMNS
    }


def agreements(ours: Cells) -> dict[tuple[str, str, str, str], bool]:
    """Whether two controllers stand to each other as in print, by (scenario, column, first, second).

    With `first` = logic these are the signs of the printed percentages. Covers the pairs that `ours` covers.
    """
    theirs = printed()
    found = {}
    for scenario in sorted({key[0] for key in ours if key in theirs}):
        for column in SIGN_COLUMNS:
            for first, second in combinations(_controllers(ours, scenario), 2):
                one, two = (scenario, first, column), (scenario, second, column)
                same = np.sign(ours[two] - ours[one]) == np.sign(theirs[two] - theirs[one])
                found[scenario, column, first, second] = bool(same)
    return found


def log_errors(ours: Cells) -> dict[tuple[str, str, str], float]:
    """log(ours / printed) of each cell that `ours` covers; a figure of ours below 1 s counts as 1 s."""
    return {
        key: float(np.log(max(ours[key], 1.0) / value))
        for key, value in printed().items()
        if key in ours and key[2] in SIGN_COLUMNS
    }


def closeness(ours: Cells) -> Closeness:
    """Compare with the printed tables, as far as `ours` covers them."""
    same = agreements(ours)
    signs = [value for key, value in same.items() if key[2] == "logic"]
    errors = np.abs(list(log_errors(ours).values()))
    return Closeness(
        sum(signs), len(signs), sum(same.values()), len(same), float(np.median(errors)), float(np.quantile(errors, 0.9))
    )


def _controllers(ours: Cells, scenario: str) -> list[str]:
    """Controllers of the printed tables that have run on a scenario: not the same on each while a comparison works."""
    return [name for name in ("logic", "minlp1", "minlp2", "minlp3") if (scenario, name, SIGN_COLUMNS[0]) in ours]
