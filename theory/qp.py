"""Convex quadratic programs, small and dense: a dual active-set method (DAQP). Only here is it known.

Answers are exact to rounding where the Hessian is positive definite, unlike those of an interior-point method, and come
in tens of microseconds. What the solver calls optimal is believed only after feasibility and stationarity are recomputed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import daqp
import numpy as np

from theory.errors import InfeasibleError, SolverError
from theory.system import Array

FEASIBILITY: Final = 1e-9
"""What a row may be exceeded by, relative to 1 + |its bound|; DAQP's own default is 1e-6."""

STATIONARITY: Final = 1e-6
"""Largest residual of the gradient of the Lagrangian, relative to the largest of its terms."""

_OPTIMAL, _INFEASIBLE = 1, -1
_NONE = 1e30


@dataclass(frozen=True)
class Optimum:
    """The minimiser of a program, its value, and the multipliers of the rows (not negative)."""

    point: Array
    value: float
    multipliers: Array


def minimize(hessian: Array, linear: Array, rows: Array, upper: Array, what: str) -> Optimum:
    """Minimise x' H x / 2 + f' x subject to rows x <= upper.

    Parameters
    ----------
    hessian, linear
        n x n, positive definite; n.
    rows, upper
        m x n; m, infinite where there is no limit.
    what
        The name of the problem in errors.

    Raises
    ------
    InfeasibleError
        No point satisfies the rows.
    SolverError
        The method ended otherwise, or its answer does not satisfy the conditions of optimality.
    """
    scale = np.linalg.norm(rows, axis=1)
    kept = np.flatnonzero((scale > 0) & np.isfinite(upper))
    if (upper[scale == 0] < 0).any():
        raise InfeasibleError("infeasible", what)
    unit, bound = rows[kept] / scale[kept, None], upper[kept] / scale[kept]
    model = daqp.Model()
    model.settings = {"primal_tol": FEASIBILITY / 10}
    sense, lowest = np.zeros(len(kept), dtype=np.int32), np.full(len(kept), -_NONE)
    started, _ = model.setup(hessian, linear, unit, bound, lowest, sense)
    if started < 0:
        raise SolverError(f"DAQP {started} at its start", what)
    point, _, flag, info = model.solve()
    if flag == _INFEASIBLE:
        raise InfeasibleError("infeasible", what)
    if flag != _OPTIMAL:
        raise SolverError(f"DAQP {flag}", what)
    duals = np.asarray(info["lam"])
    curvature = hessian @ point
    slope, force = curvature + linear, unit.T @ duals
    largest = 1.0 + max(np.abs(curvature).max(), np.abs(linear).max(), np.abs(force).max(initial=0.0))
    beyond = ((unit @ point - bound) / (1.0 + np.abs(bound))).max(initial=0.0)
    if beyond > FEASIBILITY or np.abs(slope + force).max() > STATIONARITY * largest or duals.min(initial=0.0) < 0:
        raise SolverError("an answer that is not optimal", what)
    multipliers = np.zeros(len(rows))
    multipliers[kept] = duals / scale[kept]
    return Optimum(point, float(point @ curvature / 2 + linear @ point), multipliers)
