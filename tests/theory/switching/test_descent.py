"""Rates by descent: as small as halving an interval finds them, proved by their matrices, and certified."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.theory import random_graph
from theory import ArbitrarySwitching, DwellTime, Representation, SwitchedSystem, verify
from theory.switching import lyapunov, stability
from theory.switching.descent import descended
from theory.switching.graph import Graph


def modes(size, count, seed):
    return np.round(np.random.default_rng(seed).normal(size=(count, size, size)) / np.sqrt(size), 4)


@pytest.mark.parametrize(("size", "seed"), [(3, 1), (5, 2), (8, 3)])
def test_matrices_prove_the_rate_and_none_proves_a_smaller_one(size, seed):
    maps = modes(size, 2, seed)
    graph = Graph(1, ((0, 1, 0), (0, 2, 0)))
    rate, found = descended(graph, maps, 1e-7)
    assert lyapunov.margin_of(graph, maps / (rate * (1 + 1e-9)), found, 1.0) > 0
    assert lyapunov.largest_margin(graph, maps / (rate * (1 + 1e-5)), 1.0)[1] > 0
    assert not lyapunov.decides(graph, maps, rate * (1 - 1e-5))[0]


def test_a_single_map_ends_at_its_spectral_radius():
    maps = modes(6, 1, 4)
    rate, _ = descended(Graph(1, ((0, 1, 0),)), maps, 1e-7)
    assert rate == pytest.approx(np.abs(np.linalg.eigvals(maps[0])).max(), rel=1e-6)


@pytest.mark.parametrize("maps", [np.zeros((2, 4, 4)), np.triu(modes(6, 2, 5), 1)])
def test_no_limit_is_named_where_there_is_none(maps):
    assert descended(Graph(1, ((0, 1, 0), (0, 2, 0))), maps, 1e-7) is None


def test_small_graphs_jumps_and_parts_do_not_descend():
    ring = Graph(8, tuple((u, 1, (u + 1 + turn) % 8) for u in range(8) for turn in (0, 2)))
    assert lyapunov.descends(ring, np.ones((16, 12, 12)))
    assert not lyapunov.descends(ring, np.ones((16, 2, 2)))
    assert not lyapunov.descends(Graph(8, ring.edges, ((0, 1),)), np.ones((16, 12, 12)))
    assert not lyapunov.descends(Graph(9, (*ring.edges, (8, 1, 0))), np.ones((17, 12, 12)))
    graph, maps = random_graph(24, size=12)
    assert not lyapunov.descends(graph, maps)


@pytest.mark.parametrize(
    ("size", "language", "lift"),
    [(10, ArbitrarySwitching(modes=2), 0), (8, DwellTime(2, modes=2), 1)],
)
def test_the_rate_certified_is_that_of_halving(size, language, lift, monkeypatch):
    system = SwitchedSystem(modes(size, 2, size))
    ours = stability.decay_rate(system, language, representation=Representation(lift=lift))
    assert verify(ours.document).claim.startswith("for every admissible signal")
    monkeypatch.setattr(stability, "descends", lambda *_: False)
    other = stability.decay_rate(system, language, representation=Representation(lift=lift))
    assert ours.value == pytest.approx(other.value, rel=5e-7)
