"""Python that the pages of the bridges show is run as it stands there, but for the service's address."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

from api.client import Service
from tests.api.conftest import RunningService
from tests.api.here import hrs

DOCS = Path(__file__).parents[3] / "docs"


def _blocks(page):
    found = re.findall(r"```python\n(.*?)```", (DOCS / page).read_text(), re.DOTALL)
    assert found
    return found


@pytest.mark.parametrize("page", ["gymnasium.md"])
def test_what_a_page_shows_runs(page, capsys):
    for block in _blocks(page):
        exec(compile(block, page, "exec"), {})  # noqa: S102  # of our own page
    assert "t_total" in capsys.readouterr().out


@pytest.mark.skipif(shutil.which("gcc") is None, reason="there is no C compiler")
@pytest.mark.filterwarnings("ignore")  # FMPy warns of inputs that nobody gives
def test_what_the_page_of_fmi_shows_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    done = hrs("export", "fmu", "thesis-fit", "--version", "3", "--out", "station.fmu")
    assert done.returncode == 0, done.stderr
    capsys.readouterr()
    for block in _blocks("fmi.md"):
        exec(compile(block, "fmi.md", "exec"), {})  # noqa: S102  # of our own page
    assert 500 < float(capsys.readouterr().out.split()[-1]) < 700


@pytest.mark.slow
def test_what_the_page_of_the_api_shows_of_things_runs(tmp_path, capsys):
    running = RunningService(tmp_path, "--workers", "0")
    try:
        with Service(url=running.url) as service:
            service.start("S1", id="demo", at_end="repeat")
        [block] = [block for block in _blocks("api.md") if "/thing" in block]
        exec(block.replace("http://127.0.0.1:8000", running.url), {})  # noqa: S102  # of our own page
    finally:
        running.stop()
    assert capsys.readouterr().out == "10.0\n"


@pytest.mark.slow
def test_what_the_page_of_the_client_shows_runs(tmp_path, capsys):
    running = RunningService(tmp_path, "--workers", "1")
    try:
        for block in _blocks("client.md"):
            exec(block.replace("http://127.0.0.1:8000", running.url), {})  # noqa: S102  # of our own page
    finally:
        running.stop()
    said = capsys.readouterr().out
    assert "shape: (40, 27)" in said  # the comparison's table
    assert re.search(r"^1\d\d \d+\.\d+$", said, re.MULTILINE)  # the last sample
