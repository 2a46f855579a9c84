"""A Cholesky factor in blocks so small that BLAS takes one thread for each.

For larger ones it begins several, which on a busy machine wait for each other a hundred times as long as they compute;
on one core nothing is lost, as block after block is multiplied at the same speed.
"""

from __future__ import annotations

import numpy as np

from theory.arrays import Array
from theory.solvers.inequalities import turned

BLOCK = 48
"""Rows of a block: products of two have 48^3 multiplications, where OpenBLAS counts 64^3 as small."""


class Factor:
    """L of a symmetric positive definite matrix L L'.

    Parameters
    ----------
    matrix
        Size x size.

    Raises
    ------
    LinAlgError
        The matrix is not positive definite.
    """

    def __init__(self, matrix: Array) -> None:
        self.size = len(matrix)
        count = -(-self.size // BLOCK)
        padded = np.eye(count * BLOCK)
        padded[: self.size, : self.size] = matrix
        self._blocks = np.ascontiguousarray(padded.reshape(count, BLOCK, count, BLOCK).transpose(0, 2, 1, 3))
        self._inverses = np.empty((count, BLOCK, BLOCK))
        for column in range(count):
            self._inverses[column] = np.linalg.inv(np.linalg.cholesky(self._blocks[column, column]))
            below = self._blocks[column + 1 :, column] @ self._inverses[column].T
            self._blocks[column + 1 :, column] = below
            across = np.ascontiguousarray(turned(below))
            for row in range(len(below)):
                self._blocks[column + 1 + row, column + 1 : column + 2 + row] -= below[row] @ across[: row + 1]

    def solve(self, right: Array) -> Array:
        """The solutions for several right-hand sides.

        Parameters
        ----------
        right
            Size x count.

        Returns
        -------
        Array
            Size x count.
        """
        count = len(self._inverses)
        columns = np.zeros((count * BLOCK, right.shape[1]))
        columns[: self.size] = right
        found = columns.reshape(count, BLOCK, -1)
        for row in range(count):
            left = found[row] - (self._blocks[row, :row] @ found[:row]).sum(axis=0)
            found[row] = self._inverses[row] @ left
        for row in reversed(range(count)):
            left = found[row] - (turned(self._blocks[row + 1 :, row]) @ found[row + 1 :]).sum(axis=0)
            found[row] = self._inverses[row].T @ left
        return found.reshape(count * BLOCK, -1)[: self.size]
