"""Drawn days against logic: what is counted, what is written, and what is asked for by name."""

from __future__ import annotations

import io
import json

import pytest
from typer import Exit

from benchmarks import fleet_days
from benchmarks.duel import Outcome, verdict


def _day(t_avg: float, restored: float, *unserved: int) -> Outcome:
    return Outcome(t_avg, restored, 100.0, frozenset(unserved), 0.95, 60.0, 0.01)


def test_a_day_that_leaves_a_vehicle_more_is_counted_even_where_another_makes_up_for_it():
    theirs = [_day(10.0, 100.0), _day(10.0, 100.0, 3, 4, 5), _day(10.0, 100.0, 1)]
    found = verdict(theirs, [_day(9.0, 99.0, 1), _day(11.0, 99.0, 3), _day(9.0, 101.0, 2)])
    assert found.left == 2  # also where it is another one
    assert (found.wait, found.compress, found.both) == (2, 2, 1)
    assert found.unserved == (4, 3)


def test_a_tank_that_is_filled_or_warmed_too_far_is_told():
    row = fleet_days.as_document("x", "h70-light", True, verdict([_day(1.0, 1.0)], [_day(1.0, 1.0)]))
    assert fleet_days.kept(row)
    assert not fleet_days.kept({**row, "state_of_charge_max": 1.001})
    assert not fleet_days.kept({**row, "vehicle_temperature_max_c": 85.1})
    assert not fleet_days.kept({**row, "days_with_one_not_served_that_logic_serves": 1})


def test_days_tell_how_far_they_are_and_are_written_as_json(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(fleet_days, "outcomes", map)  # in this process
    line = io.StringIO()
    told = fleet_days.against_logic("reserve", "thesis-fit", False, range(2), line)
    assert "reserve, thesis-fit, usual: 2 of 2 days" in line.getvalue()
    file = tmp_path / "days.json"
    with pytest.raises(Exit) as ended:
        fleet_days.main(["reserve"], days=2, station=["thesis-fit"], fleet="usual", json_file=file)
    (row,) = json.loads(file.read_text())["rows"]
    assert (row["controller"], row["station"], row["fleet"], row["days"]) == ("reserve", "thesis-fit", "usual", 2)
    assert row["mean_t_avg_s"] == list(told.t_avg)
    assert ended.value.exit_code == int(told.left > 0) == 0
    assert json.loads(capsys.readouterr().out) == row


def test_a_row_of_fewer_days_is_gone_on_with(tmp_path, monkeypatch):
    monkeypatch.setattr(fleet_days, "outcomes", map)
    monkeypatch.setattr(fleet_days, "PORTION", 2)
    whole, grown = tmp_path / "whole.json", tmp_path / "grown.json"
    for file, counts in ((whole, [4]), (grown, [1, 4])):
        for days in counts:
            with pytest.raises(Exit):
                fleet_days.main(["reserve"], days=days, station=["h35-bus"], fleet="mixed", json_file=file, resume=True)
    ((one,), (other,)) = (fleet_days.rows_of(file) for file in (whole, grown))
    del one["cpu_of_an_hour_s"], other["cpu_of_an_hour_s"]
    assert other.pop("days") == one.pop("days") == 4
    for name, figure in one.items():
        assert other[name] == (figure if isinstance(figure, str) else pytest.approx(figure, rel=1e-12)), name


def test_rows_that_are_there_are_not_played_again(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(fleet_days, "outcomes", map)
    file = tmp_path / "days.json"
    for controllers in (["reserve"], ["reserve", "logic"]):
        with pytest.raises(Exit):
            fleet_days.main(controllers, days=1, station=["h35-bus"], fleet="mixed", json_file=file, resume=True)
    assert [row["controller"] for row in fleet_days.rows_of(file)] == ["reserve", "logic"]
    assert len(capsys.readouterr().out.splitlines()) == 2
    assert all(row["state_of_charge_max"] <= 1.0 for row in fleet_days.rows_of(file))
