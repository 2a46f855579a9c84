"""`hrs bench --quick` runs, and its rows are what they claim to be."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from api.jobs.cores import cores
from benchmarks.actors import Replay, SecondBySecond
from benchmarks.decisions import in_the_loop, observation_at
from benchmarks.machine import Neighbours
from benchmarks.measure import Bar, Row, cells, number
from controllers import create
from station import load_scenario, simulate

ROOT = Path(__file__).parents[2]


@pytest.mark.full
def test_the_quick_benchmark_reports_all_its_rows(tmp_path: Path) -> None:
    out = tmp_path / "bench.json"
    command = [sys.executable, "-m", "benchmarks", "--quick", "--repeats", "1", "--json", str(out)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode in {0, 1}, done.stderr  # 1: a bar is missed, as it may be on a busy machine
    document = json.loads(out.read_text())
    assert set(document["machine"]) >= {"CPU", "cores", "Python", "numba", "numpy", "SCIP"}
    what = [row["what"] for row in document["rows"]]
    for name in ("minlp1", "minlp2", "minlp3"):
        assert any(name in row and "in the loop" in row for row in what)
    for name in ("logic", "minlp1", "minlp2", "minlp3"):
        assert sum(row.startswith(f"day S3, {name}:") for row in what) == 2
    for solver in ("SCIP", "Bonmin"):
        assert sum(row.startswith(solver) for row in what) == 3
    assert any("hrs compare from the shell" in row for row in what)
    agreement = next(row for row in document["rows"] if row["what"].startswith("SCIP") and "difference" in row["what"])
    assert agreement["ok"]
    for row in what:
        assert row in done.stdout


def test_a_replay_takes_the_way_of_its_record() -> None:
    record = simulate(load_scenario("S1"), create("minlp1"))
    again = simulate(load_scenario("S1"), Replay(record, obeys_hold=True))
    for column in ("time", "pressure_low", "mass_vehicle", "inlet_high", "outlet_low", "queue_length"):
        assert np.array_equal(again[column], record[column], equal_nan=True)


def test_asking_from_python_gives_the_same_bytes_and_the_observations_of_the_record() -> None:
    scenario = load_scenario("S1")
    watched = SecondBySecond(create("minlp3"))
    record = simulate(scenario, watched)
    assert record.to_bytes() == simulate(scenario, create("minlp3")).to_bytes()
    for row, seen in enumerate(watched.seen):
        if seen.vehicle >= 0:
            assert math.isnan(seen.energy)  # the thesis's plant keeps no account of it
            assert observation_at(record, row)._replace(energy=0.0) == seen._replace(energy=0.0)


def test_deciding_is_measured_once_a_repeat() -> None:
    found = in_the_loop(load_scenario("S1"), "minlp1", 3)
    assert len(found) == 3
    assert all(abs(value) < 1e-3 for value in found)  # seconds; a short run on a busy machine may even come out below 0


@pytest.mark.parametrize(
    ("row", "shown"),
    [
        (Row("a", (0.5, 0.1, 0.2), "s", Bar("at most", 3)), ("a", "0.2 s (0.1 to 0.5)", "<= 3 s", "yes")),
        (Row("b", (1.0,), "times", Bar("at least", 1.7)), ("b", "1 times", ">= 1.7 times", "NO")),
        (Row("c", (1e-16,), "1"), ("c", "1e-16", "", "")),
    ],
)
def test_a_row_is_shown_with_range_and_bar(row: Row, shown: tuple[str, ...]) -> None:
    assert cells(row) == shown


def test_other_processes_are_noticed_and_children_are_not() -> None:
    neighbours = Neighbours()
    busy = "import time\nend = time.monotonic() + 0.5\nwhile time.monotonic() < end: pass"
    subprocess.run([sys.executable, "-c", busy], check=True)
    assert 0 <= neighbours.share() <= cores()


def test_numbers_are_shown_to_three_digits() -> None:
    assert [number(value) for value in (0.01234, 99.44, 12345.6)] == ["0.0123", "99.4", "12 346"]
