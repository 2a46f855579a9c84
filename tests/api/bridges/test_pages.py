"""Python that the pages of the bridges show is run as it stands there, but for the service's address."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.api.conftest import RunningService

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
