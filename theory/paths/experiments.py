"""Measured violation of scenario decisions: one step at an active limit, and the choice among many paths."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import gammaln
from scipy.stats import norm

from theory.arrays import Array
from theory.errors import IllPosedError
from theory.paths.boxes import Boxes, free_boxes
from theory.paths.examples import mission
from theory.paths.mission import Mission
from theory.paths.planner import KEPT, PathPlanner
from theory.paths.scenario_bounds import ViolationBound, by_count, by_tail
from theory.paths.scenario_program import ScenarioProgram, search_paths
from theory.paths.stochastic import RandomSystem

AT_THE_LIMIT = np.array([92.0, 138.0, 5.0, 20.0])
"""Beside obstacle 1, whose safe distance ends at x_1 = 95, and towards it: the next step limits the input.

The state the thesis starts from is not printed."""


@dataclass(frozen=True)
class OneStepExperiment:
    """Decisions from one state, each with samples of its own, and how often the next state keeps its limits."""

    scenarios: int
    satisfaction: Array
    """Per decision, the share of fresh next states that keep limits and safe distance."""
    following: Array
    """One next state a decision: draws x n."""
    kept: Array
    """Whether that one keeps them."""
    softened: int

    @property
    def mean(self) -> float:
        """Mean satisfaction over all decisions."""
        return float(self.satisfaction.mean())

    @property
    def error(self) -> float:
        """Standard error of the mean."""
        return float(self.satisfaction.std(ddof=1) / np.sqrt(len(self.satisfaction)))

    @property
    def spread(self) -> tuple[float, float]:
        """The 5 % and 95 % quantiles of the satisfaction over decisions."""
        low, high = np.quantile(self.satisfaction, [0.05, 0.95])
        return float(low), float(high)

    @property
    def expected(self) -> float:
        """1 - 1/(S + 1), exact for one active half-plane."""
        return 1 - 1 / (self.scenarios + 1)


def one_step(task: Mission, state: Array, draws: int = 400, fresh: int = 2000, seed: int = 0) -> OneStepExperiment:
    """The experiment of Fig. 6.3: decide `draws` times from a state, and look at the next one.

    Parameters
    ----------
    task
        The mission.
    state
        The state of every decision, n.
    draws
        Number of decisions.
    fresh
        Next states drawn a decision, over which its satisfaction is the mean.
    seed
        Of samples and next states.
    """
    if draws < 2 or fresh < 1:
        raise IllPosedError("draws, fresh", f"must be at least 2 and 1, given {draws} and {fresh}")
    ours, its = np.random.SeedSequence(seed).spawn(2)
    planner, rng = PathPlanner(task, ours), np.random.default_rng(its)
    shares, following, softened = [], [], 0
    for _ in range(draws):
        step = planner.decide(state)
        softened += step.softened
        drawn = task.system.draw(rng, fresh, 1)
        after = drawn.A[:, 0] @ state + drawn.B[:, 0] @ step.input + drawn.w[:, 0]
        kept = _kept(task, after)
        shares.append(kept.mean())
        following.append(after[0])
    states = np.array(following)
    return OneStepExperiment(task.scenarios, np.array(shares), states, _kept(task, states), softened)


def at_the_limit(scenarios: int, draws: int = 400, seed: int = 0) -> OneStepExperiment:
    """The experiment beside the first obstacle of Sec. 6.4, by (6.5) as printed: one set of futures for everything.

    With futures of their own later steps would limit the first input in some of the decisions, which are then safer.
    """
    found, _ = mission("paths", scenarios=scenarios, apart=False)
    return one_step(found, AT_THE_LIMIT, draws, seed=seed)


def _kept(task: Mission, states: Array) -> Array:
    low, high = task.state_limits.low[0] - KEPT, task.state_limits.high[0] + KEPT
    places = states[:, None, : task.obstacles.dimension]
    deep = (places > task.grown.low + KEPT) & (places < task.grown.high - KEPT)
    hit = np.asarray(deep.all(axis=2)).any(axis=1)
    return np.asarray((states >= low).all(axis=1) & (states <= high).all(axis=1) & ~hit)


@dataclass(frozen=True)
class PathChoice:
    """The choice among J paths that limit different coordinates."""

    paths: int
    scenarios: int
    violation: float
    """Mean over the draws of the exact probability that the next state is in the obstacle."""
    error: float
    """Standard error of that mean."""
    expected: float
    """Violation of J independent half-planes: 1 - J! Gamma(1 + 1/S) / Gamma(J + 1 + 1/S)."""
    claimed: float
    """2/(1+S), Theorem 6.1."""
    bounds: tuple[ViolationBound, ViolationBound]


def many_paths(dimension: int, scenarios: int = 19, draws: int = 400, seed: int = 0) -> PathChoice:
    """Violation of the best of 2 x dimension paths of one step, out of a cube by the face with the mildest samples.

    z+ = z + u + w from the middle of the cube, w normal, |u|^2 to be small: all faces are alike, and the one chosen is
    the one whose coordinate drew the mildest samples. A single path would be violated with probability 1/(S+1).

    Parameters
    ----------
    dimension
        Of the cube, 1 to 50.
    scenarios
        S, samples a decision.
    draws
        Number of decisions.
    seed
        Of the samples.
    """
    if not 1 <= dimension <= 50:
        raise IllPosedError("dimension", f"must be 1 to 50, given {dimension}")
    if scenarios < 1 or draws < 2:
        raise IllPosedError("scenarios, draws", f"must be at least 1 and 2, given {scenarios} and {draws}")
    half, eye = 10.0, np.eye(dimension)
    system = RandomSystem(eye, eye, np.ones(dimension), np.zeros((0, dimension, dimension)), np.zeros(0), np.zeros(0))
    far = np.full((1, dimension), 1000.0)
    room, middle = Boxes(-far, far), np.zeros(dimension)
    free = free_boxes(room, Boxes(-far / 1000 * half, far / 1000 * half))
    rng = np.random.default_rng(seed)
    rates = []
    for _ in range(draws):
        samples = system.draw(rng, scenarios, 1)
        program = ScenarioProgram(samples, middle, middle, 0 * eye, eye, room, room)
        found = search_paths(program, free)
        box, action = found.path[0], found.solved.inputs[0]
        below = norm.cdf(free.low[box] - action)  # only one side of a face box is near
        above = norm.sf(free.high[box] - action)
        rates.append(1 - np.prod(1 - below - above))
    count, rate = len(free), np.array(rates)
    one = 1 / scenarios
    expected = float(-np.expm1(gammaln(count + 1) + gammaln(1 + one) - gammaln(count + 1 + one)))
    return PathChoice(
        count, scenarios, float(rate.mean()), float(rate.std(ddof=1) / np.sqrt(draws)), expected, 2 / (1 + scenarios),
        (by_count(count, scenarios, 1), by_tail(count, scenarios, 1)),
    )  # fmt: skip
