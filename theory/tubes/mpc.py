"""Predictive control of a known model, to compare with: dual-mode (2.10)-(2.12) and rigid tube (2.13)."""

from __future__ import annotations

import numpy as np

from theory.arrays import Array
from theory.errors import EmptySetError
from theory.solvers import qp
from theory.tubes.models import LinearModel, ModelSet, Regulator
from theory.tubes.polytope import NormalizedPolytope
from theory.tubes.tube import Limits, Tube, contractive_set
from theory.validation import check_integer, check_noise, finite_array


class DualMode:
    """Inputs u = K x + c for N samples, then the regulator, within its invariant set; for a system without noise.

    Parameters
    ----------
    model, limits, Q, R
        The known system, F x + G u <= 1, and the weights (n_x x n_x, n_u x n_u).
    horizon
        N, samples.
    tightening
        By how much every limit is drawn in, n_c; nothing by default.

    Raises
    ------
    EmptySetError, UnboundedError
        No invariant set keeps these limits, or they leave a direction free.
    """

    def __init__(
        self, model: LinearModel, limits: Limits, Q: Array, R: Array, horizon: int, tightening: Array | None = None  # noqa: N803  # the thesis's letters
    ) -> None:  # fmt: skip
        check_integer("horizon", horizon, 1, 200)
        limits.check(model.states, model.inputs)
        zero = np.zeros(len(limits.F))
        room = 1.0 - (zero if tightening is None else finite_array("tightening", tightening, zero.shape))
        if (room <= 0).any():
            raise EmptySetError("noise", "its tube is as wide as a limit: lower the noise or widen the limit")
        self.model, self.horizon = model, horizon
        self.limits = Limits(limits.F / room[:, None], limits.G / room[:, None])
        self.regulator = Regulator.of(model, Q, R)
        self.terminal: NormalizedPolytope = contractive_set(
            ModelSet.exact(model), self.regulator.gain, self.limits, 0.0, 1.0
        )
        self.state_rows, self.input_rows = self._rows()
        self.hessian = np.asarray(2.0 * np.kron(np.eye(horizon), self.regulator.stage), float)

    def _rows(self) -> tuple[Array, Array]:
        """All limits along the horizon and at its end: states x + inputs c <= 1."""
        loop = self.model.A + self.model.B @ self.regulator.gain
        under, width = self.limits.under(self.regulator.gain), self.model.inputs
        power, pushed = np.eye(self.model.states), np.zeros((self.model.states, self.horizon * width))
        states, inputs = [], []
        for i in range(self.horizon):
            here = under @ pushed
            here[:, i * width : (i + 1) * width] += self.limits.G
            states.append(under @ power)
            inputs.append(here)
            power, pushed = loop @ power, loop @ pushed
            pushed[:, i * width : (i + 1) * width] += self.model.B
        states.append(self.terminal.rows @ power)
        inputs.append(self.terminal.rows @ pushed)
        return np.vstack(states), np.vstack(inputs)

    def decide(self, state: Array) -> tuple[Array, float]:
        """The first input of the plan (2.10) at a state, and the cost of the plan.

        Parameters
        ----------
        state
            x, n_x.

        Returns
        -------
        tuple
            The input, n_u, and the cost.

        Raises
        ------
        InfeasibleError
            The state lies outside the region of attraction.
        """
        state = finite_array("state", state, (self.model.states,))
        bounds = 1.0 - self.state_rows @ state
        answer = qp.minimize(self.hessian, np.zeros(len(self.hessian)), self.input_rows, bounds, "dual-mode program")
        action = self.regulator.gain @ state + answer.point[: self.model.inputs]
        return action, answer.value + float(state @ self.regulator.cost @ state)


class RigidTube:
    """Dual-mode control of a nominal state s, and u = K (x - s) + v around it: x - s stays in an invariant set Z.

    Z is {z : V z <= zeta} with the least zeta that the noise allows; V comes from the contractive set of the limits.
    """

    def __init__(
        self, model: LinearModel, limits: Limits, noise: float, Q: Array, R: Array, horizon: int,  # noqa: N803  # the thesis's letters
        contraction: float = 0.95,
    ) -> None:  # fmt: skip
        check_noise(noise)
        limits.check(model.states, model.inputs)
        models, gain = ModelSet.exact(model), Regulator.of(model, Q, R).gain
        tube = Tube(contractive_set(models, gain, limits, noise, contraction), models, gain, limits, noise)
        self.level, _, _ = tube.settle(np.full(len(tube.shape.rows), -1.0))
        self.shape = tube.shape.rows
        self.nominal = DualMode(model, limits, Q, R, horizon, tightening=tube.limiting @ self.level)
        width, count = model.states, model.states + horizon * model.inputs
        self._hessian = np.zeros((count, count))
        self._hessian[:width, :width] = 2 * self.nominal.regulator.cost
        self._hessian[width:, width:] = self.nominal.hessian
        near = np.hstack([-self.shape, np.zeros((len(self.shape), count - width))])
        self._rows = np.vstack([np.hstack([self.nominal.state_rows, self.nominal.input_rows]), near])

    def decide(self, state: Array) -> tuple[Array, float]:
        """The first input of the plan (2.13) at a state, and the cost of the nominal plan.

        Parameters
        ----------
        state
            x, n_x; the nominal state is chosen with the plan.

        Returns
        -------
        tuple
            The input, n_u, and the cost.

        Raises
        ------
        InfeasibleError
            The state lies outside the region of attraction.
        """
        width = self.nominal.model.states
        state = finite_array("state", state, (width,))
        bounds = np.concatenate([np.ones(len(self._rows) - len(self.shape)), self.level - self.shape @ state])
        linear = np.zeros(len(self._hessian))
        answer = qp.minimize(self._hessian, linear, self._rows, bounds, "rigid tube program")
        perturbation = answer.point[width : width + self.nominal.model.inputs]
        return self.nominal.regulator.gain @ state + perturbation, answer.value
