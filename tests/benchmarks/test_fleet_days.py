"""Drawn days against logic: what is counted, what is written, and what is asked for by name."""

from __future__ import annotations

import io
import json

import pytest
from typer import Exit

from benchmarks import fleet_days
from benchmarks.duel import Outcome, verdict


def _day(t_avg: float, restored: float, unserved: float) -> Outcome:
    return Outcome(t_avg, restored, 100.0, unserved, 0.01)


def test_a_day_that_leaves_a_vehicle_more_is_counted_even_where_another_makes_up_for_it():
    theirs = [_day(10.0, 100.0, 0.0), _day(10.0, 100.0, 3.0), _day(10.0, 100.0, 1.0)]
    found = verdict(theirs, [_day(9.0, 99.0, 1.0), _day(11.0, 99.0, 1.0), _day(9.0, 101.0, 1.0)])
    assert found.left == 1
    assert (found.wait, found.compress, found.both) == (2, 2, 1)
    assert found.unserved == (4.0, 3.0)


def test_days_tell_how_far_they_are_and_are_written_as_json(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(fleet_days, "outcomes", map)  # in this process
    line = io.StringIO()
    cell = [("thesis-fit", False)]
    (told,) = fleet_days.verdicts(["reserve"], 2, cell, line)
    assert "reserve, thesis-fit, usual: 2 of 2 days" in line.getvalue()
    file = tmp_path / "days.json"
    with pytest.raises(Exit) as ended:
        fleet_days.main(["reserve"], days=2, station=["thesis-fit"], fleet="usual", json_file=file)
    (row,) = json.loads(file.read_text())["rows"]
    assert (row["controller"], row["station"], row["fleet"], row["days"]) == ("reserve", "thesis-fit", "usual", 2)
    assert row["mean_t_avg_s"] == list(told[3].t_avg)
    assert ended.value.exit_code == int(told[3].left > 0) == 0
    assert "reserve thesis-fit usual" in capsys.readouterr().out
