"""Every limit stands once in the registry, and whatever keeps, names or proves limits covers it or fails by name."""

from __future__ import annotations

import re
from enum import IntEnum
from pathlib import Path

import pytest

from controllers.certified import proof
from controllers.minlp.objective import Objective
from controllers.minlp.symbolic import Stage, Tanks, Valves
from station import Limit, limits, load_station, margins
from station.errors import UncoveredLimitError
from station.limits import LIMITS, CommandLimit, Situation, StateLimit, check_codes, state_limits
from station.uncertainty import Uncertainty
from station.valves import first_forbidding

ROOT = Path(__file__).parents[2]
PLANT = load_station("thesis-fit").constants()
OBJECTIVE = Objective(1.0, 1.0, 1.0, 1.0, 900.0)


class Fake(IntEnum):
    """A limit that nobody has heard of."""

    FULL = 14
    TOO_FAR = 16


def full_margin(at, plant, period):
    return 700.0 - at.pressure


FULL = StateLimit(Fake.FULL, "full", "(ours)", "bar", "inlet", full_margin)


@pytest.fixture
def full(monkeypatch):
    """The registry with one limit more."""
    monkeypatch.setattr(limits, "LIMITS", (*LIMITS, FULL))


def test_every_limit_is_registered_once():
    assert sorted(limit.limit for limit in LIMITS) == sorted(limit for limit in Limit if limit)
    assert len({limit.name for limit in state_limits()}) == len(state_limits())
    assert [limit for limit in LIMITS if limit.limit not in Limit] == []


@pytest.mark.parametrize("code", [Fake.TOO_FAR, Limit.GAP])
def test_codes_are_their_own_and_fit_into_their_bits(code):
    with pytest.raises(
        ValueError, match=f"limit {code.name}: code {int(code)} is another's, or needs more than 4 bits"
    ):
        check_codes((*LIMITS, CommandLimit(code, "")))


def test_the_shield_is_made_of_the_registry(full):
    """A limit that is registered is kept, and named, where no other forbids the valve."""
    first = first_forbidding(state_limits("inlet"))
    at = Situation(0, 650.0, 30.0, 0.0, 0.0)
    assert first(at, True, PLANT, 1.0) == 0
    assert first(at._replace(pressure=701.0), True, PLANT, 1.0) == Fake.FULL
    assert first(at._replace(pressure=801.0), False, PLANT, 1.0) == Limit.HOLD
    assert first(at._replace(pressure=2000.0), True, PLANT, 1.0) == Limit.COMPRESSOR_PRESSURE


def test_solver_models_state_every_limit(full, monkeypatch):
    stage = Stage(PLANT, OBJECTIVE, True, 0.2, 1.0)
    tanks = Tanks((1.0,) * 4, (30.0,) * 4, (690.0, 710.0, 500.0, 100.0))
    valves = Valves((1, 1, 1), (0, 0, 0))
    more = stage.margins(tanks, valves, (0, 0, 0))
    monkeypatch.setattr(limits, "LIMITS", LIMITS)
    fewer = stage.margins(tanks, valves, (0, 0, 0))
    assert sorted(more) == sorted([*fewer, 10.0, -10.0, 200.0])


def test_solver_models_name_a_limit_on_closed_valves_that_they_do_not_know(monkeypatch):
    late = StateLimit(Fake.FULL, "late", "(ours)", "bar", "inlet", full_margin, of_closed=True)
    monkeypatch.setattr(limits, "LIMITS", (*LIMITS, late))
    with pytest.raises(UncoveredLimitError, match="solver models: the limit 'late' is not covered"):
        Stage(PLANT, OBJECTIVE, False, 0.2, 1.0).margins(Tanks((1.0,) * 3, (30.0,) * 3, (500.0,) * 3), None, (0, 0, 0))


def test_margins_name_a_limit_that_they_do_not_know(full):
    with pytest.raises(UncoveredLimitError, match="margins: the limit 'full' is not covered"):
        margins.certify(load_station("thesis-fit"), Uncertainty(pressure_bar=0.123))


def test_proofs_of_service_name_a_limit_that_they_do_not_know(full):
    with pytest.raises(UncoveredLimitError, match="proofs of service: the limit 'full' is not covered"):
        proof.check_limits()


def test_nothing_is_covered_that_is_no_limit():
    names = {limit.name for limit in state_limits(plant=PLANT)}
    assert set(proof.KEPT) == names
    assert set(margins.certify(load_station("thesis-fit"), Uncertainty()).margins) == names


def test_the_page_and_the_documents_name_every_limit():
    page = (ROOT / "api" / "page" / "static" / "live" / "names.js").read_text(encoding="utf-8")
    listed = page[page.index("export const LIMITS") : page.index("];", page.index("export const LIMITS"))]
    assert re.findall(r'name: "(\w+)"', listed) == [limit.name.lower() for limit in Limit if limit]
    glossary = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
    for limit in LIMITS:
        code = f"| `{limit.limit.name}` | {int(limit.limit)} |"
        line = next(line for line in glossary.splitlines() if code in line)
        equation = limit.equation if re.fullmatch(r"7\.\d+", limit.equation) else ""
        assert f"({equation})" in line or (not equation and "(ours)" in line)
        shown = re.search(rf'name: "{limit.limit.name.lower()}".*?equation: "?([\w.]*)', listed)
        assert shown[1] in (equation, "null", "")
