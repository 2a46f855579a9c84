"""The exact engine against enumeration: costs, bounds, ties."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings

from station import Status
from station.geometry import ALL_VALVES, INLETS
from station.valves import commands
from tests.controllers.replay import Replay, enumerate_best
from tests.controllers.states import problem, problems, seeded

FINE = 1e-9  # relative


def random_problems(seed, count, horizon, compressors=1, **options):
    source = seeded(np.random.default_rng(seed))
    return [problem(source, horizon, compressors, **options) for _ in range(count)]


@pytest.mark.parametrize("compressors", [1, 2, 3])
def test_evaluation_agrees_with_plain_python(compressors):
    rng = np.random.default_rng(compressors)
    source = seeded(rng)
    admissible = 0
    for _ in range(400):
        given_problem = problem(source, 2, compressors)
        replay = Replay(given_problem)
        for sequence in rng.choice(commands(compressors), (5, 3)):
            cost = replay.cost(sequence)
            assert given_problem.cost(sequence) == pytest.approx(cost, rel=1e-12)
            admissible += np.isfinite(cost)
    assert 200 < admissible < 1900


def test_evaluation_refuses_every_command_that_excludes_itself():
    (connected,) = [p for p in random_problems(3, 1, 1) if p.observation.vehicle >= 0]
    replay = Replay(connected)
    for command in range(ALL_VALVES + 1):
        assert np.isfinite(connected.cost([command, 0])) == np.isfinite(replay.cost([command, 0]))


@pytest.mark.slow
@pytest.mark.parametrize(("horizon", "compressors", "count"), [(1, 1, 300), (1, 2, 100), (1, 3, 100), (2, 1, 60),
                                                               (2, 2, 5), (2, 3, 5),
                                                               *(pytest.param(*each, marks=pytest.mark.slow) for each in
                                                                 ((2, 2, 20), (2, 3, 20), (3, 1, 4)))])  # fmt: skip
def test_exact_is_the_best_of_all_sequences(horizon, compressors, count):
    for given_problem in random_problems(horizon * 10 + compressors, count, horizon, compressors, node_limit=10**9):
        best, _ = enumerate_best(given_problem.cost, commands(compressors), horizon + 1)
        decision = given_problem.exact()
        assert decision.status == Status.OPTIMAL
        assert decision.cost == pytest.approx(best, rel=FINE)
        assert decision.bound == decision.cost
        rest = product(commands(compressors), repeat=horizon)
        reached = min(given_problem.cost((decision.command, *tail)) for tail in rest)
        assert reached == pytest.approx(best, rel=FINE)


@settings(max_examples=40, deadline=None)
@given(problems(1))
def test_exact_is_the_best_of_all_pairs_by_plain_python(given_problem):
    best, _ = enumerate_best(Replay(given_problem).cost, commands(1), 2)
    assert given_problem.exact().cost == pytest.approx(best, rel=FINE)


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(problems(2, 2, node_limit=10**9))
def test_exact_is_the_best_of_all_triples(given_problem):
    best, _ = enumerate_best(given_problem.cost, commands(2), 3)
    assert given_problem.exact().cost == pytest.approx(best, rel=FINE)


@pytest.mark.parametrize(("horizon", "compressors"), [(2, 1), (2, 3), (3, 1), (4, 1), (5, 2), (6, 1)])
def test_a_search_cut_short_bounds_the_optimum(horizon, compressors):
    cut_short = 0
    for number in range(12):
        searched = [
            random_problems(number, 1, horizon, compressors, node_limit=limit)[0].exact() for limit in (1, 30, 10**9)
        ]
        best = searched[-1]
        assert best.status == Status.OPTIMAL
        for found in searched:
            assert found.bound <= best.cost * (1 + FINE)
            assert found.cost >= best.cost * (1 - FINE)
            assert (found.status == Status.OPTIMAL) == (found.bound >= found.cost)
        cut_short += searched[0].status == Status.FEASIBLE
    assert cut_short


@pytest.mark.slow
def test_the_bound_of_one_node_lies_below_enumeration():
    for given_problem in random_problems(5, 40, 2, node_limit=1):
        best, _ = enumerate_best(given_problem.cost, commands(1), 3)
        assert given_problem.exact().bound <= best * (1 + FINE)


def test_ties_of_minlp2_leave_the_compressor_off():
    compressing = 0
    for given_problem in random_problems(6, 400, 1):
        if given_problem.objective.buffers or given_problem.objective.compressor:
            continue
        decision = given_problem.exact()
        if given_problem.observation.vehicle < 0:
            assert decision.command == 0
        elif decision.command & INLETS:
            compressing += 1
            quiet = [c for c in commands(1) if not c & INLETS]
            best_quiet = min(given_problem.cost(pair) for pair in product(quiet, commands(1)))
            assert best_quiet > decision.cost
    assert compressing
