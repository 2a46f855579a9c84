"""Certificates that somebody changed: they verify only if nothing was, and whatever they hold they end in words."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any

from hypothesis import strategies as st

from api.certificates import service
from controllers.certified.service import RefusedError
from controllers.certified.service import verify as verify_service
from tests.fuzz.documents import mutated, values
from tests.fuzz.properties import Property
from theory import Refused, verify
from theory.checker import checksum

PROBLEMS = Path(__file__).parents[2] / "docs" / "examples" / "theory"

WHOLE = ("problem", "claim", "proof")
"""What a certificate claims and proves; the rest, its `about`, is told and not trusted."""

CONTROLLED = {
    "ask": "gain", "lift": 0, "clock": 0, "constraint": {"kind": "arbitrary"},
    "modes": [{"A": [[a]], "B": [["1"]], "C": [["1"]], "E": [["1", "0"]], "M": [["1"]], "N": [["0", "0.1"]]}
              for a in ("1.1", "0.9")],
    "gains": [{"mode": mode, "clock": 0, "A": [["0.1"]], "B": [["0.4"]], "C": [["-0.5"]], "D": [["-0.4"]]}
              for mode in (1, 2)],
}  # fmt: skip
"""A plant of which a reading with an error is known, and a controller with a state of its own."""


@cache
def certificates() -> list[dict[str, Any]]:
    """Certificates of small systems, and a counterproof."""
    found = []
    for name in ("dwell", "arbitrary", "asynchronous", "varying"):
        given = tomllib.loads((PROBLEMS / f"{name}.toml").read_text(), parse_float=str)
        found.append(service.answer(service.question_of(given, name)).document)
    found.append(service.answer(service.question_of(CONTROLLED, "controlled")).document)
    against = {**tomllib.loads((PROBLEMS / "arbitrary.toml").read_text(), parse_float=str), "ask": "stability"}
    found.append(service.answer(service.question_of({**against, "lift": 1}, "against")).document)
    return [json.loads(json.dumps(document)) for document in found if document is not None]


HUGE = (10**59, f"1/{'9' * 60}", "9" * 60, "9" * 5000, -1, 0, 0.5, "1e9", "0.1", "1/0", 10**4000, 2**31)
"""Numbers where rationals stand: enormous, tiny, not rational, or none."""


def _paths(value: Any, *at: Any) -> list[tuple[Any, ...]]:
    """Where the numbers of a document stand."""
    if isinstance(value, dict | list):
        items = value.items() if isinstance(value, dict) else enumerate(value)
        return [path for key, item in items for path in _paths(item, *at, key)]
    return [at] if isinstance(value, int | float) or _is_number(value) else []


def _is_number(value: Any) -> bool:
    try:
        return isinstance(value, str) and Fraction(value) is not None
    except (ValueError, ZeroDivisionError):
        return False


@st.composite
def changed(draw: Callable[[Any], Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """(a certificate, the same with changes); its checksum made to fit, as somebody who cheats would."""
    good = draw(st.sampled_from(certificates()))
    if draw(st.booleans()):
        made = json.loads(json.dumps(good))
        *where, last = draw(st.sampled_from([path for path in _paths(made) if path[0] in WHOLE]))
        holder = made
        for key in where:
            holder = holder[key]
        bit = draw(st.integers(0, 80))
        held = holder[last]
        holder[last] = draw(st.sampled_from([*HUGE, held ^ (1 << bit) if isinstance(held, int) else f"-{held}"]))
    else:
        made = draw(mutated(good))
    if isinstance(made, dict) and draw(st.booleans()):
        try:
            made["checksum"] = checksum(made)
        except (ValueError, TypeError):
            return good, made
    return good, made


def refused(error: Refused | RefusedError) -> None:
    """It says why, in words that fit a terminal."""
    assert 0 < len(str(error)) < 20_000


def check_certificate(drawn: tuple[dict[str, Any], dict[str, Any]]) -> None:
    """It is refused, or what it proves is what it says: the same claim about another system only if that is proved."""
    good, made = drawn
    try:
        found = verify(made)
    except Refused as error:
        refused(error)
        return
    if made["checksum"] == good["checksum"]:
        assert {name: made[name] for name in WHOLE} == {name: good[name] for name in WHOLE}
    assert found.claim == verify(good).claim or made["claim"] != good["claim"] or made["problem"] != good["problem"]


def check_anything(document: Any) -> None:
    """No JSON is a certificate by accident."""
    if isinstance(document, dict):
        try:
            verify(document)
        except Refused as error:
            refused(error)
        else:
            raise AssertionError(document)


def service_properties(proved: dict[str, Any]) -> list[Property]:
    """Of a certificate of service that holds: equal to what it was, or refused."""

    def check(made: dict[str, Any]) -> None:
        try:
            found = verify_service(made)
        except RefusedError as error:
            refused(error)
            return
        assert found == made

    return [Property("certificates of service", mutated(proved, most=2), check)]


PROPERTIES = [
    Property("certificates", changed(), check_certificate),
    Property(
        "no certificates", values | st.dictionaries(st.sampled_from(["format", "version"]), values), check_anything
    ),
]
