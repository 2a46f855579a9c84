"""Theorems 3.1 and 4.1, decay rates, dwell times, and the proofs against them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from theory import (
    ArbitrarySwitching,
    Asynchronous,
    AverageDwellTime,
    DwellTime,
    Gains,
    IllPosedError,
    LabelledGraph,
    NotCertifiedError,
    PersistentDwellTime,
    Representation,
    SwitchedSystem,
    verify,
)
from theory.switching import stability
from theory.switching.examples import example


def radius(system, word):
    product = np.eye(system.size)
    for mode in word:
        product = system.floats[mode - 1]["A"] @ product
    return float(np.abs(np.linalg.eigvals(product)).max()) ** (1 / len(word))


def test_example_4_3_is_infeasible_at_lift_1_and_feasible_at_2():
    system, language = example("example_4_3"), PersistentDwellTime(1, 1, modes=2)
    with pytest.raises(NotCertifiedError, match="cannot be") as caught:
        stability.certify(system, language, representation=Representation("words", 1))
    proof = caught.value.counterexample
    assert proof.kind == "infeasible"
    assert "no quadratic functions" in verify(proof.document).claim
    assert stability.certify(system, language, representation=Representation("words", 2)).about["inequalities"] == 24


def test_example_4_3_by_the_automaton():
    system, language = example("example_4_3"), PersistentDwellTime(1, 1, modes=2)
    assert stability.certify(system, language, representation=Representation(lift=2)).about["inequalities"] == 8
    certificate = stability.decay_rate(system, language, representation=Representation(lift=4))
    slowest, word = stability.slowest_word(system, language)
    assert certificate.value <= 0.99700
    assert certificate.about["inequalities"] <= 40
    assert 0 <= certificate.value - slowest <= 1e-5
    assert slowest == pytest.approx(radius(system, word))


@pytest.mark.slow
def test_the_smallest_dwell_time_and_why_not_less():
    system = SwitchedSystem([[["0.5", "2"], ["0", "0.5"]], [["0.5", "0"], ["2", "0.5"]]])
    tau, certificate = stability.smallest(lambda tau: stability.certify(system, DwellTime(tau, modes=2)))
    assert tau == 5
    assert certificate.document["problem"]["constraint"] == {"kind": "dwell", "tau": 5}
    with pytest.raises(NotCertifiedError) as caught:
        stability.certify(system, DwellTime(4, modes=2))
    assert caught.value.counterexample is not None
    with pytest.raises(NotCertifiedError, match="up to 3"):
        stability.smallest(lambda tau: stability.certify(system, DwellTime(tau, modes=2)), high=3)


@pytest.mark.slow
def test_every_kind_of_constraint_and_both_representations():
    system = SwitchedSystem([[["0.5", "2"], ["0", "0.5"]], [["0.5", "0"], ["2", "0.5"]]])
    for language in (DwellTime(6, modes=2), PersistentDwellTime(8, 1, modes=2)):
        one = stability.decay_rate(system, language, representation=Representation("words", 1))
        two = stability.decay_rate(system, language, representation=Representation(lift=1))
        slowest, _ = stability.slowest_word(system, language, longest=14)
        assert slowest <= min(one.value, two.value) + 1e-9
        assert two.value < 1
    graph = LabelledGraph([("a", 1, "b"), ("b", 1, "a"), ("b", 2, "b"), ("b", 1, "b")], modes=2)
    assert stability.certify(SwitchedSystem([[["0.9"]], [["0.8"]]]), graph).value == 1
    average = AverageDwellTime(12, 2, modes=2)
    assert stability.certify(system, average).value == 1


def test_an_unstable_word_is_proved():
    system = SwitchedSystem([[["0.6", "0.9"], ["0", "0.6"]], [["0.6", "0"], ["0.9", "0.6"]]])
    with pytest.raises(NotCertifiedError, match="does not hold") as caught:
        stability.certify(system, ArbitrarySwitching(modes=2))
    proof = caught.value.counterexample
    assert proof.kind == "unstable"
    word = proof.document["claim"]["word"]
    assert radius(system, word) >= 1


def test_a_rotation_that_is_unstable_is_proved_too():
    system = SwitchedSystem([[["0.8", "-0.7"], ["0.7", "0.8"]], [["0.5", "0"], ["0", "0.5"]]])
    with pytest.raises(NotCertifiedError) as caught:
        stability.certify(system, DwellTime(2, modes=2))
    assert caught.value.counterexample.kind == "unstable"


matrices = st.lists(
    st.lists(st.lists(st.integers(-9, 9), min_size=2, max_size=2), min_size=2, max_size=2), min_size=2, max_size=2
)


@pytest.mark.slow
@given(matrices, st.integers(1, 3), st.integers(0, 2), st.integers(0, 2))
@settings(max_examples=40, deadline=None)
def test_certified_means_no_periodic_word_is_slower(rows, tau, period, lift):
    """Up to length 12; and what is not certified names a counterexample that verifies, or none."""
    system = SwitchedSystem([[[f"{item}/10" for item in row] for row in mode] for mode in rows])
    language = PersistentDwellTime(tau, period, modes=2)
    if not np.any(rows):
        return
    certificate = stability.decay_rate(system, language, representation=Representation(lift=lift))
    slowest, _ = stability.slowest_word(system, language, longest=12)
    assert slowest <= certificate.value
    against = None
    try:
        stability.certify(system, language, representation=Representation(lift=lift))
    except NotCertifiedError as error:
        against = error
    assert against is not None or slowest < 1
    assert against is None or against.counterexample is None or verify(against.counterexample.document)


def test_what_does_not_belong_together_is_refused():
    one, two = SwitchedSystem([[["0.5"]]]), SwitchedSystem([[["0.5"]], [["0.5"]]])
    with pytest.raises(IllPosedError, match="modes"):
        stability.certify(one, DwellTime(2, modes=2))
    with pytest.raises(IllPosedError, match="gains"):
        stability.certify(two, Asynchronous(2, 1, modes=2))
    with pytest.raises(IllPosedError, match="B"):
        stability.certify(
            two,
            DwellTime(2, modes=2).clocked(1),
            gains=Gains.of_document([{"mode": m, "clock": c, "K": [["0"]]} for m in (1, 2) for c in (0, 1)]),
        )
    with pytest.raises(IllPosedError, match="rate"):
        stability.certify(two, DwellTime(2, modes=2), rate=0)
    with pytest.raises(IllPosedError, match="representation"):
        stability.certify(two, DwellTime(2, modes=2), representation=Representation("pictures"))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"A": [[["1", "2"]]]}, "A of mode 1"),
        ({"A": []}, "A: needs"),
        ({"A": [[["1"]], [["1", "0"], ["0", "1"]]]}, "A of mode 2"),
        ({"A": [[["1"]], [["1"]]], "B": [[["1"]]]}, "a mode without a matrix"),
        ({"A": [[["1"]]], "B": [[["1"], ["2"]]]}, "B of mode 1"),
        ({"A": [[["x"]]]}, "not a finite number"),
        ({"A": [[[float("nan")]]]}, "not a finite number"),
        ({"A": [[["1e12"]]]}, "beyond the limit"),
        ({"A": [[["1"], ["1", "2"]]]}, "different lengths"),
        ({"A": [3]}, "list of rows"),
    ],
)
def test_matrices_that_do_not_fit_are_named(given, message):
    with pytest.raises(IllPosedError, match=message):
        SwitchedSystem(**given)


def test_floats_are_the_decimals_they_print_as():
    system = SwitchedSystem(A=np.array([[[0.39]]]))
    assert system.as_document() == [{"A": [["0.39"]]}]
    assert SwitchedSystem([[["1/3"]]]).as_document() == [{"A": [["1/3"]]}]
    assert SwitchedSystem([[["-0.0050"]]]).as_document() == [{"A": [["-0.005"]]}]
