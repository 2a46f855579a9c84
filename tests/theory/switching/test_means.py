"""What is decided without a program: means over paths prove what they say; products and roots are exact."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.theory import random_graph
from theory import InfeasibleError, NotCertifiedError
from theory.checker import multiply, schur_stable
from theory.switching import lyapunov
from theory.switching.graph import Graph


@pytest.mark.parametrize(("size", "nodes", "norm"), [(8, 60, 1.3), (20, 8, 1.3)])
def test_means_prove_more_than_sums(size, nodes, norm):
    graph, maps = random_graph(nodes, size=size, norm=norm)
    assert lyapunov.over_paths(graph, maps, 1.0) is None
    found = lyapunov.over_means(graph, maps, 1.0)
    for (u, _, v), one in zip(graph.edges, maps, strict=True):
        assert np.linalg.eigvalsh(found[u] - one.T @ found[v] @ one)[0] > 0.99
    assert np.linalg.eigvalsh(found).min() > 0.99


@pytest.mark.parametrize("rate", [0.7, 1.0, 1.2, 1.5, 2.0])
def test_means_prove_a_rate_only_where_a_program_finds_one(rate):
    graph, maps = random_graph(6, size=4, norm=1.5)
    found = lyapunov.over_means(graph, maps, rate)
    try:
        assert lyapunov.largest_margin(graph, maps, rate)[1] > 0
    except (InfeasibleError, NotCertifiedError):
        assert found is None
    if found is not None:
        assert lyapunov.margin_of(graph, maps, found, rate) > 0.99


def test_nilpotent_maps_and_jumps():
    maps = np.array([[[0.0, 9.0], [0.0, 0.0]]])
    found = lyapunov.over_means(Graph(1, ((0, 1, 0),)), maps, 1.0)
    assert found[0] - maps[0].T @ found[0] @ maps[0] == pytest.approx(np.eye(2), abs=1e-6)
    assert lyapunov.over_means(Graph(2, ((0, 1, 1),), ((1, 0),)), maps, 1.0) is None


fractions = st.fractions(-3, 3, max_denominator=50) | st.integers(-3, 3)


@settings(max_examples=40)
@given(st.data(), st.tuples(*[st.integers(1, 4)] * 3))
def test_products_are_those_of_fractions(data, sizes):
    one, two = (
        data.draw(st.lists(st.lists(fractions, min_size=w, max_size=w), min_size=h, max_size=h))
        for h, w in (sizes[:2], sizes[1:])
    )
    assert multiply(one, two) == [
        [sum(x * y for x, y in zip(row, column, strict=True)) for column in zip(*two, strict=True)] for row in one
    ]
    with pytest.raises(ValueError, match="zip"):
        multiply([[*row, Fraction(1)] for row in one], two)


@pytest.mark.parametrize("distance", [1e-3, 1e-8, 1e-12])
def test_stability_is_decided_next_to_the_circle_and_on_it(distance):
    """A rotation by an angle whose sine and cosine are rational, a little shrunk or stretched, or not at all."""
    turn, step = [[Fraction(3, 5), Fraction(-4, 5)], [Fraction(4, 5), Fraction(3, 5)]], Fraction(distance)
    skew = [[Fraction(1), Fraction(7)], [Fraction(0), Fraction(1)]]
    back = [[Fraction(1), Fraction(-7)], [Fraction(0), Fraction(1)]]
    for factor, stable in ((1 - step, True), (1 + step, False), (Fraction(1), False)):
        rows = multiply(multiply(skew, [[factor * x for x in row] for row in turn]), back)
        assert schur_stable(rows) == stable
    assert schur_stable([[Fraction(0), Fraction(5)], [Fraction(0), Fraction(0)]])
    assert not schur_stable([[1]])
