"""docs/examples/gallery: every script and notebook runs, and prints what it says it prints."""

from __future__ import annotations

import ast
import json
import re
import runpy
import sys
from pathlib import Path

import pytest

from tests.shown import agree

GALLERY = Path(__file__).parents[1] / "docs" / "examples" / "gallery"
SCRIPTS = sorted(GALLERY.glob("*.py"))
NOTEBOOKS = sorted(GALLERY.glob("*.ipynb"))

ELSEWHERE = {"listen.py": "docs/tutorials/first-subscriber.md"}
"""Scripts that need a service, and the page whose commands run them (`test_docs_commands`)."""

SLOW = {
    "bound.py": "potentials of a station are proved: 9 s of CPU",
    "learned_policy.py": "a policy is searched for: 6 s of CPU",
}


def _marked(path: Path):
    return pytest.param(path, id=path.name, marks=[pytest.mark.slow] if path.name in SLOW else [])


@pytest.mark.parametrize("script", [_marked(path) for path in SCRIPTS if path.name not in ELSEWHERE])
def test_a_script_prints_what_it_says(script, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [str(script)])
    names = runpy.run_path(str(script), run_name="__main__")
    printed = re.search(r"\nIt prints\n\n(.*)", names["__doc__"], re.DOTALL)
    assert printed is not None, "the docstring shows what is printed"
    shown = [line.removeprefix("    ") for line in printed[1].rstrip().splitlines()]
    agree(shown, capsys.readouterr().out)


@pytest.mark.parametrize("notebook", [_marked(path) for path in NOTEBOOKS])
def test_a_notebook_shows_what_its_cells_give(notebook, tmp_path, monkeypatch, capsys):
    """Without a kernel: cells are run one after the other, the value of a last expression is shown."""
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {"__name__": "__main__"}
    cells = [cell for cell in json.loads(notebook.read_text())["cells"] if cell["cell_type"] == "code"]
    assert cells
    for cell in cells:
        tree = ast.parse("".join(cell["source"]))
        last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
        exec(compile(tree, notebook.name, "exec"), names)  # noqa: S102  # the notebook's own cells
        if last is not None:
            value = eval(compile(ast.Expression(last.value), notebook.name, "eval"), names)  # noqa: S307
            if value is not None:
                print(repr(value))
        shown = [
            line
            for output in cell["outputs"]
            for line in "".join(output.get("text", output.get("data", {}).get("text/plain", ""))).splitlines()
        ]
        agree(shown, capsys.readouterr().out)


def test_every_example_of_the_gallery_is_listed():
    listed = (GALLERY.parent / "README.md").read_text()
    assert [path.name for path in (*SCRIPTS, *NOTEBOOKS) if f"(gallery/{path.name})" not in listed] == []


def test_what_runs_elsewhere_is_run_there():
    for name, page in ELSEWHERE.items():
        assert f"$ python docs/examples/gallery/{name}" in (GALLERY.parents[2] / page).read_text()
