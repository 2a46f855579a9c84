"""Whether the samples still have an explanation: a model that the data allow, with noise within its stated bound."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from theory.arrays import Array
from theory.tubes.models import ModelSet
from theory.tubes.polytope import Polytope

SLACK = 1e-6
"""Part of the noise that counts as rounding, as in `ModelSet.contains`."""

NEWEST = 300
"""Samples held besides those of the preparation; older ones are let go, which flags less, never more."""


@dataclass
class ConsistencyMonitor:
    """The samples of a running system beside the set of models: each is explained, or flagged with its number.

    A sample is explained if one model explains it together with all samples of the preparation and those held that were
    explained, with no noise beyond its bound. If the plant is constant and its noise keeps the bound, it is that model,
    and no sample is flagged. The tube holds for every model of the set: a state outside its tube has been flagged.
    """

    models: ModelSet
    noise: float
    flagged: list[int] = field(default_factory=list)
    """Numbers of the samples that nothing explains, from 0 at the first after the preparation."""
    _number: int = 0

    def __post_init__(self) -> None:
        self._held: deque[tuple[Array, Array]] = deque(maxlen=NEWEST)
        self._believed = self.models.centre.joined.copy()

    def observe(self, state: Array, action: Array, successor: Array) -> bool:
        """Take in a sample; whether it is explained.

        Parameters
        ----------
        state, action, successor
            x(k), u(k), x(k+1): n_x, n_u, n_x.
        """
        regressor, number = np.concatenate([state, action]), self._number
        self._number += 1
        explained = self._within(regressor, successor) and self._together(regressor, successor)
        if explained:
            self._held.append((regressor, np.array(successor)))
        else:
            self.flagged.append(number)
        return explained

    def _within(self, regressor: Array, successor: Array) -> bool:
        """Whether some model of the set, a row each, explains the sample by itself."""
        slack = self._allowed(regressor, successor)
        for row, after, room in zip(self.models.corners, successor, slack, strict=True):
            seen = row @ regressor
            if not seen.min() - room <= after <= seen.max() + room:
                return False
        return True

    def _together(self, regressor: Array, successor: Array) -> bool:
        """Whether one model explains it with all the others; the last one that did is tried first."""
        if not self.models.rows:
            return True
        room = self._allowed(regressor, successor)
        for r in range(self.models.states):
            if abs(successor[r] - self._believed[r] @ regressor) <= room[r]:
                continue
            held = [*self._held, (regressor, successor)]
            rows = Polytope.slabs(
                np.array([one for one, _ in held]) / self.noise, np.array([two[r] for _, two in held]) / self.noise, 1.0
            )
            prepared = self.models.rows[r]
            both = Polytope(
                np.vstack([prepared.normals, rows.normals]), np.concatenate([prepared.offsets, rows.offsets])
            )
            middle, excess = both.least_excess()
            if excess > SLACK + room[r] / self.noise - 1:
                return False
            self._believed[r] = middle
        return True

    def _allowed(self, regressor: Array, successor: Array) -> Array:
        """The noise of each state, and the rounding of the numbers it is found from."""
        size = np.abs(self.models.centre.joined) @ np.abs(regressor) + np.abs(successor)
        return np.asarray(self.noise * (1 + SLACK) + 1e-12 * size)
