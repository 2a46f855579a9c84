"""Output feedback: loops closed by hand, inequalities and optima of CVXPY, mutations, and runs beside the plant."""

from __future__ import annotations

import copy
import json
from fractions import Fraction

import numpy as np
import pytest

from tests.theory.refusing import refused
from theory import (
    ArbitrarySwitching,
    Asynchronous,
    DwellTime,
    Gains,
    IllPosedError,
    NotCertifiedError,
    Representation,
    SwitchedSystem,
    output_feedback,
    verify,
)
from theory.switching import gain, reach, stability, synthesis
from theory.switching.system import closed_by

cp = pytest.importorskip("cvxpy")

READ = SwitchedSystem(
    A=[[["1.1", "0.3"], ["0", "0.9"]], [["0.8", "-0.4"], ["0.3", "1.05"]]], B=[[[0], [1]], [[1], ["0.5"]]],
    C=[[[1, 0], [0, 0]]] * 2, D=[[[0], ["0.1"]]] * 2, E=[[["0.1", 0], ["0.2", 0]]] * 2,
    M=[[[1, 0]], [[1, 1]]], N=[[[0, "0.1"]]] * 2,
)  # fmt: skip
"""Two modes with one reading, which has an error."""

FIXED = Representation(lift=0)


def rounded(rng, *shape):
    return np.round(rng.normal(size=shape), 3)


def random_loop(seed, n=2, c=2, modes=2):
    """A random plant with small loops, and controllers of it with `c` states (static ones with none)."""
    rng = np.random.default_rng(seed)
    plant = SwitchedSystem(
        A=0.25 * rounded(rng, modes, n, n), B=0.3 * rounded(rng, modes, n, 1), C=rounded(rng, modes, 2, n),
        D=rounded(rng, modes, 2, 1), E=rounded(rng, modes, n, 2), F=0.3 * rounded(rng, modes, 2, 2),
        M=rounded(rng, modes, 1, n), N=0.5 * rounded(rng, modes, 1, 2),
    )  # fmt: skip
    parts = [
        {"A": 0.25 * rounded(rng, c, c), "B": 0.5 * rounded(rng, c, 1), "C": 0.5 * rounded(rng, 1, c)}
        for _ in range(modes)
    ]
    direct = [{"D" if c else "K": 0.3 * rounded(rng, 1, 1)} for _ in range(modes)]
    given = [
        {"mode": mode, "clock": 0, **(part if c else {}), **last}
        for mode, (part, last) in enumerate(zip(parts, direct, strict=True), 1)
    ]
    return plant, Gains.of_document(given), given


def by_hand(mode, controller):
    """[G, E, H, F] of plant and controller, from their equations, in floats or objects."""
    a, b, e, m, noise = (np.asarray(mode[name]) for name in "ABEMN")
    c, d, f = (np.asarray(mode[name]) for name in "CDF")
    if "K" in controller:
        k = np.asarray(controller["K"])
        return a + b @ k @ m, e + b @ k @ noise, c + d @ k @ m, f + d @ k @ noise
    own, into, out, through = (np.asarray(controller[name]) for name in "ABCD")
    loop = np.vstack([np.hstack([a + b @ through @ m, b @ out]), np.hstack([into @ m, own])])
    drive = np.vstack([e + b @ through @ noise, into @ noise])
    return loop, drive, np.hstack([c + d @ through @ m, d @ out]), f + d @ through @ noise


def referee_gain(pieces, edges, nodes):
    """The smallest gamma on a graph, by CVXPY from Theorem 3.2 and the loops closed by hand."""
    size = len(pieces[edges[0][1]][0])
    unknown = [cp.Variable((size, size), symmetric=True) for _ in range(nodes)]
    square = cp.Variable()
    limits = [item >> 0 for item in unknown]
    for u, label, v in edges:
        a, e, c, f = pieces[label]
        loop, out, q = np.hstack([a, e]), np.hstack([c, f]), e.shape[1]
        here = cp.bmat([[unknown[u], np.zeros((size, q))], [np.zeros((q, size)), square * np.eye(q)]])
        limits.append(here - loop.T @ unknown[v] @ loop - out.T @ out >> 0)
    problem = cp.Problem(cp.Minimize(square), limits)
    problem.solve(solver=cp.CLARABEL)
    assert problem.status == "optimal"
    return float(np.sqrt(square.value))


@pytest.mark.parametrize("states", [0, 1, 2])
@pytest.mark.parametrize("tau", [1, 3])
def test_the_gain_of_a_given_controller_is_the_referees(states, tau):
    plant, gains, given = random_loop(10 * states + tau, c=states)
    language = DwellTime(tau, modes=2).clocked(0)
    found = gain.certify(plant, language, gains=gains, representation=FIXED)
    pieces = {
        mode: by_hand(plant.floats[mode - 1], {name: np.array(rows, float) for name, rows in entry.items()})
        for mode, entry in enumerate(given, 1)
    }
    graph = language.graph(0)
    expected = referee_gain(pieces, [(u, label[0], v) for u, label, v in graph.edges], graph.nodes)
    assert found.value == pytest.approx(expected, rel=1e-5)
    assert found.at_least <= expected * (1 + 1e-6)
    assert found.matrices.shape == (graph.nodes, 2 + states, 2 + states)


def test_loops_are_closed_as_by_hand_exactly():
    plant, gains, given = random_loop(3)
    system = closed_by(plant, gains)
    for mode, entry in enumerate(given, 1):
        own = {name: np.array(rows, dtype=object) for name, rows in plant.exact[mode - 1].items()}
        exact = {name: np.array([[Fraction(str(x)) for x in row] for row in rows.tolist()], dtype=object)
                 for name, rows in entry.items() if name in "ABCD"}  # fmt: skip
        label = (mode, mode, 0)
        found = [system.exact_loop(label, gains), system.exact_drive(label, gains),
                 system.exact_loop(label, gains, "CD"), system.exact_drive(label, gains, "FD")]  # fmt: skip
        for one, two in zip(found, by_hand(own, exact), strict=True):
            assert one == two.tolist()


def test_rates_and_balls_of_a_given_controller_hold_along_runs():
    plant, gains, given = random_loop(5)
    language = ArbitrarySwitching(modes=2).clocked(0)
    rate = stability.decay_rate(plant, language, gains=gains)
    ball = reach.certify(plant, language, gains=gains, alpha="common")
    rng, most, growth = np.random.default_rng(0), 0.0, []
    for _ in range(20):
        z, free = np.zeros(4), rng.normal(size=4)
        first = np.linalg.norm(free)
        for _ in range(60):
            mode = int(rng.integers(2))
            loop, drive, *_ = by_hand(plant.floats[mode], {name: np.array(rows) for name, rows in given[mode].items()})
            w = rng.normal(size=2)
            z, free = loop @ z + drive @ (w / np.linalg.norm(w)), loop @ free
            most = max(most, np.linalg.norm(z))
        growth.append((np.linalg.norm(free) / first) ** (1 / 60))
    assert ball.at_least <= ball.value
    assert 0.2 * ball.value < most < ball.value
    assert max(growth) < rate.value
    assert rate.value / rate.at_least - 1 < 2e-6


def test_an_unstable_loop_is_refuted_by_a_word():
    plant, gains, _ = random_loop(3)
    faster = SwitchedSystem(**{name: [np.array(mode[name]) * (8 if name == "A" else 1) for mode in plant.floats]
                               for name in plant.exact[0]})  # fmt: skip
    with pytest.raises(NotCertifiedError) as caught:
        stability.certify(faster, ArbitrarySwitching(modes=2).clocked(0), gains=gains)
    assert caught.value.counterexample.kind == "unstable"
    assert "decays no faster" in verify(json.loads(caught.value.counterexample.text())).claim


def lowest(document):
    """The smallest eigenvalue of all inequalities of a gain, closed by hand: an independent look."""
    problem, proof = document["problem"], document["proof"]

    def floats(entry):
        return {name: np.array([[float(Fraction(x)) for x in row] for row in rows])
                for name, rows in entry.items() if name in "ABCDEFMNK"}  # fmt: skip

    pieces = [
        by_hand(floats(mode), floats(entry)) for mode, entry in zip(problem["modes"], problem["gains"], strict=True)
    ]
    size = len(pieces[0][0])
    matrices = []
    for triangle in proof["matrices"]:
        rows = np.zeros((size, size))
        rows[np.triu_indices(size)] = [item / proof["denominator"] for item in triangle]
        matrices.append(rows + rows.T - np.diag(np.diag(rows)))
    found = [np.linalg.eigvalsh(rows)[0] for rows in matrices]
    for u, label, v in proof["edges"]:
        a, e, c, f = pieces[label[0] - 1]
        loop, out = np.hstack([a, e]), np.hstack([c, f])
        here = np.zeros((loop.shape[1],) * 2)
        here[:size, :size] = matrices[u]
        here[size:, size:] = float(Fraction(document["claim"]["value"])) ** 2 * np.eye(e.shape[1])
        found.append(np.linalg.eigvalsh(here - loop.T @ matrices[v] @ loop - out.T @ out)[0])
    return min(found)


def test_every_mutation_is_refused_or_true():
    plant, gains, _ = random_loop(7, c=1)
    made = gain.certify(plant, ArbitrarySwitching(modes=2).clocked(0), gains=gains, representation=FIXED)
    document = json.loads(made.text())
    del document["claim"]["at_least"]  # a bound from below is another matter
    rng, outcomes = np.random.default_rng(0), []

    assert not refused(document)
    for name in [*(("modes", key) for key in "ABCDEFMN"), *(("gains", key) for key in "ABCD")] * 4:
        changed = copy.deepcopy(document)
        entry = changed["problem"][name[0]][rng.integers(2)][name[1]]
        row, column = rng.integers(len(entry)), rng.integers(len(entry[0]))
        step = Fraction(int(rng.normal() * 1000), 10 ** int(rng.integers(3, 12)))
        entry[row][column] = str(Fraction(entry[row][column]) + step)
        margin = lowest(changed)
        if abs(margin) > 1e-11:
            assert refused(changed) == (margin < 0), (name, step)
            outcomes.append(margin < 0)
    for _ in range(60):
        changed = copy.deepcopy(document)
        rows = changed["proof"]["matrices"]
        rows[rng.integers(len(rows))][rng.integers(6)] += int(rng.normal() * 10.0 ** rng.integers(1, 9))
        margin = lowest(changed)
        if abs(margin) > 1e-11:
            assert refused(changed) == (margin < 0)
            outcomes.append(margin < 0)
    assert 20 < sum(outcomes) < len(outcomes) - 20
    for change in ({"D": None}, {"A": [["0.1"], ["0.2"]]}, {"B": [["1", "2"]]}, {"C": []}, {"A": [[]]}):
        changed = copy.deepcopy(document)
        changed["problem"]["gains"][0] |= change
        assert refused(changed)
    changed = copy.deepcopy(document)
    changed["problem"]["gains"] = changed["problem"]["gains"][:1] * 2
    assert refused(changed)


def best_of_all_controllers(mode):
    """The smallest gain of a mode under any linear controller (P. Gahinet and P. Apkarian, doi:10.1002/rnc.4590040403).

    R and S with [R I; I S] >= 0 and two inequalities projected on what input and reading leave free.
    """
    from scipy.linalg import null_space

    a, b, c, d, e, f, m, noise = (mode[name] for name in "ABCDEFMN")
    n, q, p = len(a), e.shape[1], len(c)
    r, s = (cp.Variable((n, n), symmetric=True) for _ in range(2))
    g = cp.Variable()
    free = null_space(np.hstack([b.T, d.T]))
    left = np.zeros((n + p + q, free.shape[1] + q))
    left[: n + p, : free.shape[1]], left[n + p :, free.shape[1] :] = free, np.eye(q)
    one = cp.bmat([[a @ r @ a.T - r, a @ r @ c.T, e], [c @ r @ a.T, c @ r @ c.T - g * np.eye(p), f],
                   [e.T, f.T, -g * np.eye(q)]])  # fmt: skip
    free = null_space(np.hstack([m, noise]))
    right = np.zeros((n + q + p, free.shape[1] + p))
    right[: n + q, : free.shape[1]], right[n + q :, free.shape[1] :] = free, np.eye(p)
    two = cp.bmat([[a.T @ s @ a - s, a.T @ s @ e, c.T], [e.T @ s @ a, e.T @ s @ e - g * np.eye(q), f.T],
                   [c, f, -g * np.eye(p)]])  # fmt: skip
    both = cp.bmat([[r, np.eye(n)], [np.eye(n), s]])
    problem = cp.Problem(cp.Minimize(g), [left.T @ one @ left << 0, right.T @ two @ right << 0, both >> 0])
    problem.solve(solver=cp.CLARABEL)
    assert problem.status in {"optimal", "optimal_inaccurate"}
    return float(g.value)


def test_no_design_is_better_than_the_best_of_all_controllers():
    """One mode: the referee finds the optimum over controllers of any structure; observers come within twice that."""
    alone = SwitchedSystem(**{name: [READ.exact[0][name]] for name in READ.exact[0]})
    found = output_feedback.minimize_gain(alone, ArbitrarySwitching(modes=1).clocked(0))
    best = best_of_all_controllers(READ.floats[0])
    assert best * (1 - 1e-5) < found.certificate.value < 2 * best
    assert found.certificate.at_least == pytest.approx(found.certificate.value, rel=1e-4)


def test_feedback_and_observer_decay_as_fast_as_each_alone():
    """A plant's own observer leaves the loop block triangular: its rate is the slower of both."""
    language = ArbitrarySwitching(modes=2).clocked(0)
    found = output_feedback.stabilize(READ, language, tolerance=1e-4)
    alone = synthesis.stabilize(output_feedback.unmeasured(READ), language, tolerance=1e-4)
    error = SwitchedSystem(A=[mode["A"] - found.observers[k, 0] @ mode["M"] for k, mode in enumerate(READ.floats, 1)])
    errors = stability.decay_rate(error, ArbitrarySwitching(modes=2), representation=FIXED)
    assert found.certificate.value == pytest.approx(max(errors.value, alone.certificate.value), rel=2e-3)
    assert found.certificate.value <= found.bound * (1 + 1e-6)


@pytest.mark.slow
def test_an_old_observer_and_an_old_gain_may_act_after_a_switch():
    """Example 3.1 with readings: certified, and runs in which the old controller goes on for a sample stay below."""
    from theory.switching.examples import example

    modes = example("example_3_1").exact
    plant = SwitchedSystem(**{name: [mode[name] for mode in modes] for name in "ABCDEF"},
                           M=[[[1, 0], [0, 1]]] * 2, N=[[["0.01"], [0]]] * 2)  # fmt: skip
    language = Asynchronous(3, 1, modes=2)
    found = output_feedback.minimize_gain(plant, language)
    assert found.certificate.value > found.certificate.at_least > 4
    assert verify(json.loads(found.certificate.text())).inequalities > 10
    rng = np.random.default_rng(0)
    for seed in range(20):
        x, estimate, out, pushed = np.zeros(2), np.zeros(2), 0.0, 0.0
        for mode, acting, clock in language.random(80, seed):
            own, other, w = plant.floats[mode - 1], plant.floats[acting - 1], rng.normal(size=1)
            k, observer = found.feedback[acting, clock], found.observers[acting, clock]
            u, seen = k @ estimate, own["M"] @ x + own["N"] @ w
            out += float(np.sum((own["C"] @ x + own["D"] @ u + own["F"] @ w) ** 2))
            pushed += float(np.sum(w**2))
            estimate = other["A"] @ estimate + other["B"] @ u + observer @ (seen - other["M"] @ estimate)
            x = own["A"] @ x + own["B"] @ u + own["E"] @ w
        assert out < found.certificate.value**2 * pushed


def test_what_does_not_fit_is_named():
    plant, gains, given = random_loop(3)
    language = ArbitrarySwitching(modes=2).clocked(0)
    with pytest.raises(IllPosedError, match="gains: have to be all K, or all controllers"):
        Gains.of_document([given[0], {"mode": 2, "clock": 0, "K": [[1]]}])
    with pytest.raises(IllPosedError, match="B of mode 1, clock 0: is 1 x 1, has to be 2 x 1"):
        Gains.of_document([{**given[0], "B": [[1]]}])
    with pytest.raises(IllPosedError, match="M: a controller needs"):
        stability.certify(output_feedback.unmeasured(plant), language, gains=gains)
    with pytest.raises(IllPosedError, match="M: a feedback of what is measured needs"):
        output_feedback.stabilize(output_feedback.unmeasured(plant), language)
    with pytest.raises(IllPosedError, match="K of mode 1, clock 0: is 1 x 2, has to be 1 x 1"):
        stability.certify(plant, language, gains=Gains({(m, 0): [[Fraction(1)] * 2] for m in (1, 2)}))
    blind = SwitchedSystem(A=[[["1.1"]]], B=[[[1]]], M=[[[0]]])
    with pytest.raises(NotCertifiedError, match="no observers"):
        output_feedback.stabilize(blind, ArbitrarySwitching(modes=1).clocked(0))
