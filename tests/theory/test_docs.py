"""docs/theory.md and docs/predictive.md: what they show was run."""

from __future__ import annotations

import re
from pathlib import Path

PREDICTIVE = (Path(__file__).parents[2] / "docs" / "predictive.md").read_text()
PAGE = (Path(__file__).parents[2] / "docs" / "theory.md").read_text()


def test_the_python_example_prints_what_it_says(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    block = re.search(r"```python\n(.*?)```", PAGE, re.DOTALL)[1]
    exec(compile(block, "theory.md", "exec"), {})  # noqa: S102  # the page's own example
    bound, certified, reached = capsys.readouterr().out.split()
    assert f"{float(bound):.4f} from the synthesis, {float(certified):.4f} certified" in block
    assert float(reached) <= float(certified)
    assert (tmp_path / "cert.json").stat().st_size > 1000


def test_every_picture_is_there():
    folder = Path(__file__).parents[2] / "docs"
    pictures = re.findall(r"!\[[^]]*\]\(([^)]+)\)", PAGE)
    assert len(pictures) == 6
    assert all((folder / picture).is_file() for picture in pictures)


def test_table_3_3_on_the_page_is_the_printed_one():
    from theory.switching.examples import table_3_3

    for cell in table_3_3():
        line = next(
            row for row in PAGE.splitlines() if row.startswith(f"| {cell.delay} | {cell.lift} | {cell.gain:.4f} |")
        )
        assert abs(float(line.split("|")[4]) - cell.gain) < 1e-4


def test_the_examples_of_predictive_control_print_what_they_say(capsys):
    blocks = re.findall(r"```python\n(.*?)```", PREDICTIVE, re.DOTALL)
    assert len(blocks) == 2
    for block in blocks:
        exec(compile(block, "predictive.md", "exec"), {})  # noqa: S102  # the page's own examples
        for line in capsys.readouterr().out.strip().splitlines():
            assert f"`{line}`" in PREDICTIVE


def test_every_picture_of_predictive_control_is_there():
    folder = Path(__file__).parents[2] / "docs"
    pictures = re.findall(r"!\[[^]]*\]\(([^)]+)\)", PREDICTIVE)
    assert len(pictures) == 5
    assert all((folder / picture).is_file() for picture in pictures)
