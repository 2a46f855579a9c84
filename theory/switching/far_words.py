"""Balls from below: a word that is repeated, and disturbances along it whose orbit goes far."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction

import numpy as np

from theory.arrays import Array
from theory.checker import Label, Refused, orbit, repeatable, rules
from theory.switching.language import Language
from theory.switching.periodic import SLACKS, LowerBound, Word, short_words
from theory.switching.system import Gains, SwitchedSystem, rounded_down

WORDS = 40
"""Words that are tried."""

WORD_MAX = 6

LETTERS = 48
"""Letters of a period, at most: its orbit is proved in fractions, whose digits grow with it."""

REPEATS = (1, 3, 8, 20, 48)

ASCENTS = 12
"""Times that the disturbances are turned towards where the orbit has gone."""

DIGITS = 6
"""Decimals of a disturbance, in units of its peak."""


def farthest(pieces: Mapping[Label, tuple[Array, Array]], back: Array, language: Language) -> tuple[float, Word, Array]:
    """The farthest orbit along a repeated word under |w| <= 1: its distance, the word, and the disturbances.

    Parameters
    ----------
    pieces
        [G, E] of each letter, in coordinates z.
    back
        T, x = T z: distances are those of x.
    language
        Signals whose periodic words are tried.

    Returns
    -------
    tuple
        The distance, the word, and w of each letter, letters x q.
    """
    best: tuple[float, Word, Array] = (0.0, (), np.zeros((0, 0)))
    for number, word in enumerate(short_words(language, WORD_MAX)):
        if number >= WORDS:
            break
        for repeats in REPEATS:
            if repeats * len(word) > LETTERS:
                break
            found = _orbit([pieces[label] for label in word * repeats], back)
            if found is not None and found[0] > best[0] * (1 + 1e-9):
                best = (found[0], word * repeats, found[1])
    return best


def _orbit(period: list[tuple[Array, Array]], back: Array) -> tuple[float, Array] | None:
    """The farthest point of a periodic orbit at the end of the period, by ascent from all axes; None if it diverges."""
    state, drives = np.eye(len(back)), []
    for loop, drive in reversed(period):
        drives.append(state @ drive)
        state = state @ loop
    if np.abs(np.linalg.eigvals(state)).max() >= 1:
        return None
    far = back @ np.linalg.solve(np.eye(len(back)) - state, np.array(drives[::-1]))  # letters x n x q, to x
    point, pushed = np.eye(len(back)), np.zeros(0)
    for _ in range(ASCENTS):
        pulled = np.einsum("knq,sn->skq", far, point)
        pushed = pulled / np.maximum(np.linalg.norm(pulled, axis=2, keepdims=True), 1e-300)
        point = np.einsum("knq,skq->sn", far, pushed)
    lengths = np.linalg.norm(point, axis=1)
    return float(lengths.max()), pushed[int(lengths.argmax())]


def proved_radius(
    system: SwitchedSystem, language: Language, gains: Gains | None, peak: Fraction, found: tuple[float, Word, Array]
) -> LowerBound | None:
    """The distance of an orbit as a bound that the checker proves; None where nothing positive is.

    Parameters
    ----------
    system, language, gains
        The loop and its signals.
    peak
        Bound of |w|.
    found
        Distance in units of the peak, word and disturbances, as `farthest` gives them; letters x q.
    """
    distance, word, pushed = found
    if not word or not distance > 0:
        return None
    repeatable(rules(language.constraint, language.modes), list(word))
    shrunk = pushed * (1 - 2 * 10.0**-DIGITS) if pushed.shape[1] > 1 else np.sign(pushed)
    exact = [[peak * Fraction(round(float(x) * 10**DIGITS), 10**DIGITS) for x in row] for row in shrunk]
    pieces = [(system.exact_loop(label, gains), system.exact_drive(label, gains)) for label in word]
    try:
        square = orbit(pieces, exact)
    except Refused:
        return None
    for slack in (1e-9, *SLACKS[2:], 1e-3):
        value = rounded_down(distance * float(peak) * (1 - slack), 9)
        if value**2 <= square:
            return LowerBound(value, word, None, tuple(map(tuple, exact)))
    return None
