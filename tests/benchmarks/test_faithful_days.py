"""The tables of docs/faithful.md are those that the benchmark prints: rows of controllers that take no time.

Plans break ties by last digits, which differ between processors: of plans of several seconds no row is here, and in
those of `minlp1` a figure may be another in its last digit. A rule's rows are the page's."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from benchmarks import faithful_days

PAGE = (Path(__file__).parents[2] / "docs" / "faithful.md").read_text()


NUMBER = re.compile(r"\d+(?:\.\d+)?")


def _alike(line: str, row: str) -> bool:
    """Whether a line of the page is a row but for one in the last digit that each figure has.

    Processors round in different ways, and a plan that is nearly another's then begins a second later.
    """
    shown, found = NUMBER.findall(line), NUMBER.findall(row)
    if NUMBER.sub("", line) != NUMBER.sub("", row) or len(shown) != len(found):
        return False
    digits = [10.0 ** -len(figure.partition(".")[2]) for figure in shown]
    return bool(np.all(np.abs(np.array(shown, float) - np.array(found, float)) <= 1.001 * np.array(digits)))


@pytest.mark.slow
@pytest.mark.parametrize(("part", "names", "only"), [
    ("money", "AT_EQUAL", ("logic",)), ("served", "EVERYBODY", ("logic",)), ("many", "MANY", (("h70-equal", "logic"),)),
    ("money", "AT_EQUAL", ("minlp1",)), ("served", "EVERYBODY", ("minlp1",)),
])  # fmt: skip
def test_rows_of_the_page_are_those_of_a_fresh_run(part, names, only, monkeypatch):
    monkeypatch.setattr(faithful_days, names, only)
    heading, row = faithful_days.PARTS[part]()
    shown = row.replace("`logic`", "`logic` (cascade)") if part != "many" else row
    wanted = shown.rsplit(" | ", 1)[0] if part == "served" else shown  # its last cells are told in words
    same = _alike if only == ("minlp1",) else str.__eq__
    assert any(same(line, f"| {wanted} |") for line in PAGE.splitlines())
    assert len(row.split(" | ")) == len(heading.split(" | "))


@pytest.mark.slow
def test_switched_at_h70_light_serves_even_days_as_fast_as_is_asked():
    """40 vehicles evenly over 24 hours, three days by three seeds: 10 s, 210 s, 0.90 kWh/kg, nobody left."""
    days = [
        faithful_days.day("h70-light", 40, "switched", k, seed, faithful_days.EVEN_WEIGHTS)
        for seed in (0, 7, 11)
        for k in range(1, 4)
    ]
    told = [each.metrics() for each in days]
    assert all(m.vehicles_not_finished == m.vehicles_incomplete == 0 for m in told)
    assert np.mean([m.t_avg for m in told]) <= 10
    assert np.mean([faithful_days.mean_fill(each) for each in days]) <= 210
    work = [float(each["energy_compressor"][-1]) / m.delivered for each, m in zip(days, told, strict=True)]
    assert max(work) <= 0.90
    assert max(float(each.vehicles["state_of_charge"].max()) for each in days) <= 1
    assert max(float(each.vehicles["temperature_max"].max()) for each in days) <= 85


@pytest.mark.slow
@pytest.mark.parametrize("replication", [2, 5, 12])
def test_banks_that_never_fall_fill_as_fast_as_any(replication):
    """Ramp, nozzle and valve are left: a bank that has cooled ends a fill sooner by seconds alone, of some 180."""
    mine, least = (
        faithful_days.day("h70-light", 40, name, replication, buffers=buffers).vehicles
        for name, buffers in (("switched", None), ("logic", faithful_days.ENDLESS))
    )
    sooner = (least["finished"] - least["connected"]) - (mine["finished"] - mine["connected"])
    assert sooner.max() <= 3
    assert sooner.mean() < 0
