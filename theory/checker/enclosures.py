"""Real numbers between two decimals, for what has no exact value: every result encloses what it is of."""

from fractions import Fraction
from math import ceil, floor
from typing import Any

from .constraints import Refused

UNIT = 10**44  # ends are whole multiples of 1 / UNIT


class Enclosure:
    """All numbers from `low` to `high`, whole numbers in units of 1 / UNIT; a comparison is true of all, or refused."""

    __slots__ = ("high", "low")

    def __init__(self, low: int, high: int) -> None:
        self.low, self.high = low, high

    @classmethod
    def around(cls, low: Any, high: Any) -> "Enclosure":
        """The smallest one that contains two rationals."""
        return cls(floor(low * UNIT), ceil(high * UNIT))

    @property
    def middle(self) -> Fraction:
        """The rational halfway between its ends."""
        return Fraction(self.low + self.high, 2 * UNIT)

    def __neg__(self) -> "Enclosure":
        return Enclosure(-self.high, -self.low)

    def __add__(self, other: Any) -> "Enclosure":
        two = _of(other)
        return Enclosure(self.low + two.low, self.high + two.high)

    def __sub__(self, other: Any) -> "Enclosure":
        return self + -_of(other)

    def __rsub__(self, other: Any) -> "Enclosure":
        return _of(other) - self

    def __mul__(self, other: Any) -> "Enclosure":
        two = _of(other)
        ends = [x * y for x in (self.low, self.high) for y in (two.low, two.high)]
        return Enclosure(min(ends) // UNIT, -(-max(ends) // UNIT))

    def __truediv__(self, other: Any) -> "Enclosure":
        two = _of(other)
        if two.low <= 0 <= two.high:
            raise ZeroDivisionError("an enclosure of 0 divides")
        ends = [(x * UNIT, y) for x in (self.low, self.high) for y in (two.low, two.high)]
        return Enclosure(min(x // y for x, y in ends), max(-(-x // y) for x, y in ends))

    def __rtruediv__(self, other: Any) -> "Enclosure":
        return _of(other) / self

    def __pow__(self, power: int) -> "Enclosure":
        return self if power == 1 else self * self ** (power - 1)

    def __abs__(self) -> "Enclosure":
        ends = sorted((abs(self.low), abs(self.high)))
        return Enclosure(0 if self.low <= 0 <= self.high else ends[0], ends[1])

    def __lt__(self, other: Any) -> bool:
        two = _of(other)
        if self.high >= two.low and self.low < two.high:
            raise Refused("an enclosure of what has no exact value does not decide a comparison")
        return self.high < two.low

    def __gt__(self, other: Any) -> bool:
        return _of(other) < self

    __radd__, __rmul__ = __add__, __mul__


def _of(item: Any) -> "Enclosure":
    return item if isinstance(item, Enclosure) else Enclosure.around(item, item)
