"""docs/telemetry.md names every column, event and command there is."""

from __future__ import annotations

import re
from pathlib import Path

from api.twins.feed import COLUMNS, EventKind
from station import Limit

PAGE = (Path(__file__).parents[2] / "docs" / "telemetry.md").read_text()


def test_the_table_of_columns_is_the_columns():
    table = PAGE.split("| column | unit | what |")[1].split("\n\n")[0]
    found = dict(re.findall(r"^\| `(\w+)` \| (\S+) \|", table, re.MULTILINE))
    assert list(found.items()) == list(COLUMNS.items())


def test_every_kind_of_event_is_explained():
    table = PAGE.split("| kind | details |")[1].split("\n\n")[0]
    first_cells = [line.split("|")[1] for line in table.splitlines() if "|" in line]
    named = {name for cell in first_cells for name in re.findall(r"`(\w+)`", cell)}
    assert named == {str(kind) for kind in EventKind}


def test_every_limit_has_its_number():
    text = PAGE.split("A refused valve's number is the limit that forbade it:")[1].split("\n\n")[0]
    numbers = sorted(int(number) for number in re.findall(r"\b(\d+) [a-z]", text))
    assert numbers == [limit.value for limit in Limit if limit]
