"""Dynamic mode decomposition with control: a linear model from the last m samples (Eqs. (5.3), (5.4))."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from theory.arrays import Array
from theory.errors import RankError
from theory.tubes.models import LinearModel, units_of
from theory.validation import check_integer, finite_array

RELATIVE_TOLERANCE = 1e-8
"""Singular values below this part of the largest count as rounding."""


@dataclass(frozen=True)
class IdentifiedModel:
    """A model read off data, and how far the data carry it."""

    model: LinearModel
    rank: int
    """Singular values kept."""
    singular_values: Array
    """Those of the data matrix Theta, each state and input in units of its largest entry: n_x + n_u, largest first."""
    residual: float
    """Largest entry of |X' - A X - B Y|."""

    @property
    def full_rank(self) -> bool:
        """Whether the data determine the whole model; if not, it is the one of least norm."""
        return self.rank == len(self.singular_values)

    @property
    def condition(self) -> float:
        """Largest over smallest singular value kept: how much noise is amplified in the weakest direction."""
        return float(self.singular_values[0] / self.singular_values[self.rank - 1])


def regress(states: Array, inputs: Array, successors: Array, rank: int | None = None) -> IdentifiedModel:
    """[A B] = X' Theta^+, by a truncated singular value decomposition (Eq. (5.3); snapshots step by one).

    Parameters
    ----------
    states, inputs, successors
        m x n_x, m x n_u, m x n_x: x(k), u(k), x(k+1), a row a sample.
    rank
        Singular values to keep; by default all above rounding.

    Raises
    ------
    IllPosedError
        Arrays that do not fit, entries that are not finite, or a rank outside 1..n_x + n_u.
    RankError
        Nothing but zeros.
    """
    states = finite_array("states", states, (None, None))
    successors = finite_array("successors", successors, states.shape)
    theta = np.hstack([states, finite_array("inputs", inputs, (len(states), None))])
    units = units_of(theta)
    left, values, right = np.linalg.svd((theta / units).T, full_matrices=False)
    values = np.append(values, np.zeros(theta.shape[1] - len(values)))
    there = int((values > RELATIVE_TOLERANCE * values[0]).sum()) if values[0] > 0 else 0
    if not there:
        raise RankError("samples", "all samples are zero: excite the system")
    if rank is not None:
        check_integer("rank", rank, 1, theta.shape[1])
    kept = min(there, rank or there)
    joined = successors.T @ right[:kept].T @ np.diag(1 / values[:kept]) @ left[:, :kept].T / units
    model = LinearModel(joined[:, : states.shape[1]], joined[:, states.shape[1] :])
    return IdentifiedModel(model, kept, values, float(np.abs(successors - theta @ joined.T).max()))


class Window:
    """The last `length` samples (x(k), u(k), x(k+1)) of a running system."""

    def __init__(self, length: int) -> None:
        check_integer("length", length, 1, 1_000_000)
        self._samples: deque[tuple[Array, Array, Array]] = deque(maxlen=length)

    def push(self, state: Array, action: Array, successor: Array) -> None:
        """Take in a sample; the oldest leaves when the window is full.

        Parameters
        ----------
        state, action, successor
            x(k), u(k), x(k+1): n_x, n_u, n_x.
        """
        self._samples.append((np.array(state, float), np.array(action, float), np.array(successor, float)))

    def __len__(self) -> int:
        return len(self._samples)

    def arrays(self) -> tuple[Array, Array, Array]:
        """States, inputs and successors, a row a sample."""
        if not self._samples:
            raise RankError("samples", "none yet: let the system run first")
        states, inputs, successors = zip(*self._samples, strict=True)
        return np.array(states), np.array(inputs), np.array(successors)

    def estimate(self, rank: int | None = None) -> IdentifiedModel:
        """The model of the samples held; see `regress`."""
        return regress(*self.arrays(), rank)
