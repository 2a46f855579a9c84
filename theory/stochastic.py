"""Linear systems whose matrices and disturbance are drawn anew every sample (Eq. (6.1)), and draws of their future."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from theory.errors import IllPosedError
from theory.system import Array


@dataclass(frozen=True)
class Samples:
    """S futures of N steps: z+ = A z + B u + w with A of shape S x N x n x n, B S x N x n x m, w S x N x n."""

    A: Array
    B: Array
    w: Array

    def only(self, which: Any) -> Samples:
        """Some of the futures."""
        return Samples(self.A[which], self.B[which], self.w[which])

    def __len__(self) -> int:
        return len(self.A)

    def condensed(self, state: Array) -> tuple[Array, Array]:
        """States as functions of the inputs: N x S x n without any, and N x S x n x (N m) per input."""
        count, steps, n, m = self.B.shape
        free, pushed = np.zeros((steps, count, n)), np.zeros((steps, count, n, steps * m))
        at, by = np.broadcast_to(state, (count, n)), np.zeros((count, n, steps * m))
        for i in range(steps):
            at = (self.A[:, i] @ at[..., None])[..., 0] + self.w[:, i]
            by = self.A[:, i] @ by
            by[:, :, i * m : (i + 1) * m] += self.B[:, i]
            free[i], pushed[i] = at, by
        return free, pushed


class Uncertain(Protocol):
    """Anything that futures can be drawn from; nothing of its distribution needs to be known."""

    @property
    def states(self) -> int:
        """Length of the state, n."""

    @property
    def inputs(self) -> int:
        """Length of the input, m."""

    def draw(self, rng: np.random.Generator, scenarios: int, steps: int) -> Samples:
        """Independent futures."""


@dataclass(frozen=True)
class RandomSystem:
    """z+ = (A + sum theta_j T_j) z + B u + w: theta_j uniform in [low_j, high_j], w normal with these deviations."""

    A: Array  # n x n
    B: Array  # n x m
    deviation: Array  # n
    terms: Array  # terms x n x n
    low: Array  # terms
    high: Array  # terms

    def __post_init__(self) -> None:
        a, b = np.asarray(self.A, float), np.asarray(self.B, float)
        if a.ndim != 2 or a.shape[0] != a.shape[1] or b.ndim != 2 or len(b) != len(a):
            raise IllPosedError("A, B", f"must be n x n and n x m, given {a.shape} and {b.shape}")
        deviation = np.asarray(self.deviation, float)
        if deviation.shape != (len(a),) or (deviation < 0).any():
            raise IllPosedError("deviation", f"must be {len(a)} numbers of at least 0")
        terms, low, high = np.asarray(self.terms, float), np.asarray(self.low, float), np.asarray(self.high, float)
        terms = terms.reshape(-1, len(a), len(a))
        if not len(terms) == len(low) == len(high) or (low > high).any():
            raise IllPosedError("terms", "every term needs a low end, and a high end that is not below it")
        for name, value in zip(
            ("A", "B", "deviation", "terms", "low", "high"), (a, b, deviation, terms, low, high), strict=True
        ):
            object.__setattr__(self, name, value)

    @property
    def states(self) -> int:
        """Length of the state, n."""
        return len(self.A)

    @property
    def inputs(self) -> int:
        """Length of the input, m."""
        return int(self.B.shape[1])

    def draw(self, rng: np.random.Generator, scenarios: int, steps: int) -> Samples:
        """Independent futures."""
        theta = rng.uniform(self.low, self.high, (scenarios, steps, len(self.low)))
        matrices = self.A + np.einsum("sit,tab->siab", theta, self.terms)
        noise = rng.standard_normal((scenarios, steps, self.states)) * self.deviation
        return Samples(matrices, np.broadcast_to(self.B, (scenarios, steps, *self.B.shape)), noise)

    def after(self, rng: np.random.Generator, state: Array, action: Array) -> Array:
        """One step of the system itself."""
        drawn = self.draw(rng, 1, 1)
        return np.asarray(drawn.A[0, 0] @ state + drawn.B[0, 0] @ action + drawn.w[0, 0])
