"""Numbers known to lie between two ends: the plant run on intervals says how far a state can come."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Interval:
    """All numbers from `low` to `high`, and sums, differences and products of such; the plant needs no more."""

    low: float
    high: float

    def __add__(self, other: Interval | float) -> Interval:
        its = _interval(other)
        return Interval(self.low + its.low, self.high + its.high)

    def __mul__(self, other: Interval | float) -> Interval:
        its = _interval(other)
        ends = (self.low * its.low, self.low * its.high, self.high * its.low, self.high * its.high)
        return Interval(min(ends), max(ends))

    def __neg__(self) -> Interval:
        return Interval(-self.high, -self.low)

    def __sub__(self, other: Interval | float) -> Interval:
        return self + -_interval(other)

    def __rsub__(self, other: float) -> Interval:
        return -self + other

    __radd__ = __add__
    __rmul__ = __mul__


def _interval(value: Interval | float) -> Interval:
    return value if isinstance(value, Interval) else Interval(value, value)
