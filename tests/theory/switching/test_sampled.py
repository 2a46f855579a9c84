"""Continuous-time plants sampled: enclosures against other arithmetic, certificates against SciPy's samples."""

from __future__ import annotations

import copy
import json
from decimal import Decimal, getcontext
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import linalg, signal

from tests.theory.refusing import refused
from theory import (
    ArbitrarySwitching,
    DwellTime,
    Gains,
    IllPosedError,
    Refused,
    Representation,
    SampledSystem,
    SwitchedSystem,
    checker,
    gain,
    output_feedback,
    reach,
    stability,
    synthesis,
    verify,
)
from theory.checker import multiply, prove_fractions, schur_stable
from theory.checker.enclosures import UNIT, Enclosure
from theory.checker.sampling import exponential, norm, sampled, wandering

PENDULUM = {
    "A": [[["0", "1"], ["-9.81", "-0.5"]], [["0", "1"], ["-9.81", "-0.9"]]], "B": [[[0], [1]]] * 2,
    "C": [[[1, 0]]] * 2, "E": [[[0], [1]]] * 2,
}  # fmt: skip
FIXED = Representation(lift=0)
HELD = Gains({(mode, 0): [[Fraction(-5), Fraction(-2)]] for mode in (1, 2)})
CLOCKED = ArbitrarySwitching(modes=2).clocked(0)

numbers = st.fractions(-50, 50, max_denominator=1000)
pairs = st.tuples(numbers, numbers, st.fractions(0, 1)).map(lambda two: (min(two[:2]), max(two[:2]), two[2]))


def inside(enclosure, value):
    return Fraction(enclosure.low, UNIT) <= value <= Fraction(enclosure.high, UNIT)


@given(pairs, pairs, numbers)
def test_results_enclose_those_of_every_number_inside(one, two, plain):
    """At both ends and in between; what is not decided for all is refused."""
    a, b = Enclosure.around(*one[:2]), Enclosure.around(*two[:2])
    x, y = (low + share * (high - low) for low, high, share in (one, two))
    for made, exact in (
        (a + b, x + y), (a - b, x - y), (a * b, x * y), (-a, -x), (abs(a), abs(x)), (a**2, x * x),
        (a + plain, x + plain),        (plain - a, plain - x), (plain * a, plain * x), (sum([a, b]), x + y),
    ):  # fmt: skip
        assert inside(made, exact)
    if two[0] * two[1] > 0:
        assert inside(a / b, x / y)
        assert inside(plain / b, plain / y)
    else:
        with pytest.raises(ZeroDivisionError):
            a / b
    try:
        assert (a < b) == (x < y)
        assert (a > plain) == (x > plain)
        assert (plain < a) == (plain < x)
    except Refused:
        assert one[0] <= plain <= one[1] or (one[1] >= two[0] and one[0] <= two[1])


def test_exponentials_are_enclosed_tightly():
    """Against known ones, computed in decimals of 60 digits, and against SciPy."""
    getcontext().prec = 60
    (found,) = exponential([[Fraction(-7, 2)]])
    assert inside(found[0], Fraction(Decimal("-3.5").exp()))
    assert found[0].high - found[0].low < 10**8  # of 10**44
    rows = exponential([[Fraction(0), Fraction(3)], [Fraction(0), Fraction(0)]])
    assert all(inside(rows[i][j], exact) for i, line in enumerate([[1, 3], [0, 1]]) for j, exact in enumerate(line))
    rng = np.random.default_rng(0)
    for _ in range(4):
        given_ = [[Fraction(int(x), 10) for x in row] for row in rng.integers(-30, 30, (4, 4))]
        found, back = exponential(given_), exponential([[-x for x in row] for row in given_])
        expected = linalg.expm(np.array(given_, float))
        assert np.allclose([[float(x.middle) for x in row] for row in found], expected, rtol=1e-10, atol=1e-10)
        one = multiply(found, back)
        assert all(inside(one[i][j], Fraction(i == j)) for i in range(4) for j in range(4))
    with pytest.raises(Refused, match="the exponent has the norm 31"):
        exponential([[Fraction(31)]])


def test_proofs_hold_for_everything_enclosed():
    rng = np.random.default_rng(1)
    for _ in range(60):
        half = rng.integers(-9, 9, (3, 3))
        exact = half @ half.T + int(rng.integers(-20, 20)) * np.eye(3, dtype=int)
        lowest, width = float(np.linalg.eigvalsh(exact)[0]), Fraction(1, 10**20)
        rows = [[Enclosure.around(x - width, x + width) for x in row] for row in exact.tolist()]
        if lowest > 1e-6:
            prove_fractions(rows, "it")
        elif lowest < -1e-6:
            with pytest.raises(Refused):
                prove_fractions(rows, "it")
    wide = [[Enclosure.around(Fraction(-1), Fraction(3))]]
    with pytest.raises(Refused, match="does not decide"):
        prove_fractions(wide, "it")
    with pytest.raises(Refused, match="does not decide"):
        schur_stable([[Enclosure.around(Fraction(9, 10), Fraction(11, 10))]])


def samples(period):
    """The plant's samples by SciPy, in floats."""
    made = {name: [] for name in "ABE"}
    for a, b, e in zip(PENDULUM["A"], PENDULUM["B"], PENDULUM["E"], strict=True):
        both = np.hstack([np.array(b, float), np.array(e, float)])
        sampled_a, sampled_b, *_ = signal.cont2discrete((np.array(a, float), both, np.eye(2), np.zeros((2, 2))), period)
        made["A"].append(sampled_a)
        made["B"].append(sampled_b[:, :1])
        made["E"].append(sampled_b[:, 1:])
    return SwitchedSystem(**made, C=PENDULUM["C"])


@pytest.mark.slow
def test_certificates_are_those_of_the_samples():
    plant, referee = SampledSystem(SwitchedSystem(**PENDULUM), "0.1"), samples(0.1)
    for ask, options in (
        (stability.decay_rate, {}), (gain.certify, {}), (reach.certify, {"alpha": "common"}),
    ):  # fmt: skip
        found = ask(plant, CLOCKED, gains=HELD, representation=FIXED, **options)
        expected = ask(referee, CLOCKED, gains=HELD, representation=FIXED, **options)
        assert found.value == pytest.approx(expected.value, rel=1e-5)
        assert found.at_least == pytest.approx(expected.at_least, rel=1e-5)
        assert found.document["problem"]["modes"][0]["A"] == [["0", "1"], ["-9.81", "-0.5"]]
        assert " at samples 0.1 apart; in between x moves by at most " in verify(json.loads(found.text())).claim


@pytest.mark.slow
def test_gains_and_observers_are_found_for_samples():
    plant = SampledSystem(SwitchedSystem(**PENDULUM, M=[[[1, 0]]] * 2), "0.1")
    whole = SampledSystem(SwitchedSystem(**PENDULUM), "0.1")
    language = DwellTime(3, modes=2)
    known = synthesis.minimize_gain(whole, language).certificate
    measured = output_feedback.minimize_gain(plant, language).certificate
    assert known.value < measured.value
    assert {document["problem"]["period"] for document in (known.document, measured.document)} == {"0.1"}


@pytest.mark.slow
def test_between_samples_the_state_stays_as_near_as_is_said():
    plant, period = SampledSystem(SwitchedSystem(**PENDULUM), "0.1"), 0.1
    claim = gain.certify(plant, CLOCKED, gains=HELD, representation=FIXED).verdict.claim
    words = claim.split("moves by at most ")[1].split(";")[0].split()
    by_state, by_noise = float(words[0]), float(words[3])
    rng, most = np.random.default_rng(0), 0.0
    for _ in range(40):
        mode, x, w = int(rng.integers(2)), rng.normal(size=2), rng.normal(size=1) * rng.choice([0, 1, 10])
        a, b, e = (np.array(PENDULUM[name][mode], float) for name in "ABE")
        held = b @ np.array([[-5.0, -2.0]]) @ x + e @ w
        for time in np.linspace(0, period, 11):
            top = linalg.expm(np.block([[a, held[:, None]], [np.zeros((1, 3))]]) * time)
            moved = np.linalg.norm(top[:2, :2] @ x + top[:2, 2] - x)
            bound = by_state * np.linalg.norm(x) + by_noise * np.linalg.norm(w)
            most = max(most, moved / bound)
            assert moved <= bound
    assert most > 0.3  # not a bound of something else


def test_bounds_of_what_moves_in_between():
    rows = [[Fraction(3), Fraction(-4)], [Fraction(1), Fraction(0)]]
    assert np.linalg.norm(np.array(rows, float), 2) <= norm(rows) == 7
    for size in (Fraction(1, 100), Fraction(1), Fraction(20)):
        far = wandering([{"A": [[size * 2]]}], Fraction(1, 2))
        assert float(far) == pytest.approx(np.expm1(float(size)) / float(size) / 2, rel=1e-12)
    assert wandering([{"A": [[Fraction(0)]]}], Fraction(1, 2)) == Fraction(1, 2)


def lowest(document):
    """The smallest eigenvalue of the inequalities of a gain, with SciPy's exponentials: an independent look."""
    problem, proof, found = document["problem"], document["proof"], []
    period, value = float(Fraction(problem["period"])), float(Fraction(document["claim"]["value"]))
    shapes = []
    for a, b, c in proof["matrices"]:
        shapes.append(np.array([[a, b], [b, c]]) / proof["denominator"])
    for u, label, v in proof["edges"]:
        mode = {name: np.array([[float(Fraction(x)) for x in row] for row in rows])
                for name, rows in problem["modes"][label[0] - 1].items()}  # fmt: skip
        k = np.array([[float(Fraction(x)) for x in row] for row in problem["gains"][label[0] - 1]["K"]])
        top = linalg.expm(np.block([[mode["A"], mode["B"], mode["E"]], [np.zeros((2, 4))]]) * period)[:2]
        loop, out = np.hstack([top[:, :2] + top[:, 2:3] @ k, top[:, 3:]]), np.hstack([mode["C"], mode["F"]])
        here = np.zeros((3, 3))
        here[:2, :2], here[2, 2] = shapes[u], value**2
        found.append(np.linalg.eigvalsh(here - loop.T @ shapes[v] @ loop - out.T @ out)[0])
    return min(found + [np.linalg.eigvalsh(one)[0] for one in shapes])


@pytest.mark.slow
def test_every_mutation_is_refused_or_true():
    plant = SampledSystem(SwitchedSystem(**PENDULUM), "0.1")
    document = json.loads(gain.certify(plant, CLOCKED, gains=HELD, representation=FIXED).text())
    del document["claim"]["at_least"]
    rng, outcomes = np.random.default_rng(0), []
    assert not refused(document)
    for number in range(60):
        changed = copy.deepcopy(document)
        problem = changed["problem"]
        match number % 4:
            case 0:
                rows = problem["modes"][rng.integers(2)][rng.choice(["A", "B", "C", "E"])]
            case 1:
                rows = problem["gains"][rng.integers(2)]["K"]
            case 2:
                problem["period"] = str(Fraction(problem["period"]) + Fraction(int(rng.normal() * 100), 10**6))
                rows = [["0"]]
            case _:
                changed["proof"]["matrices"][0][rng.integers(3)] += int(rng.normal() * 10.0 ** rng.integers(1, 9))
                rows = [["0"]]
        row, column = rng.integers(len(rows)), rng.integers(len(rows[0]))
        rows[row][column] = str(
            Fraction(rows[row][column]) + Fraction(int(rng.normal() * 100), 10 ** int(rng.integers(3, 9)))
        )
        margin = lowest(changed)
        if abs(margin) > 1e-11:
            assert refused(changed) == (margin < 0)
            outcomes.append(margin < 0)
    assert 10 < sum(outcomes) < len(outcomes) - 10
    for period in ("0", "-0.1", "1e3", "100", None, [1]):
        assert refused({**document, "problem": {**document["problem"], "period": period}})
    with_parameters = {**document["problem"], "parameters": [{"low": "0", "high": "1"}]}
    assert refused({**document, "problem": with_parameters})


def test_the_work_of_exponentials_is_foreseen():
    rng = np.random.default_rng(0)
    maps = np.round(rng.normal(size=(20, 20)) - 6 * np.eye(20), 2)
    modes = [{"A": [[str(x) for x in row] for row in maps.tolist()]}] * 50
    problem = {"modes": modes, "constraint": {"kind": "arbitrary"}, "period": "0.1"}
    proof = {"nodes": 1, "edges": [], "jumps": [], "denominator": 1, "matrices": []}
    made = {"format": checker.FORMAT, "version": checker.VERSION, "problem": problem, "proof": proof,
            "claim": {"kind": "stability", "value": "1"}, "about": {}}  # fmt: skip
    with pytest.raises(checker.OverLimit, match="an estimated"):
        verify({**made, "checksum": checker.checksum(made)}, seconds=60)


def test_what_does_not_fit_is_named():
    plant = SwitchedSystem(A=[[[-400]]])
    with pytest.raises(IllPosedError, match="the exponent has the norm 40"):
        SampledSystem(plant, "0.1")
    for wrong in (0, -1, "x"):
        with pytest.raises(IllPosedError, match="period"):
            SampledSystem(plant, wrong)
    made = sampled({"A": [[Fraction(-4)]], "C": [[Fraction(2)]]}, Fraction(1, 10))
    assert made["C"] == [[2]]
    assert float(made["A"][0][0].middle) == pytest.approx(np.exp(-0.4))
