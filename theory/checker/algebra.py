"""Exact linear algebra: products, definiteness, stability and equations, in integers and fractions."""

from collections.abc import Sequence
from fractions import Fraction
from math import lcm
from operator import mul
from typing import Any

from .constraints import Refused
from .enclosures import Enclosure

Matrix = list[list[Any]]  # of integers or of fractions


def multiply(one: Sequence[Sequence[Any]], two: Sequence[Sequence[Any]]) -> list[list[Any]]:
    """The product of two matrices."""
    columns = list(zip(*two, strict=True))
    list(zip(zip(*one, strict=True), two, strict=True))  # they fit, or this raises
    return [[sum(map(mul, row, column)) for column in columns] for row in one]


def prove(rows: Sequence[Sequence[Any]], what: str) -> None:
    """Refuse a symmetric matrix that is not positive definite (Bareiss 1968, doi:10.1090/S0025-5718-1968-0226829-0)."""
    rest, before = [[*row[place:]] for place, row in enumerate(rows)], 1  # whole numbers, as all divisions are exact
    for place, (pivot, *others) in enumerate(rest):
        if pivot <= 0:  # a leading minor
            raise Refused(f"violated: {what}: not positive definite (leading minor {place + 1})")
        for down, left in enumerate(others):
            pairs = zip(rest[place + down + 1], others[down:], strict=True)
            rest[place + down + 1] = [(pivot * item - left * above) // before for item, above in pairs]
        before = pivot


def prove_fractions(rows: Sequence[Sequence[Any]], what: str) -> None:
    """As `prove`, for a symmetric matrix of fractions, or for all that enclosures contain."""
    if any(isinstance(item, Enclosure) for row in rows for item in row):
        rest = [[Enclosure.around(0, 0) + item for item in row[place:]] for place, row in enumerate(rows)]
        for place, (pivot, *others) in enumerate(rest):
            if not pivot > 0:
                raise Refused(f"violated: {what}: not positive definite (pivot {place + 1})")
            for down, left in enumerate(others):
                pairs = zip(rest[place + down + 1], others[down:], strict=True)
                rest[place + down + 1] = [item - left / pivot * above for item, above in pairs]
        return
    common = lcm(*(item.denominator for row in rows for item in row))
    prove([[int(common * item) for item in row] for row in rows], what)


def weighted(weights: Sequence[Any], matrices: Sequence[Matrix]) -> Matrix:
    """The sum of matrices, each by its weight."""
    return [
        [sum((w * x for w, x in zip(weights, items, strict=True)), Fraction(0)) for items in zip(*rows, strict=True)]
        for rows in zip(*matrices, strict=True)
    ]


def bordered(inner: Matrix, side: Matrix, corner: Matrix) -> Matrix:
    """The symmetric matrix [inner, side'; side, corner]."""
    above = [[*row, *column] for row, column in zip(inner, zip(*side, strict=True), strict=True)]
    return above + [[*row, *other] for row, other in zip(side, corner, strict=True)]


def schur_stable(rows: Matrix) -> bool:
    """Whether all eigenvalues lie inside the unit circle: Faddeev-LeVerrier for the polynomial, then Schur-Cohn.

    Parameters
    ----------
    rows
        A square matrix of rationals.

    Returns
    -------
    bool
        True where the spectral radius is below 1, exactly.
    """
    power, polynomial = [[Fraction(0)] * len(rows) for _ in rows], [Fraction(1)]
    for k in range(1, len(rows) + 1):
        power = multiply(rows, [[x + polynomial[-1] * (i == j) for j, x in enumerate(r)] for i, r in enumerate(power)])
        polynomial.append(-sum((power[i][i] for i in range(len(rows))), Fraction(0)) / k)
    while len(polynomial) > 1 and abs(polynomial[-1]) < abs(polynomial[0]):
        share = polynomial[-1] / polynomial[0]
        polynomial = [a - share * b for a, b in zip(polynomial, reversed(polynomial), strict=True)][:-1]
    return len(polynomial) == 1


def solve(rows: Matrix, right: Matrix) -> Matrix:
    """X with rows X = right, by Gauss-Jordan elimination in fractions."""
    rest, size = [[*a, *b] for a, b in zip(rows, right, strict=True)], len(rows)
    for k in range(size):
        pivot = next((i for i in range(k, size) if rest[i][k] != 0), None)
        if pivot is None:
            raise Refused("the point of the unit circle is an eigenvalue of the repeated word")
        rest[k], rest[pivot] = rest[pivot], rest[k]
        rest[k] = [item / rest[k][k] for item in rest[k]]
        for i in range(size):
            if i != k and rest[i][k] != 0:
                by = rest[i][k]
                rest[i] = [a - by * b for a, b in zip(rest[i], rest[k], strict=True)]
    return [row[size:] for row in rest]
