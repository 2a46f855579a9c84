"""The linear system of an interior-point step for Lyapunov inequalities: by conjugate gradients, or factorised.

    at every node u: (sum of W dS W leaving) - (sum of A W dS W A' arriving) + V dP_u V + dy I = R_u
    dS = dP_u - A' dP_v A - dt I at every edge, sum of trace W dS W = 0, sum of trace dP = 0

A product with its matrix is six products of n x n matrices an edge. To factorise it takes (N n^2)^3 / 24
multiplications, which is less where matrices are few and the system is near to singular. Either way coordinates of
every node are those in which the sum of all metrics there is I, since metrics become large and small together.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from theory.arrays import Array
from theory.solvers.cholesky import Factor
from theory.solvers.inequalities import Inequalities, factors, inverses, turned

RESIDUAL = 1e-3
"""Residual of a system, relative and in the norm of its preconditioner: what is left delays the next point."""

PRODUCTS = 1000
"""Products with the matrix of a system, at most."""

UNKNOWN = 2500
"""Unknowns of a system that is factorised, at most."""


class NormalEquations:
    """A system for the steps dP, N x n x n, and dy.

    Parameters
    ----------
    problem
        The inequalities.
    edges, nodes
        The metrics W, edges x n x n, and V, N x n x n.

    Raises
    ------
    LinAlgError
        A sum of metrics is not positive definite.
    """

    def __init__(self, problem: Inequalities, edges: Array, nodes: Array) -> None:
        self.problem, self.edges, self.nodes, self.products = problem, edges, nodes, 0
        self.tilt, self.weight = problem.balance(edges @ edges), inner(edges, edges)
        self._out, self._turned = problem.maps @ edges, np.ascontiguousarray(edges @ problem.turned)
        self._through = self._out @ problem.turned
        every = problem.summed(edges, self._through) + nodes
        self._back = turned(inverses(factors(every)))
        self._inverse = self._back @ turned(self._back)
        self._plain, self._identity = self._inverse @ self._inverse, np.eye(problem.size)

    def iterated(self, right: Array, guess: Array) -> tuple[Array, float]:
        """The steps by conjugate gradients among matrices of no trace (Gould, Hribar and Nocedal 2001).

        Parameters
        ----------
        right
            R, N x n x n.
        guess
            A step from which to begin, N x n x n.

        Returns
        -------
        tuple
            The step dP, N x n x n, and dy.
        """
        found, (left, ahead, level) = guess, self._split(right - self._times(guess))
        size, enough = inner(left, ahead), RESIDUAL**2 * inner(right, self._split(right)[1])
        for _ in range(PRODUCTS):
            if size <= enough:
                break
            image = self._times(ahead)
            curvature = inner(ahead, image)
            if curvature <= 0:  # nothing is left but rounding
                break
            found = found + (size / curvature) * ahead
            left, conditioned, share = self._split(left - (size / curvature) * image)
            level += share
            size, before = inner(left, conditioned), size
            ahead = conditioned + (size / before) * ahead
        return found, level

    def factorised(self, right: Array) -> tuple[Array, float]:
        """The steps by a Cholesky factor, which is kept for other right-hand sides.

        Parameters
        ----------
        right
            R, N x n x n.

        Returns
        -------
        tuple
            The step dP, N x n x n, and dy.

        Raises
        ------
        LinAlgError
            The matrix is not positive definite.
        """
        back, (factor, tilt, trace) = self._back, self._factor
        columns = np.stack([_packed(turned(back) @ right @ back).ravel(), tilt, trace], axis=1)
        one, two, three = factor.solve(columns).T
        share, level = np.linalg.solve(
            [[self.weight - tilt @ two, tilt @ three], [-(trace @ two), trace @ three]], [tilt @ one, trace @ one]
        )
        found = _unpacked((one + share * two - level * three).reshape(len(right), -1), self.problem.size)
        return back @ found @ turned(back), float(level)

    @property
    def worth(self) -> float:
        """Products with the matrix in the time that it takes to factorise it; infinite where it is too large."""
        unknown = self.problem.nodes * self.problem.size * (self.problem.size + 1) // 2
        return 30 + unknown**2 / 5000 if unknown <= UNKNOWN else np.inf

    @cached_property
    def _factor(self) -> tuple[Factor, Array, Array]:
        """The factor of the matrix without its part of rank 1, that part's vector, and the traces of the unknowns."""
        problem, count = self.problem, self.problem.nodes
        source, target, every = problem.source, problem.target, np.arange(count)
        tall = problem.size * (problem.size + 1) // 2
        back, ahead = self._back, turned(self._back)
        blocks = np.zeros((count, count, tall, tall))
        np.add.at(blocks, (source, source), _congruences(ahead[source] @ self.edges @ back[source]))
        np.add.at(blocks, (target, target), _congruences(ahead[target] @ self._through @ back[target]))
        np.add.at(blocks, (every, every), _congruences(ahead @ self.nodes @ back))
        mixed = _congruences(ahead[target] @ self._out @ back[source])
        np.add.at(blocks, (source, target), -mixed)
        np.add.at(blocks, (target, source), -turned(mixed))
        factor = Factor(blocks.transpose(0, 2, 1, 3).reshape(count * tall, count * tall))
        return factor, _packed(ahead @ self.tilt @ back).ravel(), _packed(ahead @ back).ravel()

    def _times(self, step: Array) -> Array:
        """The matrix times dP, after dt was eliminated."""
        self.products += 1
        drop = self.problem.drop(step)
        image = self.problem.summed(self.edges @ drop @ self.edges, -self._out @ drop @ self._turned)
        return image + self.nodes @ step @ self.nodes - (inner(self.tilt, step) / self.weight) * self.tilt

    def _split(self, left: Array) -> tuple[Array, Array, float]:
        """A residual without its part along I, its image under K^-1 R K^-1, of no trace, and that part.

        K is the sum of all metrics at a node. Taken out of every residual, the part cannot grow with rounding.
        """
        through = self._inverse @ left @ self._inverse
        share = trace_of(through) / trace_of(self._plain)
        return left - share * self._identity, through - share * self._plain, share


def trace_of(matrices: Array) -> float:
    """The sum of all traces.

    Parameters
    ----------
    matrices
        Count x n x n.
    """
    return float(np.trace(matrices, axis1=1, axis2=2).sum())


def inner(one: Array, two: Array) -> float:
    """The sum of the products of all entries.

    Parameters
    ----------
    one, two
        Of one shape.
    """
    return float(np.vdot(one, two))


def _scales(size: int) -> Array:
    rows, columns = np.triu_indices(size)
    return np.where(rows == columns, 1.0, np.sqrt(2.0))


def _packed(matrices: Array) -> Array:
    """Upper triangles with sqrt(2) off the diagonal, so that products of entries are kept."""
    rows, columns = np.triu_indices(matrices.shape[-1])
    return (matrices[:, rows, columns] + matrices[:, columns, rows]) / 2 * _scales(matrices.shape[-1])


def _unpacked(triangles: Array, size: int) -> Array:
    rows, columns = np.triu_indices(size)
    matrices = np.empty((len(triangles), size, size))
    matrices[:, rows, columns] = matrices[:, columns, rows] = triangles / _scales(size)
    return matrices


def _congruences(factor: Array) -> Array:
    """The matrices of D -> G' D G between packed triangles."""
    rows, columns = np.triu_indices(factor.shape[-1])
    one, two = turned(factor[:, rows, :]), turned(factor[:, columns, :])
    products = one[:, rows] * two[:, columns]
    products += two[:, rows] * one[:, columns]
    scales = _scales(factor.shape[-1])
    products *= scales[:, None] * (scales / 2)
    return products
