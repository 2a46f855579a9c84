"""Algorithm 1: predictive control of an unknown linear system in three modes, its limits kept whatever the noise.

Mode 1 plans with the centre of the set of models, mode 2 with the latest regression, whichever promises the lower cost;
mode 3 is the centre's gain, once the state is in its invariant set. Every plan's tube holds for all models of the set.

The guarantees, if the noise keeps its bound: the true model lies in the set; limits hold from the first plan on; a plan
exists at every later step; the cost of a plan is at most that of its predecessor, shifted, from the state reached; and
a state in the invariant set stays there. Every run tried got there; that is not proved where modes 1 and 2 alternate;
convergence to 0, as the thesis has it, cannot be while there is noise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from theory.arrays import Array
from theory.errors import IllPosedError, InfeasibleError, RankError, TheoryError
from theory.tubes.consistency import ConsistencyMonitor
from theory.tubes.dmd import Window
from theory.tubes.models import ModelSet, Regulator
from theory.tubes.polytope import TOLERANCE
from theory.tubes.tube import Limits, Tube, contractive_set
from theory.tubes.tube_program import Plan, TubeProgram
from theory.validation import check_integer, check_noise, finite_array

FINE = 60
"""Faces of an invariant set that is fine enough for a tube."""

Plant = Callable[[Array, Array], Array]
"""The unknown system: the next state from a state and an input."""

GUARANTEE = (
    "if every entry of the noise stays within its bound: the true model is in the set; from any state where a plan "
    "exists, limits hold and plans exist at every later sample; a state in the invariant set stays there. A sample "
    "that no model explains is flagged, none leaves its tube before. It does not converge to 0, since the noise never "
    "ends"
)
"""The guarantee in words, for reports."""

ModeScenario = Literal["S1", "S2", "S3", "S4", "S5", ""]


@dataclass(frozen=True)
class TrimodalSettings:
    """Design parameters of Algorithm 1."""

    limits: Limits
    noise: float
    """w_max: bound of every entry of the disturbance."""
    Q: Array  # n_x x n_x
    R: Array  # n_u x n_u
    excitation: Array
    """m x n_u: the inputs of the first m samples, and by its length the window of the regression."""
    horizon: int = 15
    """N, samples."""
    contraction: float = 0.95
    """lambda of the invariant set."""
    refinement: int = 1
    """Further faces of the tube: images of its own under so many steps. They do not change the invariant set; one of
    more than `FINE` faces gets none."""
    learning: int | None = None
    """m', samples under u = sat(K x) after the excitation; n_x + n_u by default."""
    rank: int | None = None
    """Singular values the regression keeps; all by default."""
    adaptive: bool = True
    """Whether there is a mode 2; without it this is tube predictive control with the centre of the set of models."""

    def __post_init__(self) -> None:
        check_noise(self.noise)
        excitation = finite_array("excitation", self.excitation, (None, self.limits.G.shape[1]))
        if not len(excitation):
            raise IllPosedError("excitation", "must have a sample at least")
        check_integer("refinement", self.refinement, 0, 10)
        if self.learning is not None:
            check_integer("learning", self.learning, 1, 100_000)
        object.__setattr__(self, "excitation", excitation)


@dataclass(frozen=True)
class Prepared:
    """Result of the preparation (lines 1 and 2 of Algorithm 1)."""

    states: Array  # (M + 1) x n_x
    inputs: Array  # M x n_u
    models: ModelSet
    window: Window

    @property
    def steps(self) -> int:
        """M."""
        return len(self.inputs)


@dataclass(frozen=True)
class Action:
    """An input, and how it was reached."""

    input: Array
    mode: int
    scenario: ModeScenario
    plan: Plan | None = None
    """None in mode 3."""
    program: TubeProgram | None = None


def prepare(plant: Plant, start: Array, settings: TrimodalSettings) -> Prepared:
    """Excite the system, regulate it with the first regression, and collect the set of models from all samples.

    Parameters
    ----------
    plant
        The unknown system.
    start
        x_0, n_x.
    settings
        Design parameters; `excitation` and `learning` set the number of samples.

    Raises
    ------
    RankError, EmptySetError
        The data leave models without end, or no model explains them with this noise.
    """
    state = finite_array("start", start, (settings.limits.F.shape[1],))
    states, window = [state], Window(len(settings.excitation))
    inputs: list[Array] = []

    def step(action: Array) -> None:
        nonlocal state
        before = state
        state = np.asarray(plant(state, action), float)
        if state.shape != before.shape:
            raise IllPosedError("plant", f"must return {len(before)} states, returned the shape {state.shape}")
        if not np.isfinite(state).all():
            raise IllPosedError("excitation", f"the state left all bounds after {len(inputs) + 1} samples: lower it")
        window.push(before, action, state)
        states.append(state)
        inputs.append(np.array(action))

    for action in settings.excitation:
        step(action)
    learning = settings.learning or len(state) + settings.excitation.shape[1]
    estimate = window.estimate(settings.rank)
    if settings.rank is None and not estimate.full_rank:
        raise RankError(
            "excitation",
            f"its samples span {estimate.rank} of {len(estimate.singular_values)} directions of (x, u): "
            "vary the input, add samples, or start from another state",
        )
    gain = Regulator.of(estimate.model, settings.Q, settings.R).gain
    for _ in range(learning):
        step(_saturated(gain @ state, settings.limits))
    recorded, actions = np.array(states), np.array(inputs)
    models = ModelSet.from_data(recorded[:-1], actions, recorded[1:], settings.noise)
    return Prepared(recorded, actions, models, window)


def _saturated(action: Array, limits: Limits) -> Array:
    """The input, scaled back until limits on inputs alone hold."""
    rows = limits.G[np.abs(limits.F).max(axis=1) == 0]
    return np.asarray(action / max(1.0, float((rows @ action).max(initial=0.0))))


@dataclass
class Trimodal:
    """The controller after its preparation: `decide` an input, then `observe` its successor."""

    settings: TrimodalSettings
    models: ModelSet
    window: Window
    regulator: Regulator = field(init=False)
    tube: Tube = field(init=False)
    central: TubeProgram = field(init=False)
    monitor: ConsistencyMonitor = field(init=False)
    """Flags samples that no model of the set explains: a changed plant, or noise beyond its bound."""

    def __post_init__(self) -> None:
        chosen = self.settings
        chosen.limits.check(self.models.states, self.models.inputs)
        self.regulator = Regulator.of(self.models.centre, chosen.Q, chosen.R)
        shape = contractive_set(self.models, self.regulator.gain, chosen.limits, chosen.noise, chosen.contraction)
        loop = self.models.centre.A + self.models.centre.B @ self.regulator.gain
        finer = chosen.refinement if len(shape.rows) <= FINE else 0
        faces = [shape.rows @ np.linalg.matrix_power(loop, i + 1) for i in range(finer)]
        shape = shape.touching(np.vstack([np.zeros((0, self.models.states)), *faces]))
        self.tube = Tube(shape, self.models, self.regulator.gain, chosen.limits, chosen.noise)
        self.tube.prepare()
        self.central = TubeProgram(self.tube, self.regulator, chosen.horizon)
        self.monitor = ConsistencyMonitor(self.models, chosen.noise)
        self._last = Action(np.zeros(self.models.inputs), 1, "")

    def inside(self, state: Array) -> bool:
        """Whether a state lies in the invariant set of mode 3.

        Parameters
        ----------
        state
            x, n_x.
        """
        return bool((self.tube.shape.rows @ state <= 1 + TOLERANCE).all())

    def decide(self, state: Array) -> Action:
        """Lines 5 to 25 of Algorithm 1; (5.9) only where the algorithm is silent, S4 applying its own plan.

        Parameters
        ----------
        state
            x, n_x.

        Returns
        -------
        Action
            The input, n_u, with the mode and the plan that it is from.

        Raises
        ------
        InfeasibleError
            No plan of any mode exists: the state lies outside the region of attraction, or noise or limits are not
            as stated.
        """
        state = finite_array("state", state, (self.models.states,))
        if self.inside(state):
            self._last = Action(self.regulator.gain @ state, 3, "")
            return self._last
        before = self._last
        candidates: list[tuple[int, ModeScenario, TubeProgram | None]]
        if before.mode == 2:
            candidates = [(1, "S3", self.central), (2, "S4", self._latest()), (2, "S5", before.program)]
        else:
            candidates = [(1, "S1", self.central), (2, "S2", self._latest())]
        best: Action | None = None
        failures: list[TheoryError] = []
        for mode, scenario, program in candidates:
            if program is None:
                continue
            try:
                plan = program.plan(state)
            except TheoryError as error:
                failures.append(error)
                continue
            if best is None or best.plan is None or plan.cost < best.plan.cost:
                best = Action(plan.action, mode, scenario, plan, program)
        if best is None:
            if not all(isinstance(error, InfeasibleError) for error in failures):
                raise next(error for error in failures if not isinstance(error, InfeasibleError))
            raise InfeasibleError("infeasible", f"all modes at the state {np.array2string(state, precision=4)}")
        self._last = best
        return best

    def observe(self, state: Array, action: Array, successor: Array) -> None:
        """Learn from a sample; not in mode 3, where the data lose rank. One that nothing explains is flagged.

        Parameters
        ----------
        state, action, successor
            x(k), u(k), x(k+1): n_x, n_u, n_x.
        """
        self.monitor.observe(state, action, successor)
        if self._last.mode != 3:
            self.window.push(state, action, successor)

    def _latest(self) -> TubeProgram | None:
        """Mode 2 with the latest regression; None where that is not wanted, or no gain stabilises it."""
        if not self.settings.adaptive:
            return None
        try:
            estimate = self.window.estimate(self.settings.rank)
            regulator = Regulator.of(estimate.model, self.settings.Q, self.settings.R)
        except TheoryError:
            return None
        return TubeProgram(self.tube.with_gain(regulator.gain), regulator, self.settings.horizon)


@dataclass(frozen=True)
class ClosedLoop:
    """A closed loop, from the end of the preparation."""

    states: Array  # (T + 1) x n_x
    actions: list[Action]
    flagged: tuple[int, ...] = ()
    """Samples, from 0, that no model of the set explains with noise within its bound: then nothing is promised."""

    @property
    def inputs(self) -> Array:
        """T x n_u."""
        return np.array([action.input for action in self.actions])

    @property
    def modes(self) -> list[int]:
        """The mode of every step."""
        return [action.mode for action in self.actions]

    def cost(self, Q: Array, R: Array) -> float:  # noqa: N803  # the thesis's letters
        """Sum of |x|_Q^2 + |u|_R^2 over the run, without its last state.

        Parameters
        ----------
        Q, R
            The weights: n_x x n_x, n_u x n_u.
        """
        past = self.states[:-1]
        return float(np.einsum("ki,ij,kj->", past, Q, past) + np.einsum("ki,ij,kj->", self.inputs, R, self.inputs))


def close_loop(plant: Plant, controller: Trimodal, start: Array, steps: int) -> ClosedLoop:
    """Close the loop for `steps` samples.

    Parameters
    ----------
    plant
        The unknown system.
    controller
        After its preparation; it learns on.
    start
        x_0, n_x.
    steps
        Number of samples.
    """
    states, actions = [np.asarray(start, float)], []
    for _ in range(steps):
        action = controller.decide(states[-1])
        following = np.asarray(plant(states[-1], action.input), float)
        controller.observe(states[-1], action.input, following)
        states.append(following)
        actions.append(action)
    return ClosedLoop(np.array(states), actions, tuple(controller.monitor.flagged))


def shifted_cost(action: Action, successor: Array) -> float:
    """The cost of the plan, shifted by a step, from the state reached: an upper bound of the next plan's cost.

    Parameters
    ----------
    action
        One of mode 1 or 2, with its plan.
    successor
        The state that it led to, n_x.

    Raises
    ------
    IllPosedError
        Mode 3 has no plan.
    """
    if action.plan is None or action.program is None:
        raise IllPosedError("action", "mode 3 has no plan")
    rest, regulator = action.plan.input_perturbations[1:], action.program.regulator
    return float(successor @ regulator.cost @ successor + np.einsum("iu,uv,iv->", rest, regulator.stage, rest))
