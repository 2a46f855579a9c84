"""Boxes: free ones against all choices of faces, cuts against shapely, covers of polygons."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import LineString, Point, Polygon, box

from theory.errors import IllPosedError
from theory.paths.boxes import Boxes, cover, free_boxes


def as_set(boxes: Boxes) -> set[tuple[float, ...]]:
    """Corners, for comparison."""
    return {(*low, *high) for low, high in zip(boxes.low.tolist(), boxes.high.tolist(), strict=True)}


def by_faces(room: Boxes, obstacles: Boxes) -> Boxes:
    """All boxes that a choice of a face an obstacle leaves, the maximal ones of them."""
    d, lows, highs = room.dimension, [], []
    for faces in product(range(2 * d), repeat=len(obstacles)):
        low, high = room.low[0].copy(), room.high[0].copy()
        for o, face in enumerate(faces):
            c, above = divmod(face, 2)
            if above:
                low[c] = max(low[c], obstacles.high[o, c])
            else:
                high[c] = min(high[c], obstacles.low[o, c])
        if (low < high).all():  # slits of no width are no way
            lows.append(low)
            highs.append(high)
    return Boxes(np.array(lows).reshape(-1, d), np.array(highs).reshape(-1, d)).maximal()


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 3), st.integers(0, 4))
def test_free_boxes_are_those_of_all_choices_of_faces(seed: int, dimension: int, count: int):
    rng = np.random.default_rng(seed)
    room = Boxes(np.zeros((1, dimension)), np.full((1, dimension), 10.0))
    low = rng.integers(-1, 9, (count, dimension)).astype(float)  # whole numbers: obstacles that touch and overlap
    obstacles = Boxes(low, low + rng.integers(1, 5, (count, dimension)))
    assert as_set(free_boxes(room, obstacles)) == as_set(by_faces(room, obstacles))


@settings(max_examples=100, deadline=None)
@given(st.lists(st.integers(-3, 6), min_size=4, max_size=4))
def test_lines_cut_boxes_as_shapely_says(ends: list[int]):
    start, end = np.array(ends[:2], float), np.array(ends[2:], float)
    area = box(0, 0, 3, 2)
    line = LineString([start, end]) if (start != end).any() else Point(start)
    expected = area.relate_pattern(line, "T********")  # the interiors meet
    assert bool(Boxes.of(((0, 0), (3, 2))).cut_by(start, end)[0]) == expected


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6), st.integers(3, 9), st.integers(1, 12))
def test_covers_hold_the_polygon_and_shrink_with_pieces(seed: int, corners: int, pieces: int):
    rng = np.random.default_rng(seed)
    angles = np.sort(rng.uniform(0, 2 * np.pi, corners))
    outline = np.column_stack([np.cos(angles), np.sin(angles)]) * rng.uniform(0.3, 1, (corners, 1))
    shape = Polygon(outline)
    if not shape.is_valid or shape.area < 1e-3:
        return
    found = cover(outline.tolist(), pieces)
    whole = box(*found.low[0], *found.high[0])
    for low, high in zip(found.low, found.high, strict=True):
        whole = whole.union(box(*low, *high))
    assert shape.difference(whole).area < 1e-9
    assert whole.area <= box(*shape.bounds).area + 1e-9


def test_the_ellipse_of_section_6_4_lies_in_its_rectangle():
    angles = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    outline = np.column_stack([135 + 85 * np.cos(angles), 265 + 15 * np.sin(angles)])
    one = cover(outline.tolist())
    assert np.allclose(one.low, [[50, 250]], atol=0.01)
    assert np.allclose(one.high, [[220, 280]], atol=0.01)
    covers = [cover(outline.tolist(), pieces) for pieces in (1, 3, 10)]
    areas = [(found.high - found.low).prod(axis=1).sum() for found in covers]
    assert areas[0] > areas[1] > areas[2] > np.pi * 85 * 15


def test_bad_boxes_are_named():
    with pytest.raises(IllPosedError, match="box 2 has a low end above its high end"):
        Boxes.of(((0, 0), (1, 1)), ((2, 0), (1, 1)))
    with pytest.raises(IllPosedError, match="must be numbers"):
        Boxes(np.array([[np.nan]]), np.array([[1.0]]))
    with pytest.raises(IllPosedError, match="all of one length"):
        Boxes.of(([0, 0], [1, 1]), ([0], [1]))
    with pytest.raises(IllPosedError, match="cannot be joined"):
        Boxes.none(2).joined(Boxes.none(3))
    with pytest.raises(IllPosedError, match="distance: must be at least 0"):
        Boxes.of(((0, 0), (1, 1))).grown(-1)
    with pytest.raises(IllPosedError, match="pairs of finite numbers"):
        cover([(0, 0), (1, np.nan), (1, 1)])
    with pytest.raises(IllPosedError, match="none given"):
        Boxes.of()
    with pytest.raises(IllPosedError, match="crosses itself"):
        cover([(0, 0), (1, 1), (1, 0), (0, 1)])
    with pytest.raises(IllPosedError, match="encloses nothing"):
        cover([(0, 0), (1, 1)])
    with pytest.raises(IllPosedError, match="pieces: must be a whole number from 1 to 100"):
        cover([(0, 0), (1, 0), (1, 1)], 0)


def test_nothing_passes_between_the_slabs_of_a_cover():
    square = cover([(100, 100), (200, 100), (200, 200), (100, 200)], 4)
    free = free_boxes(Boxes.of(((0, 0), (320, 320))), square)
    assert as_set(free) == as_set(free_boxes(Boxes.of(((0, 0), (320, 320))), Boxes.of(((100, 100), (200, 200)))))
    assert square.inside(np.array([150.0, 125.0])).any()
