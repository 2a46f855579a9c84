"""Numbers known to lie between two ends: the plant run on intervals says how far a state can come."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Interval:
    """All numbers from `low` to `high`, and what the plant needs of arithmetic with such."""

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

    def __rtruediv__(self, other: Interval | float) -> Interval:
        if self.low <= 0.0 <= self.high:
            raise ZeroDivisionError(f"an interval that holds 0 divides nothing: {self}")
        return other * Interval(1.0 / self.high, 1.0 / self.low)

    def __truediv__(self, other: Interval | float) -> Interval:
        return _interval(other).__rtruediv__(self)

    def within(self, low: float, high: float) -> Interval:
        """Those of them that lie between `low` and `high`, of which some must."""
        return Interval(min(max(self.low, low), high), max(min(self.high, high), low))

    def least(self, other: Interval | float) -> Interval:
        """The lesser of two such numbers."""
        its = _interval(other)
        return Interval(min(self.low, its.low), min(self.high, its.high))

    __radd__ = __add__
    __rmul__ = __mul__


def _interval(value: Interval | float) -> Interval:
    return value if isinstance(value, Interval) else Interval(value, value)
