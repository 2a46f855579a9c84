"""Linear models x+ = A x + B u, their regulators, and the set of all models that data allow (Eq. (5.7))."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from scipy.linalg import solve_discrete_are

from theory.errors import EmptySetError, IllPosedError, RankError, TooLargeError
from theory.polytope import TOLERANCE, Polytope, extreme
from theory.system import Array

POINTS_MAX = 60_000
"""Points whose hull is taken at a time; in three dimensions some 50 ms."""

FLAT = 1e-4
"""Noise at its bound in every sample may leave a set without an inside; then the bound is raised by this part."""

EXACT_DIMENSION_MAX = 4
"""Beyond this many unknowns a row (n_x + n_u), corners multiply and a set of parallelotopes takes their place."""


@dataclass(frozen=True)
class LinearModel:
    """x+ = A x + B u; A is n_x x n_x, B is n_x x n_u."""

    A: Array
    B: Array

    def __post_init__(self) -> None:
        a, b = np.atleast_2d(np.asarray(self.A, float)), np.asarray(self.B, float)
        if a.shape[0] != a.shape[1]:
            raise IllPosedError("A", f"must be square, given {a.shape[0]} x {a.shape[1]}")
        if b.ndim != 2 or len(b) != len(a):
            raise IllPosedError("B", f"must have {len(a)} rows and a column an input, given the shape {b.shape}")
        if not (np.isfinite(a).all() and np.isfinite(b).all()):
            raise IllPosedError("A, B", "an entry is not finite")
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
        """The next state without disturbance."""
        return self.A @ state + self.B @ action


@dataclass(frozen=True)
class Regulator:
    """u = K x, the optimum of sum |x|_Q^2 + |u|_R^2 for a model, and what it costs: x' P x."""

    gain: Array  # n_u x n_x
    cost: Array  # n_x x n_x
    stage: Array  # n_u x n_u: R + B' P B, what a deviation c from u = K x adds

    @classmethod
    def of(cls, model: LinearModel, Q: Array, R: Array) -> Regulator:  # noqa: N803
        """The linear-quadratic regulator (Riccati equation, (2.12) with its sign mended).

        Raises
        ------
        IllPosedError
            Weights that do not fit or are not definite, or a model that no gain stabilises.
        """
        for name, weight, size in (("Q", Q, model.states), ("R", R, model.inputs)):
            if np.shape(weight) != (size, size) or np.abs(weight - np.transpose(weight)).max() > 1e-9:
                raise IllPosedError(name, f"must be symmetric and {size} x {size}")
        if np.linalg.eigvalsh(Q).min() < -1e-12 or np.linalg.eigvalsh(R).min() <= 0:
            raise IllPosedError("Q, R", "Q must not have a negative eigenvalue, and R only positive ones")
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

    `axes`, where given, are n_x + n_u directions along which all rows are parallelotopes; sums of such are such again.
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
        regressors = np.hstack([states, inputs])
        if not noise > 0:
            raise IllPosedError("noise", f"must be above 0, given {noise}; a set of one model is ModelSet.exact")
        rank, unknowns = int(np.linalg.matrix_rank(regressors)), regressors.shape[1]
        if rank < unknowns:
            raise RankError(
                "samples",
                f"{len(regressors)} samples span {rank} of {unknowns} directions of (x, u), the set of models has no "
                "end: add samples, vary the input, or start from another state",
            )
        rows, centres = [], []
        for r in range(states.shape[1]):
            for bound in (noise, (1 + FLAT) * noise):
                row = Polytope.slabs(regressors, successors[:, r], bound)
                try:
                    centre, radius = row.chebyshev()
                except EmptySetError:
                    continue
                if radius > TOLERANCE * float(np.ptp(successors)):
                    break
            else:
                raise EmptySetError(
                    "noise", f"no model explains state {r + 1} of the data with |w| <= {noise}: raise the bound"
                )
            rows.append(row)
            centres.append(centre)
        middle = np.array(centres)
        width = states.shape[1]
        model = LinearModel(middle[:, :width], middle[:, width:])
        if unknowns > EXACT_DIMENSION_MAX:
            return cls._parallelotopes(tuple(rows), model, regressors)
        return cls(tuple(row.vertices for row in rows), model, tuple(rows))

    @classmethod
    def _parallelotopes(cls, rows: tuple[Polytope, ...], centre: LinearModel, regressors: Array) -> ModelSet:
        """Around every row, the parallelotope along the principal directions of the data."""
        axes = np.linalg.svd(regressors, full_matrices=False)[2]
        signs = np.array(list(product((-1.0, 1.0), repeat=len(axes))))
        corners = []
        for row in rows:
            high = np.array([row.support(axis) for axis in axes])
            low = -np.array([row.support(-axis) for axis in axes])
            corners.append(((high + low) / 2 + signs * (high - low) / 2) @ axes)
        return cls(tuple(corners), centre, rows, axes)

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

    def contains(self, model: LinearModel, slack: float = 1e-9) -> bool:
        """Whether the data allow this model."""
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
        """Corners of {direction' [A B]} over the set: J x (n_x + n_u).

        An inequality on the next state, direction' x+, depends on the model through this vector only. The corners of
        the sum of n_x scaled polytopes number about as many as their corners together, while the models at the
        corners of the set are their product.
        """
        scaled = [weight * row for weight, row in zip(direction, self.corners, strict=True) if weight != 0]
        if not scaled:
            return np.zeros((1, self.states + self.inputs))
        if self.axes is not None:
            middle = sum(row.mean(axis=0) for row in scaled)
            half = sum(np.ptp(row @ self.axes.T, axis=0) for row in scaled) / 2
            signs = np.array(list(product((-1.0, 1.0), repeat=len(self.axes))))
            return np.asarray(middle + (signs * half) @ self.axes)
        total = scaled[0]
        for row in scaled[1:]:
            if len(total) * len(row) > POINTS_MAX:
                raise TooLargeError("corners of a sum of sets", len(total) * len(row), POINTS_MAX)
            total = extreme((total[:, None] + row[None]).reshape(-1, total.shape[1]))
        return total
