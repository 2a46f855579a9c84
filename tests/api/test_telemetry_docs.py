"""docs/telemetry.md names every column, event and command there is."""

from __future__ import annotations

import re
from pathlib import Path

import zenoh

from api.telemetry.publisher import signals
from api.twins.messages import COLUMNS, EventKind, Sample
from station import Limit, Observation
from station.plants.interface import plant_named

DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "telemetry.md").read_text()


def test_the_table_of_columns_is_the_columns():
    table = PAGE.split("| column | unit | what |")[1].split("\n\n")[0]
    found = dict(re.findall(r"^\| `(\w+)` \| (\S+) \|", table, re.MULTILINE))
    assert list(found.items()) == list(COLUMNS.items())


def test_the_table_of_a_plants_own_columns_is_those_columns():
    table = PAGE.split("| column of a station with real gas | unit | what |")[1].split("\n\n")[0]
    found = dict(re.findall(r"^\| `(\w+)` \| (\S+) \|", table, re.MULTILINE))
    own = plant_named("real-gas").columns
    assert list(found.items()) == list(own.items())
    sample = Sample("demo", 1, 0, 0.0, tuple(map(float, range(len(COLUMNS) + len(own)))), layout="real-gas")
    told = {name: document["unit"] for name, document in signals(sample)}
    assert list(told.items()) == [*COLUMNS.items(), *own.items()]


def test_every_kind_of_event_is_explained():
    table = PAGE.split("| kind | details |")[1].split("\n\n")[0]
    first_cells = [line.split("|")[1] for line in table.splitlines() if "|" in line]
    named = {name for cell in first_cells for name in re.findall(r"`(\w+)`", cell)}
    assert named == {str(kind) for kind in EventKind}


def test_numbers_of_limits_are_the_codes_of_the_glossary():
    text = PAGE.split("A refused valve's number is the limit that forbade it")[1].split("\n\n")[0]
    assert "(glossary.md#limits)" in text
    table = (DOCS / "glossary.md").read_text().split("\n## Limits\n")[1].split("\n\n## ")[0]
    codes = {name: int(code) for name, code in re.findall(r"`([A-Z_]+)` \| (\d+) \|", table)}
    assert codes == {limit.name: limit.value for limit in Limit if limit}


def test_every_key_expression_can_be_declared():
    found = set(re.findall(r"hrs/v1/[^\s`\"?]+", PAGE))
    assert len(found) > 10
    for text in found:
        zenoh.KeyExpr(text.replace("{twin}", "demo").replace("{name}", "pressure_high"))


def test_fields_of_samples_signals_and_questions_are_named():
    sample = Sample("demo", 1, 0, 0.0, tuple(map(float, range(len(COLUMNS)))))
    table = PAGE.split("| field | type | unit | what |")[1].split("\n\n")[0]
    assert re.findall(r"^\| `(\w+)` \|", table, re.MULTILINE) == list(sample.document())
    example = PAGE.split("## Signal")[1].split("`")[1]
    assert re.findall(r'"(\w+)":', example) == list(signals(sample)[0][1])
    table = PAGE.split("with the observation as payload:")[1].split("\n\n")[1]
    first_cells = [line.split("|")[1] for line in table.splitlines()[2:]]
    named = [name for cell in first_cells for name in re.findall(r"`(\w+)`", cell)]
    assert named == ["version", "twin", *Observation._fields]
