"""The command line as a user types it, in a process of its own."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from api.comparisons.export import ABOUT, file_of
from station.metrics import UNITS
from station.record import Record
from tests.warm import run_hrs as hrs


def test_compare_prints_tables_and_writes_documents(tmp_path):
    files = ("--json", tmp_path / "o.json", "--html", tmp_path / "o.html", "--out", tmp_path / "o.csv")
    done = hrs("compare", "S1", "S2", *files)
    assert done.returncode == 0, done.stderr
    assert "Table 7.4" in done.stdout
    assert "thesis" in done.stdout
    assert "…" not in done.stdout  # no figure is cut, however narrow
    rows = json.loads((tmp_path / "o.json").read_text())["results"]
    assert len(rows) == 8
    assert rows[0]["t_total"] == 1054
    assert (tmp_path / "o.html").read_text().startswith("<!doctype html>")
    with (tmp_path / "o.csv").open(newline="") as file:
        table = list(csv.DictReader(file))
    assert [(row["scenario"], row["controller"], float(row["t_total"])) for row in table] == [
        (row["scenario"], row["controller"], row["t_total"]) for row in rows
    ]


def test_a_comparison_is_written_as_its_ending_says(tmp_path):
    document = {"units": dict(UNITS), "results": [dict.fromkeys(UNITS, 1.0) | dict.fromkeys(ABOUT[:2], "a")]}
    assert json.loads(file_of(document, ".json")) == document
    assert file_of(document, ".csv").count("\n") == 2
    assert file_of(document, ".parquet")[:4] == b"PAR1"
    done = hrs("compare", "S1", "--out", "runs.txt", cwd=tmp_path)
    assert (done.returncode, "must end in .csv or .parquet or .json" in done.stderr) == (2, True)


def test_a_scenario_printed_saved_and_changed_is_a_scenario(tmp_path):
    document = json.loads(hrs("scenarios", "S1", "--json").stdout)
    document["station"]["compressor"]["count"] = 2
    document["name"] = "two compressors"
    (tmp_path / "mine.json").write_text(json.dumps(document))
    done = hrs(
        "simulate", "mine.json", "--controller", "minlp1", "--out", "run.parquet", "--plot", "run.png", cwd=tmp_path
    )
    assert done.returncode == 0, done.stderr
    assert "two compressors at thesis-fit, controller minlp1" in done.stdout
    assert Record.from_parquet(tmp_path / "run.parquet").metrics().t_comp > 0
    assert (tmp_path / "run.png").read_bytes().startswith(b"\x89PNG")


def test_the_example_day_runs():
    examples = Path(__file__).parents[2] / "docs" / "examples"
    done = hrs("simulate", examples / "day.toml", "--controller", "logic")
    assert done.returncode == 0, done.stderr
    assert "vehicles_not_finished             0" in done.stdout


def test_lists():
    assert "S4" in hrs("scenarios").stdout
    assert "minlp3" in hrs("controllers").stdout
    assert len(json.loads(hrs("scenarios", "--json").stdout)) == len(["S1", "S2", "S3", "S4"])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("simulate", "S9"), "'S9' is neither a scenario"),
        (("simulate", "S1", "--controller", "x"), "none is called 'x'; there are adaptive, guarded, logic"),
        (("simulate", "S1", "--controller", "minlp1", "--option", "horizon=99"), "horizon: Input should be less"),
        (("simulate", "S1", "--option", "horizon"), "an option must be NAME=VALUE; given 'horizon'"),
        (("simulate", "S1", "--plot", "run.txt"), "must end in .png"),
        (("simulate", "S1", "--out", "nowhere/run.parquet"), "must be a file in a folder that exists"),
        (("simulate", "S1", "--station", "moon"), "no preset is called 'moon'"),
        (("compare", "S1", "--controllers", "logic,logic"), "stands twice"),
    ],
)
def test_a_wrong_word_is_one_clear_error(arguments, message, tmp_path):
    done = hrs(*arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith("error: ")
    assert message in done.stderr
    assert "Traceback" not in done.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_bound_prints_and_writes_what_no_controller_undercuts(tmp_path):
    done = hrs("bound", "S1", "--quick", "--wait", "0", "--wait", "300", "--json", tmp_path / "b.json")
    assert done.returncode == 0, done.stderr
    assert "No controller does better" in done.stdout
    (found,) = json.loads((tmp_path / "b.json").read_text())
    assert [point["wait_s"] for point in found["trade_off"]] == [0.0, 1500.0]
    assert found["trade_off"][0]["restored_s"] is None or found["trade_off"][0]["restored_s"] > 500
    assert 500 < found["trade_off"][1]["restored_s"] < 1500
    done = hrs("bound", "S1", "--wait", "-1")
    assert done.returncode == 2
    assert "--wait" in done.stderr
