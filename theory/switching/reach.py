"""Reachable sets under bounded peak disturbances: Lemma 4.1, Theorems 4.3 and 4.4, and the tube of Theorem 4.5."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any, Literal

import numpy as np
from scipy import optimize

from theory.arrays import Array
from theory.errors import IllPosedError, NotCertifiedError, SolverError
from theory.solvers.lmi import LmiProblem, MatrixVariable, SymmetricVariable
from theory.switching.certificate import Certificate, Claim, round_and_verify, rounded_up
from theory.switching.graph import Graph
from theory.switching.language import Language
from theory.switching.loops import check_fit, closed_loops, edge_indices
from theory.switching.representation import Representation
from theory.switching.stability import counterexample
from theory.switching.synthesis import Design, Feedback, GainSchedule, add_jump_inequalities, read_gains, with_clock
from theory.switching.system import Gains, SwitchedSystem, exact_number, mode_of

GRID = tuple(k / 10 for k in range(1, 10))
"""Values of alpha tried first, and the only ones where the theorem is applied as printed (section 4.6)."""

SLACKS = (1e-6, 1e-5, 1e-4, 1e-3)
"""Relative excesses of radius^2 over the optimum while the margin is maximised."""

ETA_MIN = 1e-7
"""Smallest 1 / radius^2, in units of `one_step_reach`: balls some 3000 times one step's reach are a solver's zero."""

Alpha = Literal["mode", "common", "grid"]
"""One number a mode, one for all, or one for all from the grid."""


def certify(
    system: SwitchedSystem,
    language: Language,
    *,
    peak: Any = 1,
    gains: Gains | None = None,
    alpha: Alpha | Sequence[float] = "mode",
    representation: Representation | None = None,
    progress: Callable[[str], None] | None = None,
) -> Certificate:
    """A certificate of the smallest ball, and the tube in it, that hold e+ = G e + E w from e = 0 (Theorem 4.3).

    Parameters
    ----------
    system
        With E.
    language
        Signals for which the ball is claimed.
    peak
        Bound of |w(k)|, in the units of w.
    gains
        Of the closed loop, for letters with a gain and a clock.
    alpha
        How the contraction of Lemma 4.1 is searched, or one given number a mode.
    representation
        Graph and lift.
    progress
        Receives the search's state in words.

    Raises
    ------
    NotCertifiedError
        No bounded set at this lift.
    """
    check_fit(system, language, gains)
    system.need("E", "a reachable set")
    bound = _peak(peak)
    representation = representation or Representation()
    started = time.perf_counter()
    graph = representation.graph(language)

    def square(values: Array) -> float:
        return _inner_ball(system, graph, gains, float(bound), values)

    unit = one_step_reach(system, float(bound))
    best, chosen = search_alpha(square, system.modes, alpha, progress, unit)
    if not math.isfinite(best):
        found = counterexample(system, language, Fraction(1), gains, graph)
        raise NotCertifiedError("no bounded reachable set at this lift; a larger one may do", found)
    for digits in (6, 4, 3, 2):
        exact = [Fraction(round(float(value) * 10**digits), 10**digits) for value in chosen]
        best = square(np.array([float(value) for value in exact]))
        if math.isfinite(best):
            break
    failure: Exception = NotCertifiedError("the rounded alpha gives no set")
    for slack in SLACKS if math.isfinite(best) else ():
        radius = rounded_up(unit * math.sqrt(best * (1 + slack)))
        try:
            matrices, margin = _margin(system, graph, gains, float(bound), exact, float(radius) / unit)
            matrices, margin = matrices / unit**2, margin * min(unit**-2, float(bound) ** -2)
            about = {
                "theorem": "4.3",
                **representation.as_document(graph),
                "solve_s": round(time.perf_counter() - started, 4),
            }
            claim = Claim("reach", radius, system, language, gains, bound, exact)
            return round_and_verify(claim, graph, matrices, margin, about)
        except (SolverError, NotCertifiedError) as error:
            failure = error
    raise NotCertifiedError(f"radius {unit * math.sqrt(best):.7g}: {failure}") from failure


def minimize(
    system: SwitchedSystem,
    language: Language,
    *,
    peak: Any = 1,
    schedule: GainSchedule = "clock",
    symmetric: bool = False,
    alpha: Alpha | Sequence[float] = "mode",
    representation: Representation | None = None,
    progress: Callable[[str], None] | None = None,
) -> Design:
    """Gains of the smallest ball around the reachable set (Theorem 4.4 with (4.50)-(4.51)), then Theorem 4.3 on it.

    Parameters as in `certify` and `synthesis.stabilize`; `Design.bound` is the radius sqrt(eps) of (4.51).

    Raises
    ------
    NotCertifiedError
        No gains by these inequalities at this lift.
    """
    system.need("BE", "a synthesis of a reachable set")
    bound = float(_peak(peak))
    language = with_clock(language)
    representation = representation or Representation()
    started = time.perf_counter()
    graph = representation.graph(language)

    def square(values: Array) -> float:
        problem, _, _, size = _ball_inequalities(system, graph, schedule, bound, values, symmetric=symmetric)
        try:
            return float(problem.minimize({size: 1.0}, "reachable set").values[size])
        except SolverError:
            return math.inf

    unit = one_step_reach(system, bound)
    best, chosen = search_alpha(square, system.modes, alpha, progress, unit)
    if not math.isfinite(best):
        raise NotCertifiedError("no gains by these inequalities at this lift; a larger one may do")
    gains = _gains(system, graph, schedule, bound, chosen, best, symmetric=symmetric)
    certificate = certify(system, language, peak=peak, gains=gains, representation=representation, progress=progress,
                          alpha=alpha if isinstance(alpha, str) else "mode")  # fmt: skip
    return Design(gains, unit * math.sqrt(best), certificate, time.perf_counter() - started)


def search_alpha(
    square: Callable[[Array], float],
    modes: int,
    alpha: Alpha | Sequence[float],
    progress: Callable[[str], None] | None,
    unit: float = 1.0,
) -> tuple[float, Array]:
    """The alpha of the smallest ball: the grid, then Brent's method for one number, then Nelder-Mead for one a mode.

    For one mode's number the ball is smooth but not convex in alpha, hence the grid and the restarts.

    Parameters
    ----------
    square
        Radius^2 at given alpha, infinite where there is no ball.
    modes
        N.
    alpha
        The way to search, or one given number a mode.
    progress
        Receives every trial in words.
    unit
        Unit of the radius, for these words.
    """
    if not isinstance(alpha, str):
        if not isinstance(alpha, list | tuple | np.ndarray) or not all(isinstance(item, int | float) for item in alpha):
            raise IllPosedError("alpha", f"{alpha!r:.60} is neither a way to search nor a list of numbers")
        values = np.array([float(item) for item in alpha])
        if len(values) != modes or not all(0 < item < 1 for item in values):
            raise IllPosedError("alpha", f"needs {modes} numbers between 0 and 1, one a mode")
        return square(values), values
    if alpha not in {"mode", "common", "grid"}:
        raise IllPosedError("alpha", f"{alpha!r} is none of 'mode', 'common', 'grid'")
    return _searched(square, modes, alpha, progress, unit)


def _searched(
    square: Callable[[Array], float], modes: int, alpha: str, progress: Callable[[str], None] | None, unit: float
) -> tuple[float, Array]:
    def evaluated(values: Array) -> float:
        found = square(values)
        if progress and math.isfinite(found):
            progress(f"alpha {np.round(values, 3).tolist()}: radius {unit * math.sqrt(found):.5g}")
        return found

    best, place = min((evaluated(np.full(modes, value)), value) for value in GRID)
    if not math.isfinite(best):  # a finer look at the ends
        best, place = min(
            (evaluated(np.full(modes, value)), value) for value in (0.02, 0.05, 0.95, 0.98, 0.99, 0.995, 0.999)
        )
    chosen = np.full(modes, place)
    if alpha == "grid" or not math.isfinite(best):
        return best, chosen
    found = optimize.minimize_scalar(
        lambda value: min(evaluated(np.full(modes, value)), 1e12),
        bounds=(max(place - 0.1, 1e-3), min(place + 0.1, 1 - 1e-3)), method="bounded", options={"xatol": 1e-4},
    )  # fmt: skip
    if found.fun < best:
        best, chosen = float(found.fun), np.full(modes, float(found.x))
    if alpha == "common" or modes == 1:
        return best, chosen
    for spread in (0.8, 0.4):  # in the logit, where every number is allowed; a restart frees a simplex that collapsed
        start = np.log(chosen / (1 - chosen))
        result = optimize.minimize(
            lambda point: min(evaluated(_logistic(point)), 1e12), start, method="Nelder-Mead",
            options={"initial_simplex": np.vstack([start, start + spread * np.eye(modes)]), "maxfev": 60 * modes,
                     "xatol": 1e-3, "fatol": 1e-7 * best},
        )  # fmt: skip
        if result.fun < best:
            best, chosen = float(result.fun), _logistic(result.x)
    return best, chosen


def _loop_inequalities(
    system: SwitchedSystem, graph: Graph, gains: Gains | None, peak: float, alpha: Array
) -> tuple[LmiProblem, SymmetricVariable, int]:
    """-(4.39) by a Schur complement: [a O_u, 0; 0, (1-a)/w^2 I] - [G E]' O_v [G E] > 0, and O_u - O_v > 0 (4.40).

    In units of `one_step_reach`: the unknowns are O times its square, and a disturbance of 1 is one at its peak.
    """
    maps = closed_loops(system, graph, gains)
    modes = [mode_of(label) for _, label, _ in graph.edges]
    drive = np.array([system.floats[mode - 1]["E"] for mode in modes]) * (peak / one_step_reach(system, peak))
    n, width = system.size, system.size + drive.shape[-1]
    share = alpha[np.array(modes) - 1]
    source, target, leave, enter = edge_indices(graph)
    problem = LmiProblem()
    unknown, number = problem.symmetric(graph.nodes, n), problem.number()
    noise = np.diag([0.0] * n + [1.0] * (width - n))
    edges = problem.blocks(len(source), width, (1 - share)[:, None, None] * noise)
    edges.congruence(unknown, source, np.eye(width)[:n], share)
    edges.congruence(unknown, target, np.concatenate([maps, drive], axis=2), -1.0)
    if len(leave):
        jumps = problem.blocks(len(leave), n).congruence(unknown, leave, np.eye(n))
        jumps.congruence(unknown, enter, np.eye(n), -1.0)
    return problem, unknown, number


def _inner_ball(system: SwitchedSystem, graph: Graph, gains: Gains | None, peak: float, alpha: Array) -> float:
    """The smallest radius^2 = 1 / eta with O_u > eta I at given alpha; infinite if there is none."""
    problem, unknown, eta = _loop_inequalities(system, graph, gains, peak, alpha)
    problem.blocks(graph.nodes, system.size).congruence(unknown, np.arange(graph.nodes), np.eye(system.size)).scalar(
        eta, -np.eye(system.size)
    )
    try:
        value = float(problem.minimize({eta: -1.0}, "reachable set").values[eta])
    except SolverError:
        return math.inf
    return 1 / value if value > ETA_MIN else math.inf


def _margin(
    system: SwitchedSystem, graph: Graph, gains: Gains | None, peak: float, alpha: Sequence[Fraction], radius: float
) -> tuple[Array, float]:
    """Matrices of the largest margin at a fixed radius."""
    problem, unknown, margin = _loop_inequalities(system, graph, gains, peak, np.array([float(item) for item in alpha]))
    every, identity = np.arange(graph.nodes), np.eye(system.size)
    problem.blocks(graph.nodes, system.size, -identity / radius**2).congruence(unknown, every, identity)
    for blocks in problem.every:
        blocks.scalar(margin, -np.eye(blocks.size))
    solution = problem.minimize({margin: -1.0}, "reachable set")
    return unknown.of(solution.values), float(solution.values[margin])


def _ball_inequalities(
    system: SwitchedSystem, graph: Graph, schedule: GainSchedule, peak: float, alpha: Array, *, symmetric: bool,
    limit: float | None = None, growth: float = 1.0,
) -> tuple[LmiProblem, SymmetricVariable | MatrixVariable, MatrixVariable, int]:  # fmt: skip
    """-(4.43), -(4.44) and Q < eps I (4.50); the last unknown is eps, or free for a margin where eps is given.

    In units of `one_step_reach`, as `_loop_inequalities`.

    The blocks' order is e+, e, w: [Q_v, -(A W + B U), -E; ., a (W + W' - Q_u), 0; ., ., (1-a)/w^2 I].
    """
    n, noises = system.size, system.floats[0]["E"].shape[1]
    select = np.eye(2 * n + noises)
    ahead, here, noise = select[:n], select[n : 2 * n], select[2 * n :]
    problem, feedback = LmiProblem(), Feedback(graph, schedule)
    unknown = problem.symmetric(graph.nodes, n)
    slacks, inputs, last = feedback.unknowns(problem, system, symmetric=symmetric)
    source, target, leave, enter = edge_indices(graph)
    numbers = [mode_of(label) - 1 for _, label, _ in graph.edges]
    share = alpha[np.array(numbers)]
    modes = [system.floats[number] for number in numbers]
    unit = peak / one_step_reach(system, peak)
    cross = np.array([-ahead.T @ mode["E"] @ noise * unit for mode in modes])
    constant = cross + np.swapaxes(cross, 1, 2) + (1 - share)[:, None, None] * (noise.T @ noise)
    edges = problem.blocks(len(source), len(select), constant)
    edges.congruence(unknown, target, ahead).congruence(unknown, source, here, -share)
    through = [a * here.T - ahead.T @ mode["A"] for a, mode in zip(share, modes, strict=True)]
    feedback.close(edges, slacks, inputs, here, through, [-ahead.T @ mode["B"] for mode in modes])
    add_jump_inequalities(problem, unknown, leave, enter, growth)
    identity = np.eye(n)
    ball = problem.blocks(graph.nodes, n, 0.0 if limit is None else limit * identity)
    ball.congruence(unknown, np.arange(graph.nodes), identity, -1.0)
    if limit is None:
        ball.scalar(last, identity)
    return problem, slacks, inputs, last


def one_step_reach(system: SwitchedSystem, peak: float) -> float:
    """The length that a disturbance at its peak reaches in one step, in whose units sets are computed."""
    length = peak * max(float(np.linalg.norm(mode["E"], 2)) for mode in system.floats)
    if length == 0:
        raise IllPosedError("E", "is zero in every mode: nothing but 0 is reached")
    return length


def weighted_ball(system: SwitchedSystem, graph: Graph, *, alpha: float, growth: float, peak: float) -> float:
    """The smallest eps of (4.51) with a growth of V along jumps."""
    problem, _, _, size = _ball_inequalities(
        system, graph, "clock", peak, np.full(system.modes, alpha), symmetric=False, growth=growth
    )
    return (
        float(problem.minimize({size: 1.0}, "weighted reachable set").values[size]) * one_step_reach(system, peak) ** 2
    )


def _gains(
    system: SwitchedSystem,
    graph: Graph,
    schedule: GainSchedule,
    peak: float,
    alpha: Array,
    best: float,
    *,
    symmetric: bool,
) -> Gains:
    """Gains at the best alpha, read off where the inequalities have a margin if they have one."""
    problem, slacks, inputs, last = _ball_inequalities(
        system, graph, schedule, peak, alpha, symmetric=symmetric, limit=best * (1 + 1e-7)
    )
    for blocks in problem.every:
        blocks.scalar(last, -np.eye(blocks.size))
    try:
        solution = problem.minimize({last: -1.0}, "reachable set")
    except SolverError:
        problem, slacks, inputs, last = _ball_inequalities(system, graph, schedule, peak, alpha, symmetric=symmetric)
        solution = problem.minimize({last: 1.0}, "reachable set")
    return read_gains(graph, schedule, slacks.of(solution.values), inputs.of(solution.values))


def _peak(peak: Any) -> Fraction:
    value = exact_number(peak, "peak")
    if value <= 0:
        raise IllPosedError("peak", f"{float(value):g} is not positive")
    return value


def _logistic(point: Array) -> Array:
    return np.clip(1 / (1 + np.exp(-point)), 1e-4, 1 - 1e-4)
