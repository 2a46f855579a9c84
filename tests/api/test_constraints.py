"""A constraint that the checker knows is asked for, said and explained under the same name everywhere."""

from __future__ import annotations

import re
from pathlib import Path
from typing import get_args

import pytest

from api.certificates.questions import Constraint
from theory.checker import Refused, rules
from theory.errors import IllPosedError
from theory.switching.language import language_of

ROOT = Path(__file__).parents[2]

DERIVED = {"clocked"}
"""Made of another constraint and a clock: nobody asks for it by name."""


def _known() -> set[str]:
    """The kinds that the checker names where it refuses one."""
    with pytest.raises(Refused) as refused:
        rules({"kind": "nothing"}, 1)
    return set(str(refused.value).split("known are ")[1].split(", "))


KNOWN = _known()


def test_a_request_names_every_constraint():
    union, *_ = get_args(Constraint)
    assert {get_args(model.model_fields["kind"].annotation)[0] for model in get_args(union)} == KNOWN - DERIVED


def test_python_names_every_constraint():
    with pytest.raises(IllPosedError) as refused:
        language_of({"kind": "nothing"}, 2)
    assert set(str(refused.value).split("is none of ")[1].split(", ")) == KNOWN - DERIVED


def test_the_page_says_every_constraint_in_words():
    script = (ROOT / "api" / "page" / "static" / "certificates" / "document.js").read_text(encoding="utf-8")
    said = script.split("export function constraintInWords")[1].split("}[kind]")[0]
    assert set(re.findall(r"^    (\w+): \(\) =>", said, re.MULTILINE)) == KNOWN


def test_the_table_explains_every_constraint():
    page = (ROOT / "docs" / "theory.md").read_text(encoding="utf-8")
    table = page.split("| `constraint.kind` |")[1].split("\n\n")[0]
    assert set(re.findall(r"^\| `(\w+)` \|", table, re.MULTILINE)) == KNOWN - DERIVED
