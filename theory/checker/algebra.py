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
    """The product of two matrices; of fractions in whole numbers, each row and column over a denominator of its own."""
    columns = list(zip(*two, strict=True))
    list(zip(zip(*one, strict=True), two, strict=True))  # they fit, or this raises
    kinds = {type(item) for rows in (one, two) for row in rows for item in row}
    if Fraction in kinds and kinds <= {int, bool, Fraction}:
        left, right = [_whole(row) for row in one], [_whole(column) for column in columns]
        return [[Fraction(sum(map(mul, row, column)), a * b) for b, column in right] for a, row in left]
    return [[sum(map(mul, row, column)) for column in columns] for row in one]


def _whole(line: Sequence[Any]) -> tuple[int, list[int]]:
    """A common denominator of rationals, and their numerators over it."""
    common = lcm(*(item.denominator for item in line))
    return common, [item.numerator * (common // item.denominator) for item in line]


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
    """Whether all eigenvalues lie inside the unit circle: Faddeev-LeVerrier for the polynomial, then its roots.

    Parameters
    ----------
    rows
        A square matrix of rationals.

    Returns
    -------
    bool
        True where the spectral radius is below 1, exactly.
    """
    unit, size = 1, len(rows)
    if all(type(item) in {int, Fraction} for row in rows for item in row):  # whole numbers over one denominator
        unit, flat = _whole([item for row in rows for item in row])
        rows = [flat[i * size : (i + 1) * size] for i in range(size)]
    power: Matrix = [[0] * size for _ in rows]
    polynomial: list[Any] = [Fraction(1)]
    for k in range(1, size + 1):
        last = int(polynomial[-1]) if isinstance(polynomial[-1], Fraction) else polynomial[-1]
        power = multiply(rows, [[x + last * (i == j) for j, x in enumerate(r)] for i, r in enumerate(power)])
        polynomial.append(-sum((power[i][i] for i in range(size)), Fraction(0)) / k)
    polynomial = [item / unit**k for k, item in enumerate(polynomial)]
    try:  # decimals decide it mostly, and where they do not, fractions
        return _roots_inside([Enclosure.around(0, 0) + item for item in polynomial])
    except Refused:
        return _roots_inside(polynomial)


def _roots_inside(polynomial: list[Any]) -> bool:
    """Whether all roots lie inside the unit circle (Schur-Cohn); coefficients from that of the highest power on."""
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
