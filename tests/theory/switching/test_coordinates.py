"""Changes of coordinates: exact inverses, similar maps, Gramians and means that go along."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import linalg

from theory.checker import multiply
from theory.switching import coordinates


@given(st.integers(0, 10_000), st.integers(1, 5))
@settings(max_examples=30, deadline=None)
def test_inverses_are_exact(seed, size):
    rng = np.random.default_rng(seed)
    rows = [
        [Fraction(float(x)) for x in row] for row in rng.normal(size=(size, size)) * 10.0 ** rng.integers(-9, 9, size)
    ]
    product = multiply(rows, coordinates.inverse(rows))
    assert product == [[Fraction(i == j) for j in range(size)] for i in range(size)]


@given(st.integers(0, 10_000), st.floats(0, 6))
@settings(max_examples=20, deadline=None)
def test_maps_are_near_contractions_in_any_coordinates(seed, power):
    """The norm found hardly depends on the coordinates the maps were given in."""
    rng = np.random.default_rng(seed)
    maps = rng.normal(size=(2, 3, 3))
    turn = linalg.qr(rng.normal(size=(3, 3)))[0] @ np.diag(np.geomspace(1, 10**power, 3)) @ rng.normal(size=(3, 3))

    def norm(given):
        exact = [[[Fraction(float(x)) for x in row] for row in one] for one in given]
        found = coordinates.of_maps(exact)
        return max(float(np.linalg.norm(found.loop(one), 2)) for one in exact)

    assert norm(turn @ maps @ np.linalg.inv(turn)) == pytest.approx(norm(maps), rel=0.2)


def test_gramians_solve_their_equation_and_means_lie_between():
    rng = np.random.default_rng(1)
    maps = rng.normal(size=(2, 4, 4)) / 4
    found = coordinates.gramian(maps, np.eye(4))
    expected = np.eye(4) + sum(one @ found @ one.T for one in maps) / 2
    assert found == pytest.approx(expected, rel=1e-9)
    other = np.diag([1.0, 2.0, 3.0, 4.0])
    for share, end in ((0.0, found), (1.0, other)):
        assert coordinates.geometric_mean(found, other, share) == pytest.approx(end, rel=1e-8, abs=1e-9)
    turn = rng.normal(size=(4, 4))
    moved = coordinates.geometric_mean(turn.T @ found @ turn, turn.T @ other @ turn)
    assert moved == pytest.approx(turn.T @ coordinates.geometric_mean(found, other) @ turn, rel=1e-8, abs=1e-9)


def test_matrices_come_back_exactly():
    turn = coordinates.Coordinates(np.array([[3.0, 1e-9], [1e6, 0.1]]))
    (back,) = turn.matrices(np.eye(2)[None])
    one, two = Fraction(3.0), Fraction(1e6)
    assert back[0][0] == one**2 + two**2
    assert back[1][0] == back[0][1] == one * Fraction(1e-9) + two * Fraction(0.1)
