"""Rates and gains from both sides: published radii, slow poles, other units, and what the certificate says of each."""

from __future__ import annotations

import copy
import json
import time
from fractions import Fraction

import numpy as np
import pytest

from benchmarks.theory_coordinates import cases, outcome
from tests.pace import slowness
from theory import (
    ArbitrarySwitching,
    IllPosedError,
    LabelledGraph,
    NotCertifiedError,
    PersistentDwellTime,
    Refused,
    Representation,
    SwitchedSystem,
    checker,
    verify,
)
from theory.errors import SolverError
from theory.solvers.lmi import LmiProblem
from theory.switching import gain, loops, reach, stability
from theory.switching.examples import example, radii
from theory.switching.graph import WordList
from theory.switching.system import decimal

ANY = ArbitrarySwitching(modes=1)


@pytest.mark.parametrize("radius", radii(), ids=lambda radius: radius.name)
def test_published_radii_from_both_sides(radius):
    """The lift is found; both bounds, exactly proved, are within 1e-5 of each other."""
    found = stability.decay_rate(radius.system, radius.language, gap=9e-6, budget=60.0)
    assert found.at_least <= radius.value * (1 + 1e-6)
    assert found.value >= radius.value * (1 - 1e-6)
    assert found.value / found.at_least - 1 <= 1e-5
    assert "decays no faster" in verify(json.loads(found.text())).claim


@pytest.mark.parametrize("pole", ["0.995", "0.9995", "0.99999"])
def test_slow_poles_have_gain_and_radius_1(pole):
    rest = decimal(1 - Fraction(pole))
    one = SwitchedSystem(A=[[[pole]]], E=[[[rest]]], C=[[["1"]]])
    two = SwitchedSystem(A=[[[pole]]] * 2, E=[[[rest]], [[f"-{rest}"]]], C=[[["1"]]] * 2)
    for system, language in ((one, ANY), (two, ArbitrarySwitching(modes=2))):
        found = reach.certify(system, language)
        assert found.value == pytest.approx(1, rel=1e-4)
        assert found.at_least == pytest.approx(1, rel=1e-8)
    for system, language in ((one, ANY), (two, ArbitrarySwitching(modes=2))):
        found = gain.certify(system, language)
        assert found.value == pytest.approx(1, rel=1e-5)
        assert found.value / found.at_least - 1 <= 1e-5


LOOP = [[0.5, 0.3, 0.0], [-0.4, 0.6, 0.2], [0.0, 0.1, 0.3]]


@pytest.mark.parametrize("unit", [1e-6, 1e4, 1e6])
def test_a_state_in_another_unit_changes_nothing(unit):
    scale = np.diag([1.0, 1.0, unit])
    back = np.linalg.inv(scale)
    plain = SwitchedSystem(A=[LOOP], E=[[[1.0], [0.0], [0.5]]], C=[[[0.5, 1.0, 1.0]]])
    moved = SwitchedSystem(
        A=[scale @ np.array(LOOP) @ back], E=[scale @ [[1.0], [0.0], [0.5]]], C=[np.array([[0.5, 1.0, 1.0]]) @ back]
    )
    for ask in (gain.certify, stability.decay_rate):
        assert ask(moved, ANY).value == pytest.approx(ask(plain, ANY).value, rel=1e-5)


@pytest.mark.parametrize("size", ["1e-6", "1", "1e6"])
def test_small_and_large_maps_decay_alike(size):
    maps = np.array([LOOP, np.array(LOOP).T]) * float(size)
    plain = stability.decay_rate(SwitchedSystem(A=[LOOP, np.array(LOOP).T]), ArbitrarySwitching(modes=2)).value
    found = stability.decay_rate(SwitchedSystem(A=maps), ArbitrarySwitching(modes=2))
    assert found.value == pytest.approx(plain * float(size), rel=1e-5)


def test_a_jordan_block_decays_as_its_eigenvalue():
    block = 0.99 * np.eye(6) + np.diag(np.ones(5), 1)
    assert stability.decay_rate(SwitchedSystem(A=[block]), ANY).value == pytest.approx(0.99, rel=1e-5)
    assert stability.certify(SwitchedSystem(A=[block]), ANY).value == 1


@pytest.mark.slow
def test_random_systems_in_random_coordinates():
    """A small sample; `python -m benchmarks.theory_coordinates` takes the large one."""
    for case in cases(4, 3):
        done = outcome(case, 0.5)
        assert done.same or done.told, done
        assert abs(done.radius) <= 1e-4


def test_a_rotation_has_a_word_that_does_not_decay():
    rotation = SwitchedSystem(A=[[["3/5", "-4/5"], ["4/5", "3/5"]]])
    with pytest.raises(NotCertifiedError) as caught:
        stability.certify(rotation, ANY)
    assert caught.value.counterexample.document["claim"] == {"kind": "unstable", "value": "1", "word": [1]}
    found = stability.decay_rate(rotation, ANY)
    assert found.at_least == 1
    assert found.value <= 1 + 1e-6


def test_words_come_before_programs():
    """The list of Example 4.1 misses signals, and a mode repeated does not decay: both are told in a moment."""
    language = PersistentDwellTime(2, 1, modes=2)
    graph = WordList(((1, 1, 1), (2, 1)), ((0, 1), (0, 1))).graph()
    with pytest.raises(NotCertifiedError, match="uncovered word: 2 2"):
        loops.check_covers(graph, language)
    large = np.round(np.random.default_rng(0).normal(size=(3, 8, 8)) / 2.5, 3)
    started = time.process_time()
    with pytest.raises(NotCertifiedError) as caught:
        stability.certify(SwitchedSystem(A=large), ArbitrarySwitching(modes=3), representation=Representation(lift=3))
    assert caught.value.counterexample.kind == "unstable"
    assert time.process_time() - started < 5 * slowness()


def test_a_lift_that_is_given_stays():
    pair = next(radius for radius in radii() if radius.name == "Ando and Shih")
    zero = stability.decay_rate(pair.system, pair.language, representation=Representation(lift=0))
    assert zero.value == pytest.approx(2**0.5, rel=1e-4)
    assert zero.at_least == 1
    assert zero.about["lift"] == 0
    free = stability.decay_rate(pair.system, pair.language)
    assert free.about["lift"] == 1
    assert free.value <= 1 + 1e-6
    assert stability.decay_rate(pair.system, pair.language, budget=0.0).about["lift"] == 0


def test_stability_is_certified_at_the_lift_that_proves_it():
    system, language = example("example_4_3"), PersistentDwellTime(1, 1, modes=2)
    assert stability.certify(system, language, budget=60.0).about["lift"] == 2


@pytest.fixture(scope="module")
def documents():
    """A rate and a gain with their bounds from below."""
    graph = LabelledGraph([("a", 1, "b"), ("b", 2, "a"), ("b", 1, "b")], modes=2)
    system = SwitchedSystem(
        A=[[["0.5", "0.4"], ["-0.3", "0.6"]], [["0.8", "0"], ["0.2", "-0.4"]]], E=[[["1"], ["0.5"]]] * 2,
        C=[[["1", "-1"]]] * 2,
    )  # fmt: skip
    made = stability.decay_rate(system, graph), gain.certify(system, graph, budget=2.0)
    return [json.loads(one.text()) for one in made]


def test_a_bolder_bound_from_below_is_refused(documents):
    for document in documents:
        assert verify(document)
        for factor in ("1.01", "2", "-1", "0"):
            changed = copy.deepcopy(document)
            bound = changed["claim"]["at_least"]
            bound["value"] = str(Fraction(bound["value"]) * Fraction(factor))
            with pytest.raises(Refused):
                verify({**changed, "checksum": checker.checksum(changed)})


@pytest.mark.parametrize("word", [[2, 2], [], [3], [1, 2, 2, 1], "1"])
def test_a_bound_needs_a_word_that_may_be_repeated(documents, word):
    for document in documents:
        changed = copy.deepcopy(document)
        changed["claim"]["at_least"]["word"] = word
        with pytest.raises(Refused):
            verify({**changed, "checksum": checker.checksum(changed)})


def test_gains_at_a_point_of_the_circle_against_floats():
    rng = np.random.default_rng(3)
    for letters in (1, 2, 3):
        tangent = Fraction(int(rng.integers(-30, 30)), 10)
        point = np.exp(2j * np.arctan(float(tangent)))
        loops = np.round(rng.normal(size=(letters, 2, 3)) / 2, 2)
        outs = np.round(rng.normal(size=(letters, 1, 3)), 2)
        pushed = np.round(rng.normal(size=(letters, 2)), 2)
        exact = [
            [[[Fraction(str(x)) for x in row] for row in one] for one in pair] for pair in zip(loops, outs, strict=True)
        ]
        out, pushing = checker.response(exact, tangent, [[Fraction(str(x)) for x in row] for row in pushed])
        w = pushed[:, 0] + 1j * pushed[:, 1]
        state, forced = np.eye(2), np.zeros(2, complex)
        for loop, one in zip(loops, w, strict=True):
            state, forced = loop[:, :2] @ state, loop[:, :2] @ forced + loop[:, 2] * one
        x, total = np.linalg.solve(point * np.eye(2) - state, forced), 0.0
        for loop, seen, one in zip(loops, outs, w, strict=True):
            total += abs(seen[0, :2] @ x + seen[0, 2] * one) ** 2
            x = loop[:, :2] @ x + loop[:, 2] * one
        assert float(out) == pytest.approx(total, rel=1e-9)
        assert float(pushing) == pytest.approx(np.sum(np.abs(w) ** 2), rel=1e-12)


def test_a_polytope_does_as_its_vertices_do():
    """Products of matrices from the hull grow no faster than certified for arbitrary switching among the vertices."""
    rng = np.random.default_rng(5)
    vertices = np.round(rng.normal(size=(3, 2, 2)) / 2, 3)
    found = stability.decay_rate(SwitchedSystem(A=vertices), ArbitrarySwitching(modes=3))
    for _ in range(200):
        weights = rng.dirichlet(np.full(3, 0.5), 60)
        product = np.eye(2)
        for one in np.einsum("kv,vij->kij", weights, vertices) / found.value:
            product = one @ product
        assert np.linalg.norm(product, 2) < 5


def test_a_solver_that_fails_is_named(monkeypatch):
    """Never taken for an answer: neither yes nor no is said."""

    def failing(self, weights, what, *, refine=True):
        raise SolverError("InsufficientProgress", what)

    two = ArbitrarySwitching(modes=2)
    system = SwitchedSystem(
        A=[[["0.5", "0.8"], ["0", "0.6"]], [["0.5", "0"], ["0.4", "0.6"]]], E=[[["1"], ["0"]]] * 2, C=[[["1", "0"]]] * 2
    )  # fmt: skip
    monkeypatch.setattr(LmiProblem, "minimize", failing)
    for ask in (stability.certify, gain.certify, reach.certify, stability.decay_rate):
        with pytest.raises(SolverError, match="InsufficientProgress"):
            ask(system, two, representation=Representation(lift=0))


def test_gap_and_budget_are_checked():
    for bad in ({"gap": 0}, {"gap": 2.0}, {"budget": -1.0}):
        with pytest.raises(IllPosedError):
            stability.decay_rate(SwitchedSystem(A=[[["0.5"]]]), ANY, **bad)
