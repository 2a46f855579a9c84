"""The quadratic programs: optimal by their conditions, and honest where there is no optimum."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from theory.errors import InfeasibleError, SolverError
from theory.solvers import qp


@settings(max_examples=150, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 6), st.integers(0, 30), st.floats(-4, 4))
def test_an_answer_satisfies_the_conditions_of_optimality(seed: int, size: int, count: int, scale: float):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(size, size))
    hessian, linear = root @ root.T + 0.01 * np.eye(size), rng.normal(size=size) * 10**scale
    rows = rng.normal(size=(count, size))
    rows = np.vstack([rows, rows[: count // 3], np.zeros((1, size))])  # copies, and a row of nothing
    upper = rows @ rng.normal(size=size) + rng.exponential(size=len(rows)) * rng.integers(0, 2, len(rows))
    found = qp.minimize(hessian, linear, rows, upper, "test")
    slack = upper - rows @ found.point
    assert slack.min() > -1e-7
    assert (found.multipliers >= 0).all()
    residual = hessian @ found.point + linear + rows.T @ found.multipliers
    assert np.abs(residual).max() < 1e-5 * (1 + np.abs(linear).max())
    assert np.abs(found.multipliers * slack).max() < 1e-5 * (1 + np.abs(linear).max()) ** 2


def test_many_bounds_one_after_the_other_give_what_each_gives_alone():
    rng = np.random.default_rng(0)
    hessian, linear, rows = np.eye(4), rng.normal(size=4), rng.normal(size=(40, 4))
    program, solved = qp.Program(hessian, linear, rows, "test"), 0
    for _ in range(60):
        upper = rng.uniform(-0.1, 1, 40)
        try:
            alone = qp.minimize(hessian, linear, rows, upper, "test")
        except InfeasibleError:
            with pytest.raises(InfeasibleError):
                program.minimize(upper)
            continue
        assert program.minimize(upper).value == pytest.approx(alone.value, rel=1e-8)
        solved += 1
    assert 5 < solved < 60


def test_contradictions_and_numbers_that_are_none():
    eye, zero = np.eye(2), np.zeros(2)
    with pytest.raises(InfeasibleError):
        qp.minimize(eye, zero, np.array([[1.0, 0], [-1, 0]]), np.array([0.0, -1.0]), "test")
    with pytest.raises(InfeasibleError):
        qp.minimize(eye, zero, np.array([[0.0, 0], [1, 0]]), np.array([-1.0, 1.0]), "test")
    for hurt in (np.array([np.nan, 1.0]), np.array([1.0, np.nan])):
        with pytest.raises((SolverError, InfeasibleError)):
            qp.minimize(eye, zero, eye, hurt, "test")
    with pytest.raises(SolverError):
        qp.minimize(eye, np.array([np.nan, 0.0]), eye, np.ones(2), "test")


def test_rows_without_inputs_hold_up_to_rounding():
    """A cut on a limit of the state alone, with the state on that limit."""
    eye, zero = np.eye(2), np.zeros(2)
    for tiny in (0.0, 1e-17):
        found = qp.minimize(eye, zero, np.array([[tiny, 0.0], [0.0, 1.0]]), np.array([-1e-15, 1.0]), "test")
        assert np.abs(found.point).max() < 1e-9
