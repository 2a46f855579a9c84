"""Linear programs by HiGHS's interior-point method, stopped before it looks for a corner.

What comes out is a proposal near the optimum, and nobody relies on it. Crossover would take most of the time and give
nothing.
"""

from __future__ import annotations

import highspy
import numpy as np
from scipy.sparse import csr_matrix

from station.bounds.spline import Floats

TOLERANCE = 1e-5

_SOLVED = (highspy.HighsModelStatus.kOptimal, highspy.HighsModelStatus.kUnknown)


class _Silent(highspy.Highs):
    """HiGHS without a word: its constructor enables callbacks, which prints a banner unless output is off before."""

    def enableCallbacks(self) -> None:  # noqa: N802  # its name
        self.setOptionValue("output_flag", False)
        super().enableCallbacks()  # type: ignore[no-untyped-call]  # its stubs have none


def nearly_least(cost: Floats, matrix: csr_matrix, most: Floats, low: Floats, high: Floats) -> Floats | None:
    """A vector x of (nearly) the least `cost . x` with `matrix x <= most` and `low <= x <= high`; None if none came."""
    program = highspy.HighsLp()
    program.num_col_, program.num_row_ = len(cost), len(most)
    program.col_cost_, program.col_lower_, program.col_upper_ = cost, low, high
    program.row_lower_, program.row_upper_ = np.full(len(most), -highspy.kHighsInf), most
    program.a_matrix_.format_ = highspy.MatrixFormat.kRowwise
    program.a_matrix_.start_, program.a_matrix_.index_ = matrix.indptr, matrix.indices
    program.a_matrix_.value_ = matrix.data
    solver = _Silent()  # type: ignore[no-untyped-call]
    solver.setOptionValue("output_flag", False)
    solver.setOptionValue("solver", "ipm")
    solver.setOptionValue("run_crossover", "off")
    solver.setOptionValue("threads", 1)
    solver.setOptionValue("ipm_optimality_tolerance", TOLERANCE)
    solver.passModel(program)
    solver.run()
    if solver.getModelStatus() not in _SOLVED:
        return None
    found = np.array(solver.getSolution().col_value)
    return found if len(found) == len(cost) and np.all(np.isfinite(found)) else None
