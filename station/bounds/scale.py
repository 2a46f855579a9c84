"""Scales of pressure on which filling runs at nearly constant speed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from station.bounds.spline import Floats


@dataclass(frozen=True)
class Scale:
    """A scale z of pressure with dz/dp = 1 / (end - p), up to `width` below the end; from there on dz/dp = 1 / width.

    A tank filled by a compressor whose pressure is a little below `end` moves at nearly constant speed on it.
    """

    end: float  # [bar]
    width: float  # [bar]

    def rate(self, pressure: Floats) -> Floats:
        """dz/dp [1/bar]."""
        return np.asarray(1 / np.maximum(self.end - pressure, self.width))

    def position(self, pressure: Floats) -> Floats:
        """The scale's z at pressures [bar]."""
        near = np.minimum(pressure, self.end - self.width)
        return np.asarray((pressure - near) / self.width - np.log(self.end - near))

    def pressure(self, position: Floats) -> Floats:
        """The pressure [bar] at z."""
        last = -np.log(self.width)
        return np.asarray(self.end - np.exp(-np.minimum(position, last)) + np.maximum(position - last, 0) * self.width)
