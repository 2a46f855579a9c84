"""The quadratic program of tube MPC (5.24), in the inputs alone: tube and terminal set enter as the cuts that bite.

For given inputs the least tube is computed by (5.13b), row by row the largest of J linear functions. A limit that it
breaks is one linear inequality in x and the inputs once the deciding corners are held, valid for all x and inputs. Few
of the exponentially many are ever active; those met are kept for the next state.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from theory.arrays import Array
from theory.errors import IllPosedError, InfeasibleError, SolverError, UnboundedError
from theory.solvers import qp
from theory.tubes.models import Regulator
from theory.tubes.tube import Tube
from theory.validation import check_integer, finite_array

VIOLATION = 1e-8
"""Largest violation of a limit (scaled to 1) in a plan."""

REACH = 1e-7
"""Relative accuracy of a search for the edge of the region of attraction."""

ROUNDS_MAX = 300
CUTS_MAX = 600
"""Cuts kept from state to state; those longest inactive leave first."""

FAR = 1e6
"""A region of attraction that reaches this many times as far as the invariant set is taken to have no edge there."""


@dataclass(frozen=True)
class Plan:
    """A solution of (5.24) at a state."""

    action: Array
    """u = K x + c_0, n_u."""
    input_perturbations: Array
    """c, N x n_u."""
    levels: Array
    """gamma, (N + 1) x n_v: the least tube."""
    terminal: Array
    """n_v: the least level from N on that never has to grow, (5.21a)."""
    cost: float
    """J of (5.22) for the regulator's model."""
    cuts: int
    rounds: int


@dataclass(frozen=True)
class _Cuts:
    """states x + inputs c <= bounds, a row a cut."""

    states: Array
    inputs: Array
    bounds: Array

    def and_(self, other: _Cuts) -> _Cuts:
        return _Cuts(
            np.vstack([self.states, other.states]),
            np.vstack([self.inputs, other.inputs]),
            np.concatenate([self.bounds, other.bounds]),
        )

    def only(self, which: Any) -> _Cuts:
        return _Cuts(self.states[which], self.inputs[which], self.bounds[which])


class TubeProgram:
    """min over c of J, such that the tube keeps the limits and ends in an invariant level.

    Parameters
    ----------
    tube
        Cross-sections, models and gain.
    regulator
        Of the nominal model; its gain must be the tube's. With s_0 = x_k the cost (5.22) is then
        x' P x + sum c_i' (R + B' P B) c_i, which solves the Lyapunov equation (5.23).
    horizon
        N, samples.
    """

    def __init__(self, tube: Tube, regulator: Regulator, horizon: int) -> None:
        check_integer("horizon", horizon, 1, 200)
        if not np.array_equal(tube.gain, regulator.gain):
            raise IllPosedError("regulator", "its gain must be the tube's")
        self.tube, self.regulator, self.horizon = tube, regulator, horizon
        self.inputs = tube.models.inputs
        width = horizon * self.inputs
        # Inputs in units of their limits, the cost in units of itself, as the solver's tolerances assume.
        reach = np.abs(tube.limits.G).max(axis=0)
        self._unit = np.tile(1.0 / np.where(reach > 0, reach, 1.0), horizon)
        hessian = self._unit[:, None] * np.kron(np.eye(horizon), regulator.stage) * self._unit
        self._hessian = np.asarray(hessian / np.abs(hessian).max(), float)
        self._pool = _Cuts(np.zeros((0, tube.models.states)), np.zeros((0, width)), np.zeros(0))
        self._idle = np.zeros(0, dtype=int)

    def plan(self, state: Array) -> Plan:
        """Solve (5.24) at a state.

        Parameters
        ----------
        state
            x, n_x.

        Returns
        -------
        Plan
            The optimum: inputs, tube and cost.

        Raises
        ------
        InfeasibleError
            No inputs keep the limits.
        SolverError
            The program is not closed after `ROUNDS_MAX` rounds of cuts.
        """
        state = finite_array("state", state, (self.tube.models.states,))
        input_perturbations, active = (
            np.zeros((self.horizon, self.inputs)),
            np.zeros(len(self._pool.bounds), dtype=bool),
        )
        zero = np.zeros(self.horizon * self.inputs)
        for rounds in range(ROUNDS_MAX):
            violated, levels, terminal = self._separate(state, input_perturbations)
            if not len(violated.bounds):
                self._forget(active)
                cost = float(state @ self.regulator.cost @ state)
                cost += float(np.einsum("iu,uv,iv->", input_perturbations, self.regulator.stage, input_perturbations))
                action = self.tube.gain @ state + input_perturbations[0]
                return Plan(action, input_perturbations, levels, terminal, cost, len(self._pool.bounds), rounds)
            self._pool = self._pool.and_(violated)
            self._idle = np.append(self._idle, np.zeros(len(violated.bounds), dtype=int))
            upper = self._pool.bounds - self._pool.states @ state
            answer = qp.minimize(self._hessian, zero, self._pool.inputs * self._unit, upper, "tube program")
            active = answer.multipliers > 0
            input_perturbations = (self._unit * answer.point).reshape(self.horizon, self.inputs)
        raise SolverError(f"not closed after {ROUNDS_MAX} rounds", "tube program")

    def reach(self, direction: Array, tolerance: float = REACH) -> float:
        """The largest multiple of a direction at which (5.24) has a solution, to a relative tolerance from below.

        That is the edge of the region of attraction.

        Parameters
        ----------
        direction
            n_x, not 0.
        tolerance
            Of the multiple, a share of it.

        Returns
        -------
        float
            The multiple, without a unit.

        Raises
        ------
        InfeasibleError
            Not even 0 has a solution.
        UnboundedError
            All states along the direction have one.
        """
        direction = finite_array("direction", direction, (self.tube.models.states,))
        if not direction.any():
            raise IllPosedError("direction", "must not be 0")
        self.plan(0 * direction)
        face = float((self.tube.shape.rows @ direction).max())  # in units of the invariant set
        low, high = 0.0, 1.0 / face
        while self.solvable(high * direction):
            low, high = high, 2 * high
            if high * face > FAR:
                raise UnboundedError("direction", "every state along it belongs to the region of attraction")
        while high - low > tolerance * high:
            middle = (low + high) / 2
            low, high = (middle, high) if self.solvable(middle * direction) else (low, middle)
        return low

    def solvable(self, state: Array) -> bool:
        """Whether (5.24) has a solution at a state.

        Parameters
        ----------
        state
            x, n_x.
        """
        try:
            self.plan(state)
        except InfeasibleError:
            return False
        return True

    def _forget(self, active: Array) -> None:
        """Count for how many states a cut was not active, and drop those longest idle beyond the limit."""
        if len(active) != len(self._idle):
            return
        self._idle = np.where(active, 0, self._idle + 1)
        if len(self._idle) > CUTS_MAX:
            kept = np.sort(np.argsort(self._idle, kind="stable")[: CUTS_MAX // 2])
            self._pool, self._idle = self._pool.only(kept), self._idle[kept]

    def _separate(self, state: Array, input_perturbations: Array) -> tuple[_Cuts, Array, Array]:
        """The least tube of these inputs, and a cut for every limit that it breaks."""
        tube, horizon = self.tube, self.horizon
        levels, deciding = [tube.shape.rows @ state], []
        for perturbation in input_perturbations:
            level, worst = tube.next_level(levels[-1], perturbation)
            levels.append(level)
            deciding.append(worst)
        terminal, unrolled, offset = tube.settle(levels[-1])
        # Rows so far: their coefficients on the level at hand, on the inputs, and their constants.
        broken = np.flatnonzero(tube.limiting @ terminal > 1 + VIOLATION)
        onto = tube.limiting[broken] @ unrolled
        inputs = np.zeros((len(broken), horizon, self.inputs))
        constants = tube.limiting[broken] @ offset
        every = np.arange(len(terminal))
        for i in reversed(range(horizon)):
            chosen = deciding[i]
            constants = constants + onto @ tube.disturbance_support
            inputs[:, i] += onto @ tube.pushes[every, chosen]
            onto = onto @ tube.steps[every, chosen]
            broken = np.flatnonzero(tube.limiting @ levels[i] + tube.limits.G @ input_perturbations[i] > 1 + VIOLATION)
            if len(broken):
                here = np.zeros((len(broken), horizon, self.inputs))
                here[:, i] = tube.limits.G[broken]
                onto, inputs = np.vstack([onto, tube.limiting[broken]]), np.concatenate([inputs, here])
                constants = np.append(constants, np.zeros(len(broken)))
        cuts = _Cuts(onto @ tube.shape.rows, inputs.reshape(len(onto), horizon * self.inputs), 1.0 - constants)
        return cuts, np.array(levels), terminal
