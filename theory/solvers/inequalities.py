"""Lyapunov inequalities along the edges of a graph as linear maps: what decreases, and its adjoint, what flows."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import sparse

from theory.arrays import Array

Indices = npt.NDArray[np.int64]


class Inequalities:
    """P_u - A' P_v A >= 0 along the edges from u to v, each with a map A of its own.

    Parameters
    ----------
    nodes
        Number N of the unknown matrices.
    source, target
        Numbers u and v of every edge.
    maps
        A, edges x n x n.
    """

    def __init__(self, nodes: int, source: Indices, target: Indices, maps: Array) -> None:
        self.nodes, self.size, self.source, self.target = nodes, maps.shape[-1], source, target
        self.maps, self.turned = maps, np.ascontiguousarray(turned(maps))
        every, ones = np.arange(len(source)), np.ones(len(source))
        self._leaving = sparse.csr_matrix((ones, (source, every)), (nodes, len(source)))
        self._arriving = sparse.csr_matrix((ones, (target, every)), (nodes, len(source)))

    def drop(self, matrices: Array) -> Array:
        """P_u - A' P_v A of every edge.

        Parameters
        ----------
        matrices
            P, N x n x n.

        Returns
        -------
        Array
            Edges x n x n.
        """
        return matrices[self.source] - self.turned @ matrices[self.target] @ self.maps

    def summed(self, leaving: Array, arriving: Array) -> Array:
        """The sum of the first over the edges from every node, and of the second over those to it.

        Parameters
        ----------
        leaving, arriving
            Edges x n x n.

        Returns
        -------
        Array
            N x n x n.
        """
        sums: Array = self._leaving @ _rows(leaving) + self._arriving @ _rows(arriving)
        return sums.reshape(self.nodes, self.size, self.size)

    def balance(self, flows: Array) -> Array:
        """Z leaving less A Z A' arriving at every node: the adjoint of `drop`.

        Parameters
        ----------
        flows
            Z, edges x n x n.

        Returns
        -------
        Array
            N x n x n.
        """
        return self.summed(flows, -self.maps @ flows @ self.turned)

    def where(self, start: Array) -> tuple[Inequalities, Array]:
        """The same in coordinates of every node in which a matrix is I, and the way back to those of before.

        Parameters
        ----------
        start
            Positive definite matrices, N x n x n.

        Returns
        -------
        tuple
            The inequalities, and factors C, N x n x n, for which P there is C P C' here, and I is `start`.

        Raises
        ------
        LinAlgError
            A matrix is not positive definite.
        """
        back = factors(start)
        maps = turned(back)[self.target] @ self.maps @ turned(inverses(back))[self.source]
        return Inequalities(self.nodes, self.source, self.target, maps), back


def factors(matrices: Array) -> Array:
    """Lower Cholesky factors.

    Parameters
    ----------
    matrices
        Count x n x n.

    Raises
    ------
    LinAlgError
        A matrix is not positive definite.
    """
    return np.linalg.cholesky(matrices).astype(np.float64, copy=False)


def inverses(matrices: Array) -> Array:
    """Inverse matrices.

    Parameters
    ----------
    matrices
        Count x n x n.
    """
    return np.linalg.inv(matrices).astype(np.float64, copy=False)


def turned(matrices: Array) -> Array:
    """Transposed matrices, without a copy.

    Parameters
    ----------
    matrices
        Count x n x n.
    """
    return np.swapaxes(matrices, 1, 2)


def _rows(matrices: Array) -> Array:
    return matrices.reshape(len(matrices), -1)
