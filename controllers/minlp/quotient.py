"""Expressions of a solver with their denominators apart: an equation with one is multiplied out before it is told."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Quotient:
    """An expression over another, and sums, differences, products and quotients of such."""

    top: Any
    bottom: Any = 1.0

    @property
    def plain(self) -> bool:
        """Whether there is no denominator."""
        return isinstance(self.bottom, float) and self.bottom == 1.0

    def __add__(self, other: Any) -> Quotient:
        its = _quotient(other)
        if self.bottom is its.bottom or (self.plain and its.plain):
            return Quotient(self.top + its.top, self.bottom)
        return Quotient(
            _product(self.top, its.bottom) + _product(its.top, self.bottom), _product(self.bottom, its.bottom)
        )

    def __mul__(self, other: Any) -> Quotient:
        its = _quotient(other)
        return Quotient(_product(self.top, its.top), _product(self.bottom, its.bottom))

    def __neg__(self) -> Quotient:
        return Quotient(-self.top, self.bottom)

    def __sub__(self, other: Any) -> Quotient:
        return self + -_quotient(other)

    def __rsub__(self, other: Any) -> Quotient:
        return -self + other

    def __truediv__(self, other: Any) -> Quotient:
        its = _quotient(other)
        return Quotient(_product(self.top, its.bottom), _product(self.bottom, its.top))

    def __rtruediv__(self, other: Any) -> Quotient:
        return _quotient(other) / self

    __radd__ = __add__
    __rmul__ = __mul__


def _quotient(value: Any) -> Quotient:
    return value if isinstance(value, Quotient) else Quotient(value)


def _product(one: Any, other: Any) -> Any:
    """The product, without factors of 1."""
    if isinstance(one, float) and one == 1.0:
        return other
    return one if isinstance(other, float) and other == 1.0 else one * other
