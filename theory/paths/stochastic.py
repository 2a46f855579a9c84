"""Linear systems with random matrices and disturbance at every sample (Eq. (6.1)), and scenarios of their future."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from theory.arrays import Array
from theory.errors import IllPosedError


@dataclass(frozen=True)
class ScenarioSamples:
    """S futures of N steps: z+ = A z + B u + w with A of shape S x N x n x n, B S x N x n x m, w S x N x n."""

    A: Array
    B: Array
    w: Array

    def only(self, which: Any) -> ScenarioSamples:
        """Some of the futures."""
        return ScenarioSamples(self.A[which], self.B[which], self.w[which])

    def __len__(self) -> int:
        return len(self.A)

    def condensed(self, state: Array) -> tuple[Array, Array]:
        """States as functions of the inputs: N x S x n without any, and N x S x n x (N m) per input.

        Parameters
        ----------
        state
            (n,), or S x n: a start for each scenario.

        Returns
        -------
        tuple
            Free states, N x S x n, and the effect of inputs, N x S x n x (N m).
        """
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
    """A source of scenarios; its distribution need not be known."""

    @property
    def states(self) -> int:
        """Length of the state, n."""

    @property
    def inputs(self) -> int:
        """Length of the input, m."""

    def draw(self, rng: np.random.Generator, scenarios: int, steps: int) -> ScenarioSamples:
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
        fields = {}
        for name in ("A", "B", "deviation", "terms", "low", "high"):
            try:
                fields[name] = np.asarray(getattr(self, name), float)
            except (TypeError, ValueError):
                raise IllPosedError(name, "must be an array of numbers") from None
            if not np.isfinite(fields[name]).all():
                raise IllPosedError(name, "an entry is not finite")
        a, b, n = fields["A"], fields["B"], len(fields["A"]) if fields["A"].ndim else 0
        if a.shape != (n, n) or b.ndim != 2 or len(b) != n or not b.size:
            raise IllPosedError("A, B", f"must be n x n and n x m, given {a.shape} and {b.shape}")
        if fields["deviation"].shape != (n,) or (fields["deviation"] < 0).any():
            raise IllPosedError("deviation", f"must be {n} numbers of at least 0")
        count = len(fields["terms"]) if fields["terms"].ndim == 3 else -1
        if fields["terms"].shape != (count, n, n):
            raise IllPosedError("terms", f"must be terms x {n} x {n}, given {fields['terms'].shape}")
        if not fields["low"].shape == fields["high"].shape == (count,) or (fields["low"] > fields["high"]).any():
            raise IllPosedError("low, high", f"must be {count} numbers each, no low one above its high one")
        for name, value in fields.items():
            object.__setattr__(self, name, value)

    @property
    def states(self) -> int:
        """Length of the state, n."""
        return len(self.A)

    @property
    def inputs(self) -> int:
        """Length of the input, m."""
        return int(self.B.shape[1])

    def draw(self, rng: np.random.Generator, scenarios: int, steps: int) -> ScenarioSamples:
        """Independent futures."""
        theta = rng.uniform(self.low, self.high, (scenarios, steps, len(self.low)))
        matrices = self.A + np.einsum("sit,tab->siab", theta, self.terms)
        noise = rng.standard_normal((scenarios, steps, self.states)) * self.deviation
        return ScenarioSamples(matrices, np.broadcast_to(self.B, (scenarios, steps, *self.B.shape)), noise)


def random_entries(system: Uncertain) -> npt.NDArray[np.bool_] | None:
    """The entries of the next state that are random given state and input; None if the input acts at random."""
    if not isinstance(system, RandomSystem):
        return None
    moving = np.abs(system.terms[system.low < system.high]).max(axis=(0, 2), initial=0.0)
    return np.asarray((system.deviation > 0) | (moving > 0))
