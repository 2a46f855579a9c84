"""Boxes: obstacles as boxes, the maximal boxes free of them, and the lines between two samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from shapely import Polygon, box

from theory.arrays import Array
from theory.errors import IllPosedError, TooLargeError

BOXES_MAX = 5000
"""Free boxes looked at; in the plane n obstacles leave at most some n^2 maximal ones."""


SEAM = 1e-6
"""Overlap of the slabs of a covered polygon as a part of its height, so that nothing fits between them."""


def _corners(values: object) -> Array:
    try:
        return np.asarray(values, float)
    except (TypeError, ValueError):
        raise IllPosedError("boxes", "every corner must be a list of numbers, all of one length") from None


@dataclass(frozen=True)
class Boxes:
    """Closed boxes, all of one dimension: `low` and `high` are count x dimension."""

    low: Array
    high: Array

    def __post_init__(self) -> None:
        low, high = _corners(self.low), _corners(self.high)
        if low.ndim != 2 or low.shape != high.shape or np.isnan(low).any() or np.isnan(high).any():
            raise IllPosedError("boxes", f"low {low.shape} and high {high.shape} must be numbers, boxes x dimension")
        wrong = np.flatnonzero((low > high).any(axis=1))
        if len(wrong):
            raise IllPosedError("boxes", f"box {wrong[0] + 1} has a low end above its high end: swap them")
        object.__setattr__(self, "low", low)
        object.__setattr__(self, "high", high)

    @classmethod
    def of(cls, *corners: Sequence[Sequence[float]]) -> Boxes:
        """Boxes from (low, high) pairs of corners."""
        if not corners:
            raise IllPosedError("boxes", "none given; Boxes.none(dimension) has none")
        return cls(_corners([pair[0] for pair in corners]), _corners([pair[1] for pair in corners]))

    @classmethod
    def none(cls, dimension: int) -> Boxes:
        """No box at all."""
        if dimension < 1:
            raise IllPosedError("boxes", f"must have at least 1 coordinate, given {dimension}")
        return cls(np.zeros((0, dimension)), np.zeros((0, dimension)))

    def __len__(self) -> int:
        return len(self.low)

    @property
    def dimension(self) -> int:
        """Length of a corner."""
        return int(self.low.shape[1])

    def joined(self, other: Boxes) -> Boxes:
        """The boxes of both."""
        if other.dimension != self.dimension:
            raise IllPosedError("boxes", f"of {self.dimension} and {other.dimension} coordinates cannot be joined")
        return Boxes(np.vstack([self.low, other.low]), np.vstack([self.high, other.high]))

    def only(self, which: npt.NDArray[np.bool_] | npt.NDArray[np.int64]) -> Boxes:
        """Some of them.

        Parameters
        ----------
        which
            A flag for each box, or places of boxes.

        Returns
        -------
        Boxes
            As many as are chosen.
        """
        return Boxes(self.low[which], self.high[which])

    def grown(self, distance: float) -> Boxes:
        """Each larger by a distance on every side."""
        if not distance >= 0:
            raise IllPosedError("distance", f"must be at least 0, given {distance}")
        return Boxes(self.low - distance, self.high + distance)

    def distances(self, point: Array) -> Array:
        """Euclidean distance from a point to each; 0 inside.

        Parameters
        ----------
        point
            (d,), in the unit of the corners.

        Returns
        -------
        Array
            One a box, in the unit of the corners.
        """
        beyond = np.maximum(np.maximum(self.low - point, point - self.high), 0.0)
        return np.asarray(np.linalg.norm(beyond, axis=1))

    def nearest(self, point: Array) -> npt.NDArray[np.int64]:
        """Those that contain a point, or else those it lies nearest to (in the coordinate that is farthest off).

        Parameters
        ----------
        point
            (d,), in the unit of the corners.

        Returns
        -------
        Array
            Places of boxes, ascending.
        """
        beyond = np.maximum(np.maximum(self.low - point, point - self.high), 0.0).max(axis=1, initial=0.0)
        return np.flatnonzero(beyond <= beyond.min(initial=np.inf) * (1 + 1e-9))

    def containing(self, points: Array, slack: float = 0.0) -> npt.NDArray[np.bool_]:
        """Whether each box holds all points (points x dimension).

        Parameters
        ----------
        points
            points x d, in the unit of the corners.
        slack
            Distance by which points may lie outside.

        Returns
        -------
        Array
            A flag for each box.
        """
        bottom, top = points.min(axis=0), points.max(axis=0)
        return np.asarray((self.low <= bottom + slack).all(axis=1) & (self.high >= top - slack).all(axis=1))

    def inside(self, point: Array, slack: float = 0.0) -> npt.NDArray[np.bool_]:
        """Whether a point lies in the interior of each, deeper than `slack`.

        Parameters
        ----------
        point
            (d,), in the unit of the corners.
        slack
            Depth that does not count, in the same unit.

        Returns
        -------
        Array
            A flag for each box.
        """
        return np.asarray(((self.low + slack < point) & (point < self.high - slack)).all(axis=1))

    def cut_by(self, start: Array, end: Array, slack: float = 0.0) -> npt.NDArray[np.bool_]:
        """Whether the straight line between two points passes through the interior of each, deeper than `slack`.

        Parameters
        ----------
        start, end
            (d,) each, in the unit of the corners.
        slack
            Depth that does not count, in the same unit.

        Returns
        -------
        Array
            A flag for each box.
        """
        along = end - start
        low, high = self.low + slack, self.high - slack
        with np.errstate(divide="ignore", invalid="ignore"):
            one, other = (low - start) / along, (high - start) / along
        still = along == 0
        enters = np.where(still, np.where((low < start) & (start < high), -np.inf, np.inf), np.minimum(one, other))
        leaves = np.where(still, np.where((low < start) & (start < high), np.inf, -np.inf), np.maximum(one, other))
        first, last = np.maximum(enters.max(axis=1), 0.0), np.minimum(leaves.min(axis=1), 1.0)
        return np.asarray(
            ((first < last) | self.inside(start, slack) | self.inside(end, slack)) & (low < high).all(axis=1)
        )

    def maximal(self) -> Boxes:
        """Those that no other one contains; of equal ones, the first."""
        kept = []
        for i in range(len(self)):
            around = (self.low <= self.low[i]).all(axis=1) & (self.high >= self.high[i]).all(axis=1)
            same = (self.low == self.low[i]).all(axis=1) & (self.high == self.high[i]).all(axis=1)
            around &= ~same
            if not around.any() and not same[:i].any():
                kept.append(i)
        return self.only(np.array(kept, dtype=int))


def free_boxes(room: Boxes, obstacles: Boxes) -> Boxes:
    """The maximal closed boxes in a room (one box) that touch obstacles at most at their faces; none is of no width.

    Every choice of a face an obstacle (Definition 6.1) leaves a box inside one of these, and each of these comes from
    such a choice: the optimum over these boxes is the optimum over all candidate paths, of which there are far more.

    Raises
    ------
    TooLargeError
        More than `BOXES_MAX` on the way.
    """
    found, wide = room, room.low[0] < room.high[0]
    for low, high in zip(obstacles.low, obstacles.high, strict=True):
        hit = ((found.low < high) & (found.high > low)).all(axis=1)
        parts = [found.only(~hit)]
        for c in range(room.dimension):
            below, above = (
                found.only(hit & (found.low[:, c] <= low[c])),
                found.only(hit & (found.high[:, c] >= high[c])),
            )
            top, bottom = below.high.copy(), above.low.copy()
            top[:, c], bottom[:, c] = low[c], high[c]
            parts += [Boxes(below.low, top), Boxes(bottom, above.high)]
        found = Boxes(np.vstack([part.low for part in parts]), np.vstack([part.high for part in parts]))
        found = found.only(np.asarray((found.low[:, wide] < found.high[:, wide]).all(axis=1)))
        if len(found) > BOXES_MAX:
            raise TooLargeError("free boxes", len(found), BOXES_MAX)
        found = found.maximal()
    return found


def cover(corners: Sequence[Sequence[float]], pieces: int = 1) -> Boxes:
    """Boxes that cover a polygon in the plane: its bounding box, or one a slab of equal height.

    Parameters
    ----------
    corners
        In order along the outline, at least three.
    pieces
        Number of slabs; more cover more tightly.

    Raises
    ------
    IllPosedError
        The outline crosses itself or encloses nothing.
    """
    try:
        points = np.asarray(corners, float)
    except (TypeError, ValueError):
        raise IllPosedError("corners", "must be pairs of numbers") from None
    if points.ndim != 2 or points.shape[1] != 2 or not np.isfinite(points).all():
        raise IllPosedError("corners", f"must be pairs of finite numbers, given the shape {points.shape}")
    outline = Polygon(points) if len(points) >= 3 else Polygon()
    if not outline.is_valid or outline.area == 0:
        raise IllPosedError("corners", "the outline crosses itself or encloses nothing: list its corners in order")
    if not (isinstance(pieces, int) and 1 <= pieces <= 100):
        raise IllPosedError("pieces", f"must be a whole number from 1 to 100, given {pieces}")
    left, bottom, right, top = outline.bounds
    edges = np.linspace(bottom, top, pieces + 1)
    found, overlap = [], SEAM * (top - bottom)
    for low, high in pairwise(edges):
        slab = outline.intersection(box(left, low, right, high))
        if not slab.is_empty:
            west, _, east, _ = slab.bounds
            found.append(((west, max(bottom, low - overlap)), (east, min(top, high + overlap))))
    return Boxes.of(*found)
