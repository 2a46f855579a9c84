"""Continuous-time modes sampled: x' = A x + B u + E w with u and w held for a period, by enclosed exponentials."""

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

from .algebra import Matrix, multiply
from .constraints import Refused
from .enclosures import UNIT, Enclosure

SIZE_MAX = 30  # of the exponent: beyond, series are long and periods have no use


def sampled(mode: Mapping[str, Matrix], period: Fraction) -> dict[str, Matrix]:
    """A mode with A, B and E of the samples: the top of exp([A, B, E; 0, 0, 0] period)."""
    size, names = len(mode["A"]), [name for name in "ABE" if name in mode]
    rows = [[period * x for name in names for x in mode[name][i]] for i in range(size)]
    rows += [[Fraction(0)] * len(rows[0]) for _ in range(len(rows[0]) - size)]
    found, made, start = exponential(rows), dict(mode), 0
    for name in names:
        width = len(mode[name][0])
        made[name] = [row[start : start + width] for row in found[:size]]
        start += width
    return made


def exponential(rows: Matrix) -> Matrix:
    """Enclosures of the entries of exp(W): its series, and a bound of the terms left out."""
    size = max(sum(map(abs, row)) for row in rows)
    if not 0 <= size <= SIZE_MAX:
        raise Refused(f"period: the exponent has the norm {float(size):g}, the limit is {SIZE_MAX}")
    enclosed = [[Enclosure.around(x, x) for x in row] for row in rows]
    term: Matrix = [[Enclosure.around(i == j, i == j) for j in range(len(rows))] for i in range(len(rows))]
    found, bound, count = term, Fraction(1), 0
    while bound * UNIT > 1 or count < 2 * size:  # from then on terms fall by a half or more
        count += 1
        bound *= size / count
        bound = Fraction(-(-bound * UNIT * UNIT // 1), UNIT * UNIT)
        term = [[x / count for x in row] for row in multiply(term, enclosed)]
        found = [[x + y for x, y in zip(*pair, strict=True)] for pair in zip(found, term, strict=True)]
    rest = Enclosure.around(-bound, bound)
    return [[x + rest for x in row] for row in found]


def norm(rows: Sequence[Sequence[Any]]) -> Fraction:
    """A bound of the largest singular value: the larger of the sums of a row and of a column."""
    absolute = [[abs(x) for x in row] for row in rows]
    return max([Fraction(sum(line)) for line in (*absolute, *zip(*absolute, strict=True))], default=Fraction(0))


def wandering(modes: Sequence[Mapping[str, Matrix]], period: Fraction) -> Fraction:
    """(e^(a h) - 1) / a, a the largest norm of A: how far x' at a sample leads until the next, by its length."""
    size = max(norm(mode["A"]) for mode in modes) * period
    if size > SIZE_MAX:
        raise Refused(f"period: A times it has the norm {float(size):g}, the limit is {SIZE_MAX}")
    term = total = Fraction(1)
    for k in range(2, 3 * SIZE_MAX + 60):  # sum of size^k / (k + 1)!
        term = Fraction(-(-term * size * UNIT // k), UNIT)
        total += term
    return period * (total + term)
