"""Linear models x+ = A x + B u, their regulators, and the set of all models that data allow (Eq. (5.7))."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from scipy.linalg import solve_discrete_are

from theory.arrays import Array
from theory.errors import EmptySetError, IllPosedError, RankError, TooLargeError
from theory.tubes.polytope import Polytope, extreme
from theory.validation import check_weights, finite_array

POINTS_MAX = 60_000
"""Points whose hull is taken at a time; in three dimensions some 50 ms."""

FLAT = 1e-4
"""Noise at its bound in every sample may leave a set without an inside; then the bound is raised by this part."""

EXACT_DIMENSION_MAX = 3
"""Beyond this many unknowns a row (n_x + n_u), corners multiply and a set of parallelotopes takes their place."""

CONDITION_MAX = 1e9
"""Data that see a direction weaker by this than another do not see it."""


def units_of(columns: Array) -> Array:
    """The largest entry of each column, 1 for a column of zeros: data over it have no units left.

    Parameters
    ----------
    columns
        M x n, a row a sample.

    Returns
    -------
    Array
        n, above 0, in the units of the columns.
    """
    largest = np.abs(columns).max(axis=0, initial=0.0)
    return np.where(largest > 0, largest, 1.0)


@dataclass(frozen=True)
class LinearModel:
    """x+ = A x + B u; A is n_x x n_x, B is n_x x n_u."""

    A: Array
    B: Array

    def __post_init__(self) -> None:
        a = finite_array("A", self.A, (None, None))
        if a.shape[0] != a.shape[1] or not len(a):
            raise IllPosedError("A", f"must be square, given {a.shape[0]} x {a.shape[1]}")
        b = finite_array("B", self.B, (len(a), None))
        if not b.shape[1]:
            raise IllPosedError("B", "must have a column an input, given none")
        object.__setattr__(self, "A", a)
        object.__setattr__(self, "B", b)

    @property
    def states(self) -> int:
        """n_x."""
        return len(self.A)

    @property
    def inputs(self) -> int:
        """n_u."""
        return int(self.B.shape[1])

    @property
    def joined(self) -> Array:
        """Pi = [A B]."""
        return np.hstack([self.A, self.B])

    def after(self, state: Array, action: Array) -> Array:
        """The next state without disturbance.

        Parameters
        ----------
        state, action
            x, u: n_x, n_u.

        Returns
        -------
        Array
            A x + B u, n_x.
        """
        return self.A @ state + self.B @ action


@dataclass(frozen=True)
class Regulator:
    """u = K x, the optimum of sum |x|_Q^2 + |u|_R^2 for a model, and its cost x' P x."""

    gain: Array  # n_u x n_x
    cost: Array  # n_x x n_x
    stage: Array  # n_u x n_u: R + B' P B, the cost of a perturbation c of u = K x

    @classmethod
    def of(cls, model: LinearModel, Q: Array, R: Array) -> Regulator:  # noqa: N803  # the thesis's letters
        """The linear-quadratic regulator (Riccati equation, (2.12) with its sign mended).

        Parameters
        ----------
        model
            x+ = A x + B u.
        Q, R
            The weights, symmetric: n_x x n_x, positive semidefinite; n_u x n_u, positive definite.

        Returns
        -------
        Regulator
            Its gain K, n_u x n_x, stabilises the model.

        Raises
        ------
        IllPosedError
            Weights that do not fit or are not definite, or a model that no gain stabilises.
        """
        check_weights(Q, R, model.states, model.inputs)
        try:
            riccati = solve_discrete_are(model.A, model.B, Q, R)
        except (np.linalg.LinAlgError, ValueError):
            raise IllPosedError("A, B", "no gain stabilises this model at finite cost") from None
        stage = R + model.B.T @ riccati @ model.B
        gain = -np.linalg.solve(stage, model.B.T @ riccati @ model.A)
        if np.abs(np.linalg.eigvals(model.A + model.B @ gain)).max() >= 1 - 1e-9:
            raise IllPosedError("A, B", "no gain stabilises this model at finite cost")
        return cls(gain, (riccati + riccati.T) / 2, stage)


@dataclass(frozen=True)
class ModelSet:
    """All models whose row r lies in the hull of `corners[r]`, for every r: a product, since the noise is a box.

    `axes`, where given, are the n_x + n_u normals of the faces of all rows, which then are parallelotopes; sums of such
    are such again.
    """

    corners: tuple[Array, ...]  # per state: corners x (n_x + n_u)
    centre: LinearModel
    rows: tuple[Polytope, ...] = ()
    axes: Array | None = None

    @classmethod
    def exact(cls, model: LinearModel) -> ModelSet:
        """The set of one model, for a controller that knows it."""
        return cls(tuple(row[None] for row in model.joined), model)

    @classmethod
    def from_data(cls, states: Array, inputs: Array, successors: Array, noise: float) -> ModelSet:
        """All models that explain every sample with |w|_inf <= noise (Eq. (5.7) over *all* data), a polytope a row.

        Parameters
        ----------
        states, inputs, successors
            M x n_x, M x n_u, M x n_x.
        noise
            Bound of every entry of the disturbance, above 0.

        Raises
        ------
        RankError
            The samples do not span states and inputs, so that the set has no end.
        EmptySetError
            No model explains the data.
        """
        states, inputs = finite_array("states", states, (None, None)), finite_array("inputs", inputs, (None, None))
        successors = finite_array("successors", successors, states.shape)
        if len(inputs) != len(states):
            raise IllPosedError("inputs", f"must be {len(states)} samples like the states, given {len(inputs)}")
        if not 0 < noise < np.inf:
            raise IllPosedError("noise", f"must be finite and above 0, given {noise}; for one model: ModelSet.exact")
        data = _Data.of(np.hstack([states, inputs]))
        rows, corners, centres = [], [], []
        for r in range(states.shape[1]):
            try:
                row = data.allowed(successors[:, r], noise)
            except EmptySetError:
                first = _unexplained(data.regressors / noise, successors[:, r] / noise)
                raise EmptySetError(
                    "noise",
                    f"no model explains state {r + 1} of the data with |w| <= {noise}, beginning with sample {first}: "
                    "raise the bound, or look for what changed the system",
                ) from None
            rows.append(Polytope.slabs(data.regressors / noise, successors[:, r] / noise, 1.0))
            centres.append(data.centre(row, noise))
            exact = len(data.values) <= EXACT_DIMENSION_MAX
            corners.append(data.back(row.vertices if exact else _box_around(row), row, noise))
        middle, width = np.array(centres), states.shape[1]
        model = LinearModel(middle[:, :width], middle[:, width:])
        return cls(tuple(corners), model, tuple(rows), None if exact else data.values[:, None] * data.turn * data.units)

    @property
    def states(self) -> int:
        """n_x."""
        return self.centre.states

    @property
    def inputs(self) -> int:
        """n_u."""
        return self.centre.inputs

    @property
    def size(self) -> int:
        """Number of vertex models: the product of the corners of all rows."""
        return int(np.prod([len(row) for row in self.corners], dtype=object))

    @cached_property
    def width(self) -> float:
        """Largest extent of an entry of [A B]."""
        return max(float(np.ptp(row, axis=0).max()) for row in self.corners)

    def contains(self, model: LinearModel, slack: float = 1e-6) -> bool:
        """Whether the data allow this model; `slack` is a part of the noise."""
        if not self.rows:
            return bool(np.abs(model.joined - self.centre.joined).max() <= slack)
        return all(bool(row.contains(entry, slack)) for row, entry in zip(self.rows, model.joined, strict=True))

    def vertex_models(self, limit: int = 100_000) -> list[LinearModel]:
        """Every combination of corners; raises `TooLargeError` beyond the limit."""
        if self.size > limit:
            raise TooLargeError("vertex models", self.size, limit)
        return [
            LinearModel(np.array(rows)[:, : self.states], np.array(rows)[:, self.states :])
            for rows in product(*self.corners)
        ]

    def image(self, direction: Array) -> Array:
        """Corners of {direction' [A B]} over the set: an inequality on direction' x+ depends on the model through this.

        The corners of the sum of n_x scaled polytopes number about as many as their corners together, while the models
        at the corners of the set are their product.

        Parameters
        ----------
        direction
            n_x.

        Returns
        -------
        Array
            J x (n_x + n_u), a corner a row.

        Raises
        ------
        TooLargeError
            The sum of two rows' sets has more than `POINTS_MAX` candidates for corners.
        """
        scaled = [weight * row for weight, row in zip(direction, self.corners, strict=True) if weight != 0]
        if not scaled:
            return np.zeros((1, self.states + self.inputs))
        if self.axes is not None:
            middle = sum(row.mean(axis=0) for row in scaled)
            half = sum(np.ptp(row @ self.axes.T, axis=0) for row in scaled) / 2
            signs = np.array(list(product((-1.0, 1.0), repeat=len(self.axes))))
            return np.asarray(middle + np.linalg.solve(self.axes, (signs * half).T).T)
        total = scaled[0]
        for row in scaled[1:]:
            if len(total) * len(row) > POINTS_MAX:
                raise TooLargeError("corners of a sum of sets", len(total) * len(row), POINTS_MAX)
            total = extreme((total[:, None] + row[None]).reshape(-1, total.shape[1]))
        return total


@dataclass(frozen=True)
class _Data:
    """Regressors theta = U diag(values) turn diag(units), a row a sample: sets of models are well scaled in q.

    For a row pi of [A B] with least-squares solution pi_0, q = diag(values) turn diag(units) (pi - pi_0) / noise, and a
    sample says |residual / noise - U q| <= 1. Units are the largest entries of the columns.
    """

    regressors: Array
    units: Array
    left: Array
    values: Array
    turn: Array

    @classmethod
    def of(cls, regressors: Array) -> _Data:
        unknowns = regressors.shape[1]
        units = units_of(regressors)
        left, values, turn = np.linalg.svd(regressors / units, full_matrices=False)
        rank = int((values > CONDITION_MAX**-1 * values.max(initial=0.0)).sum())
        if rank < unknowns:
            raise RankError(
                "samples",
                f"{len(regressors)} samples span {rank} of {unknowns} directions of (x, u), others are weaker by "
                f"{CONDITION_MAX:g} times: the set of models has no end; add samples, vary the input, start elsewhere",
            )
        return cls(regressors, units, left, values, turn)

    def allowed(self, after: Array, noise: float) -> _Row:
        """The set of a row in q, by its centre and room."""
        least = (self.left.T @ after / self.values) @ self.turn / self.units
        residual = (after - self.regressors @ least) / noise
        for bound in (1.0, 1.0 + FLAT):
            found = Polytope.slabs(self.left, residual, bound)
            try:
                _, radius = found.chebyshev()
            except EmptySetError:
                continue
            if radius > FLAT / 100:
                return _Row(found.normals, found.offsets, least)
        raise EmptySetError("noise", "no model explains the data")

    def centre(self, row: _Row, noise: float) -> Array:
        """The Chebyshev centre in the entries of [A B], which the thesis takes."""
        lengths = np.linalg.norm(self.regressors, axis=1)
        lengths = lengths / lengths.max()
        found, _ = row.chebyshev(np.concatenate([lengths, lengths]))
        return self.back(found[None], row, noise)[0]

    def back(self, points: Array, row: _Row, noise: float) -> Array:
        """Points q as rows of [A B]."""
        return np.asarray(row.least + noise * (points / self.values) @ self.turn / self.units)


@dataclass(frozen=True)
class _Row(Polytope):
    """The set of a row of [A B] in q, and the least-squares row it is measured from."""

    least: Array


def _unexplained(regressors: Array, after: Array) -> int:
    """The number, from 0, of the first sample that no model explains together with those before it."""
    explained, missed = 0, len(after)
    while missed - explained > 1:
        count = (explained + missed) // 2
        if Polytope.slabs(regressors[:count], after[:count], 1.0).least_excess()[1] > FLAT / 100:
            missed = count
        else:
            explained = count
    return missed - 1


def _box_around(row: Polytope) -> Array:
    """Corners of the box around a set."""
    eye = np.eye(row.dimension)
    high, low = np.array([row.support(axis) for axis in eye]), -np.array([row.support(-axis) for axis in eye])
    signs = np.array(list(product((-1.0, 1.0), repeat=row.dimension)))
    return np.asarray((high + low) / 2 + signs * (high - low) / 2)
