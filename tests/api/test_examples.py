"""`hrs example`: what it prints, writes and draws, and how it refuses."""

from __future__ import annotations

import json

import pytest
from typer.testing import CliRunner

from api.cli.main import app

runner = CliRunner()


def shown(*arguments: str) -> str:
    """What a command prints."""
    result = runner.invoke(app, ["example", *arguments])
    assert result.exit_code == 0, result.output
    return result.output


@pytest.mark.slow
def test_dmd_prints_a_run_and_its_guarantee(tmp_path):
    said = shown("dmd", "--plot", str(tmp_path / "run.png"), "--json", str(tmp_path / "run.json"))
    assert "mode 3        from sample 15 on, in 1 of 1 runs" in said
    assert "limits        0 broken, 0 escapes from a tube, in 40 samples" in said
    assert "It does not converge to 0, since the noise never ends" in said
    assert (tmp_path / "run.png").stat().st_size > 20_000
    run = json.loads((tmp_path / "run.json").read_text())["runs"][0]
    assert len(run["states"]) == 41
    assert run["model_in_set"] is True
    assert run["modes"][:3] == [1, 1, 3]


@pytest.mark.slow
def test_dmd_from_the_edge_and_in_three_states(tmp_path):
    said = shown("dmd", "--runs", "2", "--edge", "2")
    assert "2 starts, noise at its corners: 0 infeasible, 0 limits broken" in said
    said = shown("dmd", "--system", "three-states", "--plot", str(tmp_path / "run.svg"))
    assert "3 states, 2 input(s)" in said
    assert (tmp_path / "run.svg").read_text().startswith("<?xml")


@pytest.mark.slow
def test_paths_prints_a_drive_and_its_bounds(tmp_path):
    picture, document = str(tmp_path / "path.png"), str(tmp_path / "path.json")
    said = shown("paths", "--one-step", "5", "--choice", "20", "--plot", picture, "--json", document)
    assert "goal          reached in 1 of 1 runs" in said
    assert "by the tail over J = 216 paths" in said
    assert "J/(1+S) = 1 " not in said  # a bound of 1 is none
    assert "S = 39" in said
    assert "J = 16 " in said
    assert "2/(1+S) = 10.0 % is exceeded" in said
    assert (tmp_path / "path.png").stat().st_size > 20_000
    run = json.loads((tmp_path / "path.json").read_text())["runs"][0]
    assert run["arrived"] is True
    assert len(run["states"]) == len(run["steps"]) + 1
    assert {bound["kind"] for bound in run["steps"][8]["bounds"]} == {"range", "tail"}


@pytest.mark.slow
def test_paths_says_what_happened_otherwise():
    assert "1 left the map for good" in shown("paths", "--reading", "printed")
    assert "0 steps cut through an obstacle between samples" in shown("paths", "--between-samples", "--runs", "2")
    assert "gave up 1 scenarios" in shown("paths", "--remove", "1", "--scenarios", "29")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("paths", "--scenarios", "0"), "--scenarios"),
        (("paths", "--remove", "19"), "removed: must be a whole number between 0 and 18, given 19"),
        (("dmd", "--system", "four"), "--system"),
        (("dmd", "--plot", "run.txt"), "must end in .png"),
        (("dmd", "--json", "/nowhere/run.json"), "/nowhere"),
    ],
)
def test_bad_options_are_named(arguments: tuple[str, ...], message: str, monkeypatch, capsys):
    """By the program itself, whose errors of input end it with status 2."""
    from api.cli import main as cli

    monkeypatch.setattr("sys.argv", ["hrs", "example", *arguments])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 2
    assert message in capsys.readouterr().err
