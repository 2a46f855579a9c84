"""The mean square of Markov jump systems: against the moments themselves, and every mutation refused or true."""

from __future__ import annotations

import copy
import json
from fractions import Fraction

import numpy as np
import pytest

from tests.theory.refusing import refused
from theory import IllPosedError, SwitchedSystem, verify
from theory.switching import markov

CHAIN = [["0.9", "0.1"], ["1/3", "2/3"]]


def followed(system, chain, steps=4000):
    """The root of the growth of the sum of traces of the moments, followed step by step."""
    moments = [np.eye(system.size) for _ in range(system.modes)]
    chance, logarithm = np.array([[float(Fraction(str(item))) for item in row] for row in chain]), 0.0
    for step in range(steps):
        after = [mode["A"] @ one @ mode["A"].T for mode, one in zip(system.floats, moments, strict=True)]
        moments = [sum(chance[i, j] * after[i] for i in range(system.modes)) for j in range(system.modes)]
        total = sum(np.trace(one) for one in moments)
        moments = [one / total for one in moments]
        logarithm += np.log(total) * (step >= steps // 2)
    return float(np.exp(logarithm / (steps - steps // 2) / 2))


def sheared(size, rng, largest):
    """An integer matrix of determinant 1 and its inverse, both exact: products of shears by up to `largest`."""
    there, back = np.eye(size, dtype=int).astype(object), np.eye(size, dtype=int).astype(object)
    for row, column in [(i, j) for i in range(size) for j in range(size) if i != j]:
        by = int(rng.integers(1, largest + 1))
        there[row] += by * there[column]
        back[:, column] -= by * back[:, row]
    return there, back


@pytest.mark.parametrize(("size", "modes", "largest"), [(1, 1, 1), (2, 2, 1), (3, 3, 5), (4, 2, 8)])
def test_both_bounds_are_next_to_the_moments_own_decay(size, modes, largest):
    rng = np.random.default_rng(size)
    turn, back = sheared(size, rng, largest)
    maps = np.round(rng.normal(size=(modes, size, size)) / size**0.5, 3)
    exact = [turn @ np.vectorize(lambda item: Fraction(str(item)), otypes=[object])(one) @ back for one in maps]
    counts = rng.integers(1, 9, (modes, modes))
    chain = [[f"{item}/{sum(row)}" for item in row] for row in counts.tolist()]
    system = SwitchedSystem(A=[[[str(item) for item in row] for row in one] for one in exact])
    found = markov.decay_rate(system, chain)
    rate = followed(SwitchedSystem(A=maps), chain)
    assert found.at_least <= rate * (1 + 1e-8)
    assert rate * (1 - 1e-8) <= found.value
    assert found.value / found.at_least - 1 <= 2e-6
    assert markov.spectral_radius(system, chain) == pytest.approx(rate, rel=1e-6)
    assert verify(json.loads(found.text()))


def test_a_mode_that_is_unstable_may_be_visited():
    system = SwitchedSystem(A=[[["0.5"]], [["1.2"]]])
    found = markov.decay_rate(system, CHAIN)
    assert found.value < 1.2
    both = np.array([[0.9 * 0.25, 1 / 3 * 1.44], [0.1 * 0.25, 2 / 3 * 1.44]])
    assert found.value == pytest.approx(np.abs(np.linalg.eigvals(both)).max() ** 0.5, rel=1e-6)


def test_every_mutation_is_refused_or_true():
    system = SwitchedSystem(A=[[["0.5", "0.3"], ["0", "0.6"]], [["0.9", "0"], ["-0.4", "0.8"]]])
    document = json.loads(markov.decay_rate(system, CHAIN).text())
    rng, outcomes = np.random.default_rng(0), []

    for factor, bad in (("0.99", True), ("1.01", False)):
        changed = copy.deepcopy(document)
        changed["claim"]["value"] = str(Fraction(changed["claim"]["value"]) * Fraction(factor))
        assert refused(changed) == bad
        changed = copy.deepcopy(document)
        bound = changed["claim"]["at_least"]
        bound["value"] = str(Fraction(bound["value"]) / Fraction(factor))
        assert refused(changed) == bad
    for name in ("matrices", "moments"):
        for _ in range(60):
            changed = copy.deepcopy(document)
            rows = changed["proof"][name]
            rows[rng.integers(len(rows))][rng.integers(3)] += int(rng.normal() * 10.0 ** rng.integers(1, 9))
            outcomes.append(refused(changed))  # what is accepted claims the same, which is true
    assert 0 < sum(outcomes) < len(outcomes)
    for chain in ([["0.9", "0.2"], ["1/3", "2/3"]], [["0.9", "0.1"]], [["1.1", "-0.1"], ["1/3", "2/3"]], []):
        changed = copy.deepcopy(document)
        changed["problem"]["chain"] = chain
        assert refused(changed)


@pytest.mark.parametrize("chain", [None, [["1"]], [["0.5", "0.4"], ["0", "1"]], [["2", "-1"], ["0", "1"]], "x"])
def test_rows_that_are_no_probabilities_are_named(chain):
    with pytest.raises(IllPosedError, match="chain"):
        markov.decay_rate(SwitchedSystem(A=[[["0.5"]], [["0.4"]]]), chain)
