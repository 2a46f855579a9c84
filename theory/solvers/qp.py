"""Convex quadratic programs, small and dense: a dual active-set method (DAQP).

Answers are exact to rounding where the Hessian is positive definite, unlike those of an interior-point method, and
come in tens of microseconds. An answer with the status optimal is accepted only after feasibility and stationarity are
recomputed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import daqp
import numpy as np
from scipy.optimize import linprog

from theory.arrays import Array
from theory.errors import InfeasibleError, SolverError

FEASIBILITY: Final = 1e-9
"""Largest violation of a row, relative to 1 + |its bound|; DAQP's own default is 1e-6."""

STATIONARITY: Final = 1e-6
"""Largest residual of the gradient of the Lagrangian, relative to the largest of its terms."""

EMPTY: Final = 1e-13
"""Rows shorter than this part of the longest are empty: they hold or not, whatever the point."""

_OPTIMAL, _INFEASIBLE = 1, -1
_STUCK = (-2, -4)
_FINE = 1e3
"""Factor of the rows in the linear program, whose own tolerance is 1e-7."""

_NONE = 1e30


@dataclass(frozen=True)
class Optimum:
    """The minimiser of a program, its value, and the multipliers of the rows (not negative)."""

    point: Array
    value: float
    multipliers: Array


class Program:
    """min x' H x / 2 + f' x subject to rows x <= upper, for many `upper`.

    Parameters
    ----------
    hessian, linear
        n x n, positive definite; n.
    rows
        m x n.
    what
        The name of the problem in errors.
    """

    def __init__(self, hessian: Array, linear: Array, rows: Array, what: str) -> None:
        self.hessian, self.linear, self.what = hessian, linear, what
        self._length = np.linalg.norm(rows, axis=1)
        self._kept = np.flatnonzero(self._length > EMPTY * (1.0 + self._length.max(initial=0.0)))
        self._scale = self._length[self._kept]
        self._unit = np.ascontiguousarray(rows[self._kept] / self._scale[:, None])
        self._model: Any = None

    def minimize(self, upper: Array) -> Optimum:
        """Solve for one `upper` (m, infinite where there is no limit).

        Parameters
        ----------
        upper
            m, infinite where there is no limit.

        Returns
        -------
        Optimum
            The point (n,), its cost, and a multiplier for each row (m,).

        Raises
        ------
        InfeasibleError
            No point satisfies the rows.
        SolverError
            The method ended otherwise, or its answer does not satisfy the conditions of optimality.
        """
        if not (np.delete(upper, self._kept) >= -5 * FEASIBILITY).all():
            raise InfeasibleError("infeasible", self.what)
        bound = np.minimum(upper[self._kept] / self._scale, _NONE)
        point, _, flag, info = self._started(bound).solve()
        if flag == _INFEASIBLE or flag in _STUCK:  # by rounding among degenerate rows? Apart by half a tolerance:
            apart = bound + FEASIBILITY / 2 * np.linspace(1.0, 1.5, len(bound)) * (1.0 + np.abs(bound))
            point, _, flag, info = self._started(np.minimum(apart, _NONE)).solve()
            if flag in _STUCK and self._least_violation(bound) > FEASIBILITY / 2:
                flag = _INFEASIBLE
        if flag == _INFEASIBLE:
            raise InfeasibleError("infeasible", self.what)
        if flag != _OPTIMAL:
            raise SolverError(f"DAQP {flag}", self.what)
        duals = np.asarray(info["lam"])
        curvature = self.hessian @ point
        slope, force = curvature + self.linear, duals @ self._unit
        largest = 1.0 + max(np.abs(curvature).max(), np.abs(self.linear).max(), np.abs(force).max(initial=0.0))
        beyond = ((self._unit @ point - bound) / (1.0 + np.abs(bound))).max(initial=0.0)
        still = np.abs(slope + force).max() <= STATIONARITY * largest
        if not (beyond <= FEASIBILITY and still and duals.min(initial=0.0) >= 0):  # so that NaN is none
            raise SolverError("an answer that is not optimal", self.what)
        multipliers = np.zeros(len(upper))
        multipliers[self._kept] = duals / self._scale
        return Optimum(point, float(point @ curvature / 2 + self.linear @ point), multipliers)

    def _least_violation(self, bound: Array) -> float:
        """The least violation of the unit rows, relative to 1 + |bound|, by a linear program."""
        kept = bound < _NONE
        slack = -(1.0 + np.abs(bound[kept]))
        rows = _FINE * np.column_stack([self._unit[kept], slack])
        cost = np.append(np.zeros(len(self.hessian)), 1.0)
        limits = [(None, None)] * len(self.hessian) + [(-1.0, None)]
        found = linprog(cost, A_ub=rows, b_ub=_FINE * bound[kept], bounds=limits, method="highs")
        if found.status != 0:
            raise SolverError(found.message, self.what)
        return float(found.fun)

    def _started(self, bound: Array) -> Any:
        """The solver with these bounds; the factors of the Hessian and the last active set are kept."""
        if self._model is not None:
            self._model.update(bupper=bound)
            return self._model
        self._model = daqp.Model()
        self._model.settings = {"primal_tol": FEASIBILITY / 10}
        sense, lowest = np.zeros(len(bound), dtype=np.int32), np.full(len(bound), -_NONE)
        flag, _ = self._model.setup(self.hessian, self.linear, self._unit, bound, lowest, sense)
        if flag < 0:
            self._model = None
            raise (InfeasibleError("infeasible", self.what) if flag == _INFEASIBLE
                   else SolverError(f"DAQP {flag} at its start", self.what))  # fmt: skip
        return self._model


def minimize(hessian: Array, linear: Array, rows: Array, upper: Array, what: str) -> Optimum:
    """Solve a program once; see `Program`.

    Parameters
    ----------
    hessian, linear
        n x n, positive definite; n.
    rows, upper
        m x n; m, infinite where there is no limit.
    what
        The name of the problem in errors.

    Returns
    -------
    Optimum
        The point (n,), its cost, and a multiplier for each row (m,).
    """
    return Program(hessian, linear, rows, what).minimize(upper)
