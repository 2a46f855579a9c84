"""Parameters within bounds and rates: the referee's corners and optima, courses of them, mutations refused or true."""

from __future__ import annotations

import copy
import itertools
import json
from fractions import Fraction

import numpy as np
import pytest
from scipy.spatial import HalfspaceIntersection

from tests.theory.refusing import refused
from theory import (
    ArbitrarySwitching,
    DwellTime,
    Gains,
    IllPosedError,
    NotCertifiedError,
    Parameter,
    Representation,
    SwitchedSystem,
    VaryingSystem,
    checker,
    stability,
    varying,
    verify,
)

cp = pytest.importorskip("cvxpy")

ONE = ArbitrarySwitching(modes=1)
FIXED = Representation(lift=0)


def oscillator(rate):
    """Its damping varies; at will it can be shaken up, slowly it cannot."""
    mode = {"A": [[0, 1], ["-0.8", 0]], "vary": [{"A": [[0, 0], [0, "0.5"]]}]}
    return VaryingSystem([mode], [Parameter.of(-1, 1, rate)])


def random_plant(seed, modes=2, count=1, rate="0.3"):
    rng = np.random.default_rng(seed)

    def small(*shape):
        return np.round(rng.normal(size=shape), 2)

    made = [
        {
            "A": 0.35 * small(2, 2), "C": small(1, 2), "E": small(2, 1), "F": 0.2 * small(1, 1),
            "vary": [{"A": 0.2 * small(2, 2), "C": 0.1 * small(1, 2), "E": 0.2 * small(2, 1)} for _ in range(count)],
        }
        for _ in range(modes)
    ]  # fmt: skip
    return VaryingSystem(made, [Parameter.of("-0.5", "1", rate)] * count)


def referee_corners(low, high, step):
    """The corners of {(p, q): both within bounds, |p - q| <= step}, by Qhull."""
    rows = [[1, 0, -high], [-1, 0, low], [0, 1, -high], [0, -1, low], [1, -1, -step], [-1, 1, -step]]
    middle = (low + high) / 2
    return np.unique(
        np.round(HalfspaceIntersection(np.array(rows, float), np.array([middle, middle])).intersections, 9), axis=0
    )


@pytest.mark.parametrize(("low", "high", "step"), [(-1, 2, 0.25), (0, 1, 1), (0, 1, 0.5), (-3, -1, 1.9), (0, 1, 0.75)])
def test_the_corners_of_a_parameter_and_its_successor(low, high, step):
    every = checker.parameters.ranges({"parameters": [{"low": str(low), "high": str(high), "rate": str(step)}]})
    found = sorted({(float(p[0]), float(q[0])) for p, q in checker.parameters.corners(every)})
    assert np.allclose(found, sorted(map(tuple, referee_corners(low, high, step))))
    two = checker.parameters.corners(every * 2)
    assert len(two) == len(found) ** 2
    assert {(pair[0][0], pair[1][0]) for pair in two} == {(p[0], q[0]) for p, q in checker.parameters.corners(every)}


def referee(system, graph, rate=None):
    """The least gamma on a graph or, for a rate, the largest margin with matrices below I, by CVXPY."""
    (low, high, step), n, q = [float(x) for x in system.ranges[0]], system.base.size, 1
    shape = [[cp.Variable((n, n), symmetric=True) for _ in range(2)] for _ in range(graph.nodes)]
    slack, last = [cp.Variable((n, n)) for _ in graph.edges], cp.Variable()

    def at(u, p):
        return shape[u][0] + p * shape[u][1]

    blocks, limits = [at(u, p) for u in range(graph.nodes) for p in (low, high)], []
    for (u, label, v), x in zip(graph.edges, slack, strict=True):
        for p, then in referee_corners(low, high, step):
            mode = system.at([Fraction(str(round(p, 9)))]).floats[label - 1]
            a, c, e, f = (mode[name] for name in "ACEF")
            here, ahead = at(u, p), x + x.T - at(v, then)
            if rate is not None:
                blocks.append(cp.bmat([[rate**2 * here, a.T @ x.T], [x @ a, ahead]]))
                continue
            blocks.append(
                cp.bmat(
                    [
                        [here, np.zeros((n, q)), a.T @ x.T, c.T],
                        [np.zeros((q, n)), last * np.eye(q), e.T @ x.T, f.T],
                        [x @ a, x @ e, ahead, np.zeros((n, 1))],
                        [c, f, np.zeros((1, n)), np.eye(1)],
                    ]
                )
            )
    if rate is not None:
        limits = [np.eye(n) - at(u, p) >> 0 for u in range(graph.nodes) for p in (low, high)]
        limits += [cp.norm(x) <= 10 for x in slack]
    limits += [one - (0 if rate is None else last * np.eye(one.shape[0])) >> 0 for one in blocks]
    problem = cp.Problem(cp.Minimize(last) if rate is None else cp.Maximize(last), limits)
    problem.solve(solver=cp.CLARABEL)
    assert problem.status == "optimal"
    return float(np.sqrt(last.value)) if rate is None else float(last.value)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 6])
def test_gain_and_rate_are_the_referees(seed):
    system, language = random_plant(seed), DwellTime(2, modes=2)
    graph = language.graph(0)
    found = varying.gain(system, language, representation=FIXED)
    assert found.value == pytest.approx(referee(system, graph), rel=1e-4)
    assert 0 < found.at_least <= found.value
    rate = varying.decay_rate(system, language, representation=FIXED)
    assert referee(system, graph, rate.value * 1.001) > 1e-6
    assert referee(system, graph, rate.value * 0.999) < 1e-6
    assert rate.at_least <= rate.value


def test_slow_parameters_decay_where_fast_ones_do_not():
    values = [varying.decay_rate(oscillator(rate), ONE).value for rate in (0, "0.02", "0.5", None)]
    assert values == sorted(values)
    assert values[1] < 1 < values[-1]
    with pytest.raises(NotCertifiedError, match="this lift; a larger one may do"):
        varying.certify(oscillator(None), ONE)
    assert varying.certify(oscillator("0.02"), ONE).value == 1


def test_at_will_it_is_switching_among_the_corners():
    ends = SwitchedSystem(A=[[[0, 1], ["-0.8", x]] for x in ("-0.5", "0.5")])
    switched = stability.decay_rate(ends, ArbitrarySwitching(modes=2))
    at_will = varying.decay_rate(oscillator(None), ONE)
    assert at_will.at_least == pytest.approx(switched.at_least, rel=1e-6)
    assert at_will.value == pytest.approx(switched.value, rel=2e-6)


@pytest.mark.parametrize("rate", ["0.02", "0.5"])
def test_courses_stay_within_the_rate(rate):
    """Random courses, and those that push each sample to where the state grows most."""
    found, step, rng = varying.decay_rate(oscillator(rate), ONE), float(rate), np.random.default_rng(0)
    for greedy in [True, *[False] * 10]:
        x, p, logarithm = rng.normal(size=2), float(rng.uniform(-1, 1)), 0.0
        for _ in range(400):
            x = np.array([[0, 1], [-0.8, 0.5 * p]]) @ x
            size = np.linalg.norm(x)
            logarithm, x = logarithm + np.log(size), x / size
            ways = np.clip([p - step, p + step], -1, 1)
            ahead = [np.linalg.norm(np.array([[0, 1], [-0.8, 0.5 * q]]) @ x) for q in ways]
            p = float(ways[int(np.argmax(ahead))] if greedy else rng.uniform(*ways))
        assert np.exp(logarithm / 400) < found.value * 1.01


@pytest.mark.slow
def test_gains_and_controllers_act_on_a_plant_with_parameters():
    mode = {"A": [["1.05"]], "B": [[1]], "C": [[1]], "E": [[1, 0]], "M": [[1]], "N": [[0, "0.1"]],
            "vary": [{"A": [["0.05"]], "B": [["0.1"]]}]}  # fmt: skip
    system = VaryingSystem([mode], [Parameter.of(-1, 1, "0.1")])
    language, given = ONE.clocked(0), {"mode": 1, "clock": 0}
    static = varying.gain(system, language, gains=Gains.of_document([{**given, "K": [["-0.6"]]}]))
    parts = {"A": [["0.1"]], "B": [["0.1"]], "C": [["-0.2"]], "D": [["-0.6"]]}
    dynamic = varying.gain(system, language, gains=Gains.of_document([{**given, **parts}]))
    for found, states in ((static, 0), (dynamic, 1)):
        assert found.at_least <= found.value < 1.05 * found.at_least
        assert verify(json.loads(found.text())).inequalities == 8
        assert found.matrices.shape == (2, 1 + states, 1 + states)


def lowest(document):
    """The smallest eigenvalue at all corners, by NumPy and Qhull from the document: an independent look."""
    problem, proof = document["problem"], document["proof"]
    (entry,) = problem["parameters"]
    low, high = (float(Fraction(entry[name])) for name in ("low", "high"))
    step = min(float(Fraction(entry["rate"])), high - low)
    n, unit, value = 2, proof["denominator"], float(Fraction(document["claim"]["value"]))
    mode = {name: np.array([[float(Fraction(x)) for x in row] for row in rows])
            for name, rows in problem["modes"][0].items() if name != "vary"}  # fmt: skip
    change = {name: np.array([[float(Fraction(x)) for x in row] for row in rows])
              for name, rows in problem["modes"][0]["vary"][0].items()}  # fmt: skip
    shapes = []
    for triangle in proof["matrices"]:
        rows = np.zeros((n, n))
        rows[np.triu_indices(n)] = [item / unit for item in triangle]
        shapes.append(rows + rows.T - np.diag(np.diag(rows)))

    def at(p):
        return shapes[0] + (p - low) / (high - low) * shapes[1]

    slack = np.array(proof["slacks"][0]).reshape(n, n) / unit
    found = [np.linalg.eigvalsh(at(p))[0] for p in (low, high)]
    for p, then in referee_corners(low, high, step):
        a = mode["A"] + p * change["A"]
        rows = np.block([[value**2 * at(p), a.T @ slack.T], [slack @ a, slack + slack.T - at(then)]])
        found.append(np.linalg.eigvalsh(rows)[0])
    return min(found)


def test_every_mutation_is_refused_or_true():
    document = json.loads(varying.certify(oscillator("0.02"), ONE, rate="0.95").text())
    rng, outcomes = np.random.default_rng(0), []
    assert not refused(document)

    def judged(changed):
        margin = lowest(changed)
        if abs(margin) > 1e-10:
            assert refused(changed) == (margin < 0)
            outcomes.append(margin < 0)

    for name, count in (("matrices", 3), ("slacks", 4)):
        for _ in range(40):
            changed = copy.deepcopy(document)
            rows = changed["proof"][name]
            rows[rng.integers(len(rows))][rng.integers(count)] += int(rng.normal() * 10.0 ** rng.integers(0, 6))
            judged(changed)
    for name, _ in itertools.product(("low", "high", "rate"), range(20)):
        changed = copy.deepcopy(document)
        entry = changed["problem"]["parameters"][0]
        entry[name] = str(Fraction(entry[name]) + Fraction(int(rng.normal() * 50), 1000))
        if Fraction(entry["low"]) < Fraction(entry["high"]) and Fraction(entry["rate"]) > 0:
            judged(changed)
    for _ in range(40):
        changed = copy.deepcopy(document)
        rows = rng.choice([changed["problem"]["modes"][0], changed["problem"]["modes"][0]["vary"][0]])["A"]
        i, j = rng.integers(2, size=2)
        rows[i][j] = str(Fraction(rows[i][j]) + Fraction(int(rng.normal() * 100), 10 ** int(rng.integers(3, 6))))
        judged(changed)
    for value in ("0.93", "0.94", "0.949", "0.951"):
        judged({**document, "claim": {**document["claim"], "value": value}})
    assert 30 < sum(outcomes) < len(outcomes) - 30


def test_bounds_from_below_are_courses_that_parameters_may_take():
    document = json.loads(varying.decay_rate(oscillator("0.5"), ONE).text())
    bound = document["claim"]["at_least"]
    assert not refused(document)
    for change in (
        {"value": str(Fraction(bound["value"]) * Fraction("1.001"))},
        {"path": [["1.1"]] * len(bound["word"])},
        {"path": [["-1"], ["1"]] * (len(bound["word"]) // 2)},
        {"path": bound["path"][1:]},
        {"path": [[]] * len(bound["word"])},
    ):
        assert refused({**document, "claim": {**document["claim"], "at_least": {**bound, **change}}})


def test_what_a_document_must_not_leave_unproved():
    document = json.loads(varying.certify(oscillator("0.02"), ONE).text())
    edges = document["proof"]["edges"]
    for change in (
        {"jumps": edges, "edges": [], "slacks": []},  # a letter among the jumps
        {"slacks": []}, {"slacks": document["proof"]["slacks"] * 2}, {"slacks": [[0.5] * 4]}, {"edges": []},
        {"matrices": document["proof"]["matrices"][:1]},
    ):  # fmt: skip
        assert refused({**document, "proof": {**document["proof"], **change}})
    problem = document["problem"]
    mode, (entry,) = problem["modes"][0], problem["parameters"]
    for change in (
        {"parameters": []}, {"parameters": [entry, entry]}, {"parameters": [{**entry, "rate": "-1"}]},
        {"parameters": [{**entry, "low": "1"}]}, {"parameters": [{**entry, "more": "1"}]}, {"parameters": [entry] * 5},
        {"modes": [{**mode, "vary": []}]}, {"modes": [{**mode, "M": [["1", "0"]], "vary": [{"M": [["1", "0"]]}]}]},
    ):  # fmt: skip
        assert refused({**document, "problem": {**problem, **change}})
    assert refused({**document, "claim": {"kind": "unstable", "value": "0.1", "word": [1]}})


def test_what_does_not_fit_is_named():
    mode = {"A": [["0.5"]], "vary": [{"A": [["0.1"]]}]}
    for modes, varied, says in (
        ([mode], [Parameter.of(0, 1)] * 2, "vary: of mode 1 has 1 tables"),
        ([mode], [], "parameters: 0, within"),
        ([{**mode, "vary": [{"A": [[1, 2]]}]}], [Parameter.of(0, 1)], "vary.A: of mode 1 has another size"),
        ([{**mode, "vary": [{"E": [[1]]}]}], [Parameter.of(0, 1)], "vary.E: changes no matrix"),
    ):
        with pytest.raises(IllPosedError, match=says):
            VaryingSystem(modes, varied)
    with pytest.raises(IllPosedError, match="low = 1 has to be below"):
        Parameter.of(1, 1)
    with pytest.raises(IllPosedError, match="has to be at least 0"):
        Parameter.of(0, 1, -1)
    with pytest.raises(IllPosedError, match="C: an l2 gain needs"):
        varying.gain(VaryingSystem([mode], [Parameter.of(0, 1)]), ONE)
