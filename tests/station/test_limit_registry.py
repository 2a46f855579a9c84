"""Every limit stands once in the registry, and whatever keeps, names or proves limits covers it or fails by name."""

from __future__ import annotations

import ast
import math
from dataclasses import replace
from enum import IntEnum
from pathlib import Path
from typing import NamedTuple, get_type_hints

import numba
import pytest

from controllers.certified import proof
from controllers.minlp.objective import Objective
from controllers.minlp.symbolic import Stage, Tanks, Valves
from station import Limit, Station, limits, load_station, margins
from station.compiled import merged
from station.control_model import as_thesis
from station.errors import UncoveredLimitError
from station.limit_figures import LimitFigures
from station.limits import (
    LIMITS,
    CommandLimit,
    Figure,
    Situation,
    StateLimit,
    check_codes,
    state_limits,
    thesis_equation,
)
from station.sections import Thermal
from station.tightening import tightened
from station.uncertainty import Uncertainty
from station.valves import first_forbidding

ROOT = Path(__file__).parents[2]
PLANT = load_station("thesis-fit").constants()
OBJECTIVE = Objective(1.0, 1.0, 1.0, 1.0, 900.0)
USUAL = Uncertainty()


class Fake(IntEnum):
    """A limit that nobody has heard of."""

    FULL = 14
    TOO_FAR = 16


def full_margin(at, plant, period):
    return 700.0 - at.pressure


FULL = StateLimit(
    Fake.FULL, "full", "full", "bar", "inlet", full_margin, title="full", says="the buffer is full enough"
)


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
        check_codes((*LIMITS, CommandLimit(code, "", "", "")))


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
    late = replace(FULL, name="late", of_closed=True)
    monkeypatch.setattr(limits, "LIMITS", (*LIMITS, late))
    with pytest.raises(UncoveredLimitError, match="solver models: the limit 'late' is not covered"):
        Stage(PLANT, OBJECTIVE, False, 0.2, 1.0).margins(Tanks((1.0,) * 3, (30.0,) * 3, (500.0,) * 3), None, (0, 0, 0))


def test_margins_name_a_limit_that_they_do_not_know(full):
    with pytest.raises(UncoveredLimitError, match="margins: the limit 'full' is not covered"):
        margins.certify(load_station("thesis-fit"), Uncertainty(pressure_bar=0.123))


def test_proofs_of_service_name_a_limit_that_they_do_not_know(full):
    with pytest.raises(UncoveredLimitError, match="proofs of service: the limit 'full' is not covered"):
        proof.check_limits(PLANT)


def test_nothing_is_covered_that_is_no_limit():
    names = {limit.name for limit in state_limits(plant=PLANT)}
    assert set(proof.KEPT) == names
    assert set(margins.certify(load_station("thesis-fit"), Uncertainty()).margins) == names


def test_every_limit_has_words_of_its_own():
    for limit in LIMITS:
        assert limit.title.strip() == limit.title != ""
        assert limit.says.strip(" .") == limit.says != ""
    for words in ("title", "says"):
        assert len({getattr(limit, words) for limit in LIMITS}) == len(LIMITS)


def test_the_glossary_names_every_limit():
    glossary = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
    for limit in LIMITS:
        code = f"| `{limit.limit.name}` | {int(limit.limit)} |"
        line = next(line for line in glossary.splitlines() if code in line)
        assert f"({thesis_equation(limit) or 'ours'})" in line


def test_a_figure_is_declared_in_one_place():
    """Constants of plants and models hold the figures together, so that one more changes none of them."""
    for source in sorted((ROOT / "station").rglob("*.py")):
        declared = {
            node.target.id
            for node in ast.walk(ast.parse(source.read_text(encoding="utf-8")))
            if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name)
        }
        wanted = set(LimitFigures._fields) if source.name == "limit_figures.py" else set()
        assert declared & set(LimitFigures._fields) == wanted, source


# ---------------------------------------------------------------- a limit with a figure of its own

Figures = NamedTuple("Figures", [*get_type_hints(LimitFigures).items(), ("buffer_excess_max", float)])
"""The figures of a station, and one more: by how much a buffer may be warmer than the surroundings [K]."""


class OwnThermal(Thermal):
    """The section with the parameter, left out where there is no such limit."""

    buffer_excess_max_k: float | None = None


class OwnStation(Station):
    """A station whose figures follow from its sections, as `limit_figures` makes them."""

    thermal: OwnThermal

    def constants(self):
        plant, most = super().constants(), self.thermal.buffer_excess_max_k
        return plant._replace(limits=Figures(*plant.limits, math.inf if most is None else most))


def station_with(most):
    """The station thesis-fit with a greatest excess [K], or None."""
    given = load_station("thesis-fit").model_dump()
    return OwnStation.model_validate({**given, "thermal": {**given["thermal"], "buffer_excess_max_k": most}})


@merged
def excess_margin(at, plant, _period):
    return plant.limits.buffer_excess_max - (at.temperature - plant.ambient_temperature)


EXCESS = StateLimit(
    Fake.FULL, "excess", "excess", "K", "inlet", excess_margin, title="excess heat", says="the buffer is too warm",
    binds=lambda plant: plant.limits.buffer_excess_max < math.inf,
)  # fmt: skip
KNOWN = replace(
    EXCESS, errors=("ambient_temperature", "temperature"), figure=Figure("thermal", "buffer_excess_max_k", -1)
)
"""The same with what margins need."""


@pytest.fixture(params=[EXCESS, KNOWN], ids=["", "with errors and figure"])
def excess(monkeypatch, request):
    monkeypatch.setattr(limits, "LIMITS", (*LIMITS, request.param))
    return request.param


@pytest.mark.slow
def test_a_figure_of_its_own_reaches_the_compiled_shield(excess):
    first = first_forbidding(state_limits("inlet"))

    @numba.njit
    def compiled(at, plant):
        return first(at, True, plant, 1.0)

    warm, cool = (Situation(0, 500.0, temperature, 0.0, 0.0) for temperature in (35.5, 34.5))
    for most, expected in ((10.0, (Fake.FULL, 0)), (None, (0, 0))):
        model = station_with(most).control_constants()
        assert isinstance(model.limits, Figures)
        assert as_thesis(model) == station_with(most).constants()
        assert (first(warm, True, model, 1.0), first(cool, True, model, 1.0)) == expected
        assert (compiled(warm, model), compiled(cool, model)) == expected


def test_a_figure_of_its_own_reaches_solver_models(excess):
    tanks = Tanks((1.0,) * 3, (37.0, 30.0, 30.0), (500.0,) * 3)
    valves = Valves((1, 1, 1), (0, 0, 0))
    off, on = (
        Stage(station_with(most).control_constants(), OBJECTIVE, False, 0.2, 1.0).margins(tanks, valves, (0, 0, 0))
        for most in (None, 10.0)
    )
    assert sorted(on) == sorted([*off, -2.0, 5.0, 5.0])


def test_proofs_and_margins_need_a_limit_only_where_it_can_bind(excess):
    off, on = station_with(None), station_with(10.0)
    proof.check_limits(off.constants())
    with pytest.raises(UncoveredLimitError, match="proofs of service: the limit 'excess' is not covered"):
        proof.check_limits(on.constants())
    assert set(margins.certify(off, USUAL).margins) == set(proof.KEPT)
    if excess is EXCESS:
        with pytest.raises(UncoveredLimitError, match="margins: the limit 'excess' is not covered"):
            margins.certify(on, USUAL)
        return
    proved = margins.certify(on, USUAL)
    assert proved.margins["excess"] == pytest.approx(2 * USUAL.temperature_k)
    assert proved.check() == 82 + 4
    assert tightened(on, proved).thermal.buffer_excess_max_k == 10.0 - proved.margins["excess"]
