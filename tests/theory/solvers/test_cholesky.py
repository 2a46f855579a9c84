"""A Cholesky factor in blocks: LAPACK's solutions for every remainder of the size, and its refusal."""

from __future__ import annotations

import numpy as np
import pytest

from theory.solvers.cholesky import BLOCK, Factor


@pytest.mark.parametrize("size", [1, 3, BLOCK - 1, BLOCK, BLOCK + 1, 3 * BLOCK, 200])
def test_solutions_are_those_of_lapack(size):
    chance = np.random.default_rng(size)
    half = chance.normal(size=(size, size))
    matrix, right = half @ half.T + np.eye(size), chance.normal(size=(size, 3))
    assert Factor(matrix).solve(right) == pytest.approx(np.linalg.solve(matrix, right), rel=1e-8, abs=1e-8)


@pytest.mark.parametrize("place", [0, 60, 99])
def test_what_is_not_positive_definite_has_no_factor(place):
    matrix = np.eye(100)
    matrix[place, place] = -1e-3
    with pytest.raises(np.linalg.LinAlgError):
        Factor(matrix)
