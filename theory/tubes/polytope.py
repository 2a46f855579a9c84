"""Polytopes {x : normals x <= offsets}: centres, corners, inclusion. HiGHS solves the programs, Qhull the hulls."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy import sparse
from scipy.optimize import linprog
from scipy.spatial import ConvexHull, HalfspaceIntersection, QhullError

from theory.arrays import Array
from theory.errors import EmptySetError, IllPosedError, SolverError, UnboundedError
from theory.validation import finite_array

TOLERANCE = 1e-9
"""Differences below it count as equal, relative to the size of a set."""

_FLAT = 1e-12

_AT_ONCE = 4_000_000
"""Coordinates computed at a time when multipliers are looked up [floats]."""

_LIFT = 1e-6
"""Distance by which rows that only touch a set are shifted outside when a basis is chosen."""


@dataclass(frozen=True)
class Polytope:
    """The points x with normals x <= offsets, a row a half-space."""

    normals: Array  # rows x dimension
    offsets: Array  # rows

    def __post_init__(self) -> None:
        normals, offsets = (
            np.atleast_2d(np.asarray(self.normals, float)),
            np.atleast_1d(np.asarray(self.offsets, float)),
        )
        if normals.ndim != 2 or offsets.shape != (len(normals),):
            raise IllPosedError("polytope", f"{normals.shape} normals do not fit {offsets.shape} offsets")
        if not (np.isfinite(normals).all() and np.isfinite(offsets).all()):
            raise IllPosedError("polytope", "an entry is not finite; leave out rows without a limit")
        object.__setattr__(self, "normals", normals)
        object.__setattr__(self, "offsets", offsets)

    @classmethod
    def slabs(cls, normals: Array, middles: Array, half_width: float) -> Polytope:
        """All points with |normals x - middles| <= half_width.

        Parameters
        ----------
        normals, middles
            k x n, k: a row a pair of parallel half-spaces.
        half_width
            In the units of `middles`.

        Returns
        -------
        Polytope
            2 k rows.
        """
        return cls(np.vstack([normals, -normals]), np.concatenate([middles + half_width, half_width - middles]))

    @property
    def dimension(self) -> int:
        """Length of its points."""
        return int(self.normals.shape[1])

    def contains(self, points: Array, slack: float = TOLERANCE) -> Any:
        """Whether a point, or each of many, lies in the set.

        Parameters
        ----------
        points
            n, or k x n, a point a row.
        slack
            By how much a row may be exceeded, in the units of the offsets.

        Returns
        -------
        bool or Array
            Of one point a bool, of many k of them.
        """
        return (np.asarray(points) @ self.normals.T <= self.offsets + slack).all(axis=-1)

    def chebyshev(self, lengths: Array | None = None) -> tuple[Array, float]:
        """Centre and radius of the largest ball inside (Chebyshev's).

        Parameters
        ----------
        lengths
            Lengths of the normals, one a row, in the metric of the ball; the Euclidean by default.

        Returns
        -------
        tuple
            The centre, n, and the radius.

        Raises
        ------
        EmptySetError
            No point satisfies the rows.
        UnboundedError
            Balls of any size fit.
        """
        if lengths is None:
            lengths = np.linalg.norm(self.normals, axis=1)
        cost = np.append(np.zeros(self.dimension), -1.0)
        limits = [(None, None)] * self.dimension + [(0, None)]
        found = _solve(cost, np.column_stack([self.normals, lengths]), self.offsets, limits, "largest ball inside")
        return found[:-1], float(found[-1])

    def least_excess(self) -> tuple[Array, float]:
        """The point whose largest excess over the rows is smallest, and that excess: above 0, the set is empty.

        Returns
        -------
        tuple
            The point, n, and the excess, in the units of `offsets`.
        """
        units = np.maximum(np.abs(self.normals).max(axis=0), 1e-300)
        cost = np.append(np.zeros(self.dimension), 1.0)
        rows = np.column_stack([self.normals / units, -np.ones(len(self.normals))])
        found = _solve(cost, rows, self.offsets, [(None, None)] * (self.dimension + 1), "least excess")
        return found[:-1] / units, float(found[-1])

    def support(self, direction: Array) -> float:
        """The largest value of direction' x over the set.

        Parameters
        ----------
        direction
            n.

        Returns
        -------
        float
            In the units of direction' x.

        Raises
        ------
        UnboundedError
            There is no largest value.
        EmptySetError
            No point satisfies the rows.
        """
        limits = [(None, None)] * self.dimension
        return float(direction @ _solve(-np.asarray(direction), self.normals, self.offsets, limits, "support"))

    @cached_property
    def vertices(self) -> Array:
        """Its corners, a row each. The set must be bounded and have an inside; raises `EmptySetError` else."""
        centre, radius = self.chebyshev()
        if radius <= _FLAT * (1.0 + np.abs(self.offsets).max()):
            raise EmptySetError("polytope", f"its inside has a radius of {radius:.2g} only; it has no corners to list")
        if self.dimension == 1:
            rows = self.normals[:, 0]
            bounds = self.offsets / np.where(rows == 0, 1, rows)
            return np.array([[bounds[rows < 0].max()], [bounds[rows > 0].min()]])
        room = self.offsets - self.normals @ centre
        scale = np.abs(self.normals / room[:, None]).max(axis=0)  # axes of about equal width are kinder to Qhull
        rows = np.column_stack([self.normals / scale, -room])
        try:
            found = HalfspaceIntersection(rows, np.zeros(self.dimension)).intersections / scale
        except (QhullError, ValueError):
            found = np.full((1, self.dimension), np.nan)
        if not np.isfinite(found).all():
            raise UnboundedError("polytope", "the set is unbounded: add rows that limit every direction")
        return np.asarray(centre + _distinct(found))


class NormalizedPolytope:
    """{x : V x <= 1}, bounded, with 0 inside: its corners and, for every direction, Farkas' multipliers.

    The rows of V span the polar set. Each facet of that, cut into simplices, is a corner of the set; a direction lies
    in the cone of one simplex, and its coordinates there are the multipliers of least sum: the optimal basis of the
    linear program (5.12), found without solving one.
    """

    def __init__(self, rows: Array) -> None:
        rows = finite_array("V", rows, (None, None))
        if not len(rows):
            raise UnboundedError("V", "no row limits anything: limit every direction of the state")
        if rows.shape[1] == 1:
            low, high = rows[:, 0].min(), rows[:, 0].max()
            if not low < 0 < high:
                raise UnboundedError("V", "the set {x : V x <= 1} is unbounded: limit every direction of the state")
            self.rows, self.corners = np.array([[low], [high]]), np.array([[1 / low], [1 / high]])
            self._span(self.rows, np.array([[0], [1]]))
            return
        found = _hull(rows)
        kept = np.sort(found.vertices)
        self.rows = rows[kept]
        self.corners = -found.equations[:, :-1] / found.equations[:, -1:]
        self._span(self.rows, np.searchsorted(kept, found.simplices))

    def touching(self, directions: Array) -> NormalizedPolytope:
        """The same set with further rows along `directions`, each scaled to touch it.

        They do not change the set but give a tube of this shape more faces. Multipliers prefer them where several
        bases serve, as if they lay outside by a little.

        Parameters
        ----------
        directions
            k x n, of any length.

        Returns
        -------
        NormalizedPolytope
            Its rows are the old ones and, of the new ones, those that are no others' copies.
        """
        if self.rows.shape[1] == 1 or not len(directions):
            return self
        support = self.support(directions)
        further = directions[support > TOLERANCE] / support[support > TOLERANCE, None]
        every = np.vstack([self.rows, further])
        found = _hull(np.vstack([self.rows, (1 + _LIFT) * further]))
        kept = np.union1d(found.vertices, np.arange(len(self.rows)))
        made = object.__new__(NormalizedPolytope)
        made.rows, made.corners = every[kept], self.corners
        made._span(made.rows, np.searchsorted(kept, found.simplices))
        return made

    def _span(self, rows: Array, simplices: Any) -> None:
        self._simplices = simplices
        self._inverses = np.linalg.pinv(rows[simplices])

    def support(self, directions: Array) -> Array:
        """The largest direction' x over the set, for each direction.

        Parameters
        ----------
        directions
            n, or ... x n, a direction a row.

        Returns
        -------
        Array
            The same shape without its last axis.
        """
        return np.asarray((directions @ self.corners.T).max(axis=-1))

    def multipliers(self, directions: Array) -> Array:
        """H >= 0 with H V = directions (Lemma 5.1) and, but for `_LIFT`, the least sums: the supports.

        Parameters
        ----------
        directions
            k x n.

        Returns
        -------
        Array
            H, k x n_v.
        """
        turn = np.moveaxis(self._inverses, 1, 0).reshape(directions.shape[1], -1)
        found = np.zeros((len(directions), len(self.rows)))
        some = max(1, _AT_ONCE // turn.shape[1])
        for first in range(0, len(directions), some):
            part = directions[first : first + some]
            coordinates = (part @ turn).reshape(len(part), *self._simplices.shape)
            best = coordinates.min(axis=2).argmax(axis=1)
            chosen = coordinates[np.arange(len(part)), best]
            np.put_along_axis(found[first : first + some], self._simplices[best], chosen.clip(min=0.0), axis=1)
        off = np.abs(found @ self.rows - directions).max(axis=1, initial=0.0)
        doubtful = off > TOLERANCE * (1.0 + np.abs(directions).max(axis=1, initial=0.0))
        if doubtful.any():
            found[doubtful] = multipliers(self.rows, directions[doubtful])
        return found


def _hull(rows: Array) -> ConvexHull:
    """The polar of {x : rows x <= 1}; raises `UnboundedError` unless 0 lies inside it."""
    try:
        found = ConvexHull(rows)
    except QhullError:
        raise UnboundedError("V", "the set {x : V x <= 1} is unbounded: its rows span a flat set") from None
    if (found.equations[:, -1] > -TOLERANCE * np.abs(rows).max()).any():
        raise UnboundedError("V", "the set {x : V x <= 1} is unbounded: limit every direction of the state")
    return found


def extreme(points: Array) -> Array:
    """The points that span the hull of all; flat and tiny sets keep all distinct points.

    Parameters
    ----------
    points
        k x n, a point a row.

    Returns
    -------
    Array
        Some of the rows, or in one dimension the least and the greatest.
    """
    points = _distinct(points)
    if len(points) <= points.shape[1] + 1 or points.shape[1] == 1:
        return points if points.shape[1] > 1 else np.array([points.min(axis=0), points.max(axis=0)])
    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except QhullError:
        return points


def multipliers(rows: Array, targets: Array) -> Array:
    """Farkas' multipliers (Lemma 5.1): H >= 0 with H rows = targets and the least row sums.

    Parameters
    ----------
    rows
        n_v x n, of a bounded set {x : rows x <= 1}.
    targets
        k x n.

    Returns
    -------
    Array
        k x n_v. A row's sum is the support of {x : rows x <= 1} in the direction of its target.

    Notes
    -----
    One linear program for all: they are independent, and one call costs less than many.
    """
    count, height = len(targets), len(rows)
    if not count:
        return np.zeros((0, height))
    equal = sparse.kron(sparse.eye(count), sparse.csr_matrix(rows.T), format="csr")
    found = linprog(np.ones(count * height), A_eq=equal, b_eq=targets.ravel(), bounds=(0, None), method="highs")
    if found.status == 2:
        raise UnboundedError("V", "the set {x : V x <= 1} is unbounded, so that a row is no combination of its rows")
    if found.status != 0:
        raise SolverError(found.message, "Farkas' multipliers")
    return np.asarray(found.x).reshape(count, height).clip(min=0.0)


def _distinct(points: Array) -> Array:
    """Points without copies up to rounding."""
    scale = np.ptp(points, axis=0).max(initial=0.0) or 1.0
    _, first = np.unique(np.round((points - points[:1]) / (scale * TOLERANCE)), axis=0, return_index=True)
    return np.asarray(points[np.sort(first)])


def _solve(
    cost: Array, rows: Array, upper: Array, limits: Sequence[tuple[float | None, float | None]], what: str
) -> Array:
    found = linprog(cost, A_ub=rows, b_ub=upper, bounds=limits, method="highs")
    if found.status == 2:
        raise EmptySetError("polytope", f"no point satisfies its {len(rows)} rows ({what})")
    if found.status == 3:
        raise UnboundedError("polytope", f"the set is unbounded ({what}): add rows that limit every direction")
    if found.status != 0:
        raise SolverError(found.message, what)
    return np.asarray(found.x)
