"""Sets: corners, centres, Farkas' multipliers by look-up and by linear program."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from theory.errors import EmptySetError, IllPosedError, UnboundedError
from theory.tubes.polytope import NormalizedPolytope, Polytope, extreme, multipliers


def random_rows(seed: int, dimension: int, count: int) -> np.ndarray:
    """Rows of a bounded set around 0."""
    rng = np.random.default_rng(seed)
    return np.vstack([rng.normal(size=(count, dimension)), np.eye(dimension), -np.eye(dimension)])


def test_corners_and_centre_of_a_box_cut_by_a_plane():
    cube = Polytope.slabs(np.eye(3), np.array([1.0, 2.0, 3.0]), 0.5)
    corners = {tuple(np.round(corner, 9)) for corner in cube.vertices}
    assert corners == {(x, y, z) for x in (0.5, 1.5) for y in (1.5, 2.5) for z in (2.5, 3.5)}
    centre, radius = cube.chebyshev()
    assert np.allclose(centre, [1, 2, 3])
    assert radius == pytest.approx(0.5)
    assert cube.contains(centre)
    assert not cube.contains([1.0, 2.0, 3.6])


def test_corners_of_a_thin_set_far_from_the_origin():
    """The sets of models are thin and far from 0 in their units."""
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(20, 3)) * [10, 0.1, 1]
    middle = np.array([-1.05, 22.5, 0.1])
    found = Polytope.slabs(normals, normals @ middle, 1e-5).vertices
    slack = np.abs((found - middle) @ normals.T).max(axis=1)
    assert (slack < 1e-5 * (1 + 1e-6)).all()
    active = (np.abs(np.abs((found - middle) @ normals.T) - 1e-5) < 1e-10).sum(axis=1)
    assert (active >= 3).all()


@pytest.mark.parametrize("dimension", [1, 2, 3, 4])
@pytest.mark.parametrize("seed", range(4))
def test_the_look_up_finds_the_optimum_of_the_linear_program(dimension: int, seed: int):
    shape = NormalizedPolytope(random_rows(seed, dimension, 6))
    directions = np.random.default_rng(seed + 100).normal(size=(30, dimension))
    for gauge in (shape, shape.touching(directions[:5])):
        found = gauge.multipliers(directions)
        by_program = multipliers(gauge.rows, directions)
        assert (found >= 0).all()
        assert np.allclose(found @ gauge.rows, directions, atol=1e-9)
        assert np.allclose(by_program @ gauge.rows, directions, atol=1e-7)
        assert np.allclose(shape.multipliers(directions).sum(axis=1), by_program.sum(axis=1), rtol=1e-6)
        assert np.allclose(gauge.support(directions), by_program.sum(axis=1), rtol=1e-6)


def test_touching_rows_leave_the_set_as_it_is():
    shape = NormalizedPolytope(random_rows(1, 2, 4))
    more = shape.touching(np.random.default_rng(2).normal(size=(10, 2)))
    assert len(more.rows) > len(shape.rows)
    assert np.allclose((more.rows @ shape.corners.T).max(axis=1), 1)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6), st.integers(2, 3), st.integers(1, 40))
def test_extreme_points_span_the_hull(seed: int, dimension: int, count: int):
    rng = np.random.default_rng(seed)
    points = np.round(rng.normal(size=(count, dimension)), 1)  # with copies and flat sets
    kept = extreme(points)
    directions = rng.normal(size=(50, dimension))
    assert np.allclose((points @ directions.T).max(axis=0), (kept @ directions.T).max(axis=0))


def test_sets_without_end_or_points_are_named():
    with pytest.raises(UnboundedError, match="unbounded"):
        NormalizedPolytope(np.array([[1.0, 0.0], [-1.0, 0.0]]))
    with pytest.raises(UnboundedError, match="limit every direction"):
        NormalizedPolytope(np.array([[1.0, 0.0], [0.0, 1.0], [0.9, 0.9]]))
    with pytest.raises(UnboundedError, match="limit every direction"):
        NormalizedPolytope(np.array([[1.0], [2.0]]))
    with pytest.raises(EmptySetError, match="no point"):
        Polytope(np.array([[1.0], [-1.0]]), np.array([0.0, -1.0])).chebyshev()
    with pytest.raises(UnboundedError, match="add rows"):
        Polytope(np.array([[1.0, 0.0]]), np.array([1.0])).chebyshev()
    with pytest.raises(EmptySetError, match="radius"):
        _ = Polytope(np.array([[1.0], [-1.0]]), np.array([1.0, -1.0])).vertices
    with pytest.raises(IllPosedError, match="not finite"):
        Polytope(np.array([[np.nan]]), np.array([1.0]))
    with pytest.raises(IllPosedError, match="do not fit"):
        Polytope(np.eye(2), np.ones(3))
