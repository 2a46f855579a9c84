"""Lower bounds: what the repetition of a word does, exactly, whatever a certificate says about all signals."""

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from .algebra import Matrix, multiply, schur_stable, solve
from .constraints import STEPS_MAX, Label, Refused, explored, spelled


def repeatable(signals: tuple[Any, Any], word: Sequence[Label]) -> int:
    """Refuse a word that no admissible signal repeats for ever; the number of states looked at."""
    states = explored(*signals)

    def again(state: Any) -> dict[int, Any]:
        for label in word:
            state = None if state is None else signals[1](state).get(label)
        return {0: state}

    if not 0 < len(word) * len(states) <= STEPS_MAX or all(None in explored(state, again) for state in states):
        raise Refused(f"no admissible signal repeats the word {spelled(word)} for ever")
    return len(states)


def response(
    pieces: Sequence[tuple[Matrix, Matrix]], tangent: Fraction, disturbances: Sequence[Sequence[Fraction]]
) -> tuple[Fraction, Fraction]:
    """Squared lengths, over a period, of the outputs and of the disturbances they answer to.

    From period to period both turn by the angle 2 arctan(tangent), as complex numbers: the signal's gain is at least
    the root of the quotient.

    Parameters
    ----------
    pieces
        [G E] and [H F] of each letter of the word.
    tangent
        Rational, so that the point ((1 - t^2) + 2 t i) / (1 + t^2) of the unit circle is.
    disturbances
        Real parts and then imaginary parts of w for each letter.

    Raises
    ------
    Refused
        That point is an eigenvalue of the period.
    """
    size = len(pieces[0][0])
    split = [(row[: len(row) // 2], row[len(row) // 2 :]) for row in disturbances]
    loops = [([row[:size] for row in loop], [row[size:] for row in loop]) for loop, _ in pieces]
    period, *pushed = _after(loops, list(zip(*split, strict=True)))
    cosine, sine = (1 - tangent**2) / (1 + tangent**2), 2 * tangent / (1 + tangent**2)
    moved = [[cosine * (i == j) - x for j, x in enumerate(row)] for i, row in enumerate(period)]
    turned = [[sine * (i == j) for j in range(size)] for i in range(size)]
    rows = [[*a, *(-x for x in b)] for a, b in zip(moved, turned, strict=True)]
    rows += [[*b, *a] for a, b in zip(moved, turned, strict=True)]
    found = solve(rows, [[item] for part in pushed for item in part])
    square = Fraction(0)
    for part in range(2):
        state = found[part * size : (part + 1) * size]
        for (loop, out), both in zip(pieces, split, strict=True):
            here = [*state, *([item] for item in both[part])]
            square += sum((row[0] ** 2 for row in multiply(out, here)), Fraction(0))
            state = multiply(loop, here)
    return square, sum((item**2 for row in disturbances for item in row), Fraction(0))


def orbit(pieces: Sequence[tuple[Matrix, Matrix]], disturbances: Sequence[Sequence[Fraction]]) -> Fraction:
    """The squared length of the state to which a repeated word with repeated disturbances leads, from anywhere.

    Parameters
    ----------
    pieces
        G and E of each letter of the word.
    disturbances
        w of each letter.

    Raises
    ------
    Refused
        The repeated word does not decay.
    """
    period, pushed = _after(pieces, [disturbances])
    if not schur_stable(period):
        raise Refused("the repeated word does not decay: no orbit is reached")
    rest = [[(i == j) - x for j, x in enumerate(row)] for i, row in enumerate(period)]
    return sum((row[0] ** 2 for row in solve(rest, [[item] for item in pushed])), Fraction(0))


def _after(pieces: Sequence[tuple[Matrix, Matrix]], signals: Sequence[Any]) -> list[Any]:
    """The matrix of a period, and for each signal of disturbances the state it leads to from 0."""
    size = len(pieces[0][0])
    now: Matrix = [[Fraction(i == j) for j in range(size)] + [Fraction(0)] * len(signals) for i in range(size)]
    for (loop, drive), *pushed in zip(pieces, *signals, strict=True):
        added = multiply(drive, [list(row) for row in zip(*pushed, strict=True)])
        pairs = zip(multiply(loop, now), added, strict=True)
        now = [[*row[:size], *(x + y for x, y in zip(row[size:], more, strict=True))] for row, more in pairs]
    return [[row[:size] for row in now], *([row[size + k] for row in now] for k in range(len(signals)))]
