"""Periodic words as bounds from below: the slowest one, and the one of the largest l2 gain.

Short words are all tried; longer ones are searched among the products that have decayed least. What is found is proved
exactly (`theory.checker`) before it is claimed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from scipy import optimize

from theory.arrays import Array
from theory.checker import Label, Refused, multiply, repeatable, response, rules, schur_stable
from theory.switching.language import Language
from theory.switching.system import Gains, SwitchedSystem, decimal, rounded_down

WORD_MAX = 12
"""Longest periodic word that is tried unless said."""

WALKS_MAX = 20_000
"""Lengths with more closed walks than these are not tried one by one."""

WALKS_QUICK = 300
"""The same where longer words are searched among slow products anyway."""

LONG_MAX = 40
"""Longest word of the search among slow products."""

KEPT = 40
"""Slow products kept at each length."""

PRODUCTS = 160
"""Products made at each length, at most, where modes are many."""

BEGINNINGS = 12
"""States of the automaton at which the search begins, at most."""

STATES_MAX = 400
"""Automata of more states have their short words not tried one by one."""

ANGLES = 64
"""Frequencies at which every word's gain is computed, besides those of its poles."""

GAIN_WORDS = 400
"""Words whose gain is computed; the gain of the best is refined."""

REFINED = 4

SLACKS = (1e-11, 1e-9, 1e-8, 1e-7, 1e-6, 1e-4)
"""Relative distances of a claim below the figure found: the first that is proved is kept."""

ABOVE = (-1e-8, -1e-10, -1e-13, 0.0)
"""The same above it: eigenvalues that lie close together, or on the circle, are found with an error of their own."""

DIGITS = 10

PUSHED = 7
"""Decimals of a disturbance beside 1: an error is one of the second order in the gain."""

TANGENT_MAX = 1e3
"""Beyond, the angle is near half a turn, and the word is doubled: there its angle is small."""

Word = tuple[Label, ...]
ExactRows = list[list[Fraction]]
Pieces = Mapping[Label, tuple[Array, Array, Array, Array]]


@dataclass(frozen=True)
class LowerBound:
    """A proved bound: no certificate can be below `value`, since `word` may be repeated for ever."""

    value: Fraction
    word: Word
    tangent: Fraction | None = None
    """Of half the angle of the disturbance from period to period, for gains."""
    disturbances: tuple[tuple[Fraction, ...], ...] = ()
    """w of each letter: for balls; for gains its real and its imaginary parts."""
    path: tuple[tuple[Fraction, ...], ...] = ()
    """Values of the parameters at each letter, where a plant has some."""

    def as_document(self) -> dict[str, Any]:
        """As a claim holds it."""
        made: dict[str, Any] = {
            "value": decimal(self.value),
            "word": [list(label) if isinstance(label, tuple) else label for label in self.word],
        }
        if self.path:
            made["path"] = [[decimal(item) for item in point] for point in self.path]
        if self.disturbances:
            made["disturbances"] = [[decimal(item) for item in row] for row in self.disturbances]
        return made if self.tangent is None else {**made, "tangent": decimal(self.tangent)}


def slowest(maps: Mapping[Label, Array], language: Language, longest: int | None = None) -> tuple[float, Word]:
    """The slowest decay a letter among periodic words: all short ones, then long ones from slow products.

    Parameters
    ----------
    maps
        The closed loop of each letter, n x n, in coordinates in which norms tell something.
    language
        Signals whose periodic words are tried.
    longest
        Length up to which all words are tried, and no longer ones; by default as many as take a moment, and words of up
        to `LONG_MAX` letters among slow products.
    """
    best: tuple[float, Word] = (0.0, ())
    for word in short_words(language, longest or WORD_MAX, WALKS_MAX if longest else WALKS_QUICK):
        best = _slower(best, maps, word)
    if longest is not None or len(maps) == 1:
        return best
    for word in _slow_walks(maps, language, best[0]):
        best = _slower(best, maps, word)
    return best


def short_words(language: Language, longest: int, most: int = WALKS_MAX) -> Iterator[Word]:
    """Every periodic word up to a length, as far as there are not too many; none of a very large automaton."""
    if len(language.automaton.transitions) > STATES_MAX:
        return iter(())
    return language.periodic_words(longest, most=most)


def _slower(best: tuple[float, Word], maps: Mapping[Label, Array], word: Word) -> tuple[float, Word]:
    product = np.eye(len(maps[word[0]]))
    for label in word:
        product = maps[label] @ product
    rate = float(np.abs(np.linalg.eigvals(product)).max()) ** (1 / len(word))
    return (rate, word) if rate > best[0] * (1 + 1e-12) else best


def _slow_walks(maps: Mapping[Label, Array], language: Language, rate: float) -> Iterator[Word]:
    """Closed walks slower than `rate`, from the products of largest norm at each length."""
    transitions = language.automaton.transitions
    places = np.unique(np.linspace(0, len(transitions) - 1, BEGINNINGS).astype(int))
    most = max(4, min(KEPT, PRODUCTS // max(map(len, transitions))))
    unit = rate or max(float(np.linalg.norm(one, 2)) for one in maps.values()) or 1.0
    for begin in map(int, places):
        walks: list[tuple[int, Word, Array]] = [(begin, (), np.eye(len(next(iter(maps.values())))))]
        for _ in range(LONG_MAX):
            steps = [(to, (*word, x), maps[x] @ product / unit) for at, word, product in walks
                     for x, to in transitions[at].items()]  # fmt: skip
            products = np.array([product for _, _, product in steps])
            sizes = np.linalg.norm(products, axis=(1, 2))
            kept = np.argsort(-sizes, kind="stable")[:most]
            walks = [steps[place] for place in kept]
            closed = [place for place in kept if steps[place][0] == begin]
            if not closed:
                continue
            radii = np.abs(np.linalg.eigvals(products[closed])).max(axis=1)
            place = int(radii.argmax())
            if radii[place] > 1 + 1e-12:
                yield steps[closed[place]][1]


def proved_rate(
    system: SwitchedSystem, language: Language, gains: Gains | None, found: tuple[float, Word]
) -> LowerBound | None:
    """The slowest word as a bound that the checker proves; None where nothing positive is.

    Parameters
    ----------
    system, language, gains
        The loop and its signals.
    found
        Decay and word, as `slowest` gives them.
    """
    rate, word = found
    if not word or not rate > 0:
        return None
    repeatable(rules(language.constraint, language.modes), list(word))
    product: list[list[Any]] = [[Fraction(i == j) for j in range(system.size)] for i in range(system.size)]
    for label in word:
        product = multiply(system.exact_loop(label, gains), product)
    value = claimed_rate(product, rate, len(word), SLACKS[1:] if system.period is not None else (*ABOVE, *SLACKS))
    return None if value is None else LowerBound(value, word)


def claimed_rate(
    product: list[list[Any]], rate: float, length: int, slacks: Sequence[float] = (*ABOVE, *SLACKS)
) -> Fraction | None:
    """A rate near the one found that the exact product of a word has, letter by letter; None if there is none."""
    for slack in slacks:
        value = rounded_down(rate * (1 - slack), DIGITS)
        power = value**length
        if not schur_stable([[item / power for item in row] for row in product]):
            return value
    return None


# ---------------------------------------------------------------- gains


def largest_gain(pieces: Pieces, language: Language, longest: int = 8) -> tuple[float, Word, float]:
    """The largest l2 gain among periodic words, its word, and the angle from period to period at which it is reached.

    Parameters
    ----------
    pieces
        [G, E, H, F] of each letter.
    language
        Signals whose periodic words are tried.
    longest
        Largest length of a word.
    """
    tried: dict[Word, tuple[float, float]] = {}
    for word in short_words(language, longest):
        tried[word] = coarse_gain(pieces, word)
        if len(tried) >= GAIN_WORDS or tried[word][0] == np.inf:
            break
    ranked = sorted(tried, key=lambda word: -tried[word][0])
    for word in [(*one, *two) for one in ranked[:REFINED] for two in ranked[:REFINED] if one != two]:
        if word not in tried and language.repeats(word):
            tried[word] = coarse_gain(pieces, word)
    ranked = sorted(tried, key=lambda word: -tried[word][0])[:REFINED]
    if not ranked:
        return 0.0, (), 0.0
    fine = [(*refined_gain(pieces, word, tried[word]), word) for word in ranked]
    gain, angle, word = max(fine, key=lambda item: item[0])
    return gain, word, angle


def period(pieces: Pieces, word: Word) -> tuple[Array, Array, Array, Array]:
    """The time-invariant system of one period: x after it and all outputs in it, by x before it and all disturbances.

    Parameters
    ----------
    pieces
        [G, E, H, F] of each letter.
    word
        The letters of the period.
    """
    n, q = pieces[word[0]][1].shape
    state, drive = np.eye(n), np.zeros((n, 0))
    seen, direct = np.zeros((0, n)), np.zeros((0, 0))
    for label in word:
        a, e, c, f = pieces[label]
        direct = np.block([[direct, np.zeros((direct.shape[0], q))], [c @ drive, f]])
        seen = np.vstack([seen, c @ state])
        drive, state = np.hstack([a @ drive, e]), a @ state
    return state, drive, seen, direct


def coarse_gain(pieces: Pieces, word: Word) -> tuple[float, float]:
    """The gain of a repeated word at many angles, and the angle of the largest; infinite if it does not decay.

    Parameters
    ----------
    pieces
        [G, E, H, F] of each letter.
    word
        The letters of the period.
    """
    loop = period(pieces, word)
    poles = np.linalg.eigvals(loop[0])
    if np.abs(poles).max() >= 1:
        return float("inf"), 0.0
    angles = np.unique(np.concatenate([np.linspace(0, np.pi, ANGLES), np.abs(np.angle(poles))]))
    values = _gains_at(loop, angles)
    best = int(values.argmax())
    return float(values[best]), float(angles[best])


def refined_gain(pieces: Pieces, word: Word, coarse: tuple[float, float]) -> tuple[float, float]:
    """The gain near the angle of `coarse`, and its angle.

    Parameters
    ----------
    pieces, word
        As for `coarse_gain`.
    coarse
        What that found.
    """
    if not np.isfinite(coarse[0]):
        return coarse
    loop, (best, angle) = period(pieces, word), coarse
    width = np.pi / (ANGLES - 1)
    while width > 1e-9:  # peaks of slow poles are narrow: look closer, each time around the best
        angles = np.clip(angle + np.linspace(-width, width, 17), 0.0, np.pi)
        values = _gains_at(loop, angles)
        if values.max() >= best:
            best, angle = float(values.max()), float(angles[int(values.argmax())])
        width /= 4
    found = optimize.minimize_scalar(
        lambda value: -_gains_at(loop, np.array([value]))[0], bounds=(max(angle - 1e-6, 0), min(angle + 1e-6, np.pi)),
        method="bounded",
    )  # fmt: skip
    return max((best, angle), (-float(found.fun), float(found.x)))


def _gains_at(loop: tuple[Array, Array, Array, Array], angles: Array) -> Array:
    state, drive, seen, direct = loop
    turned = np.exp(1j * angles)[:, None, None] * np.eye(len(state)) - state
    try:
        inner = np.linalg.solve(turned, np.broadcast_to(drive, (len(angles), *drive.shape)))
    except np.linalg.LinAlgError:
        return np.zeros(len(angles))
    return np.asarray(np.linalg.norm(seen @ inner + direct, 2, axis=(1, 2)))


def proved_gain(
    system: SwitchedSystem, language: Language, gains: Gains | None, pieces: Pieces, found: tuple[float, Word, float]
) -> LowerBound | None:
    """The gain of a repeated word as a bound that the checker proves; None where nothing positive and finite is.

    Parameters
    ----------
    system, language, gains
        The loop and its signals.
    pieces
        [G, E, H, F] of each letter, in any coordinates.
    found
        Gain, word and angle, as `largest_gain` gives them.
    """
    if found[1]:
        repeatable(rules(language.constraint, language.modes), list(found[1]))
    return witness(
        lambda label: (beside(system, label, gains, "ABE"), beside(system, label, gains, "CDF")), pieces, found
    )


def witness(
    exact_of: Callable[[Any], tuple[ExactRows, ExactRows]], pieces: Pieces, found: tuple[float, Word, float]
) -> LowerBound | None:
    """Disturbances with which a repeated word has nearly the gain found, in fractions; None where there are none.

    Parameters
    ----------
    exact_of
        [G E] and [H F] of a letter.
    pieces
        [G, E, H, F] of each letter, in any coordinates.
    found
        Gain, word and angle, as `largest_gain` gives them.
    """
    value, word, angle = found
    if not word or not 0 < value < np.inf:
        return None
    tangent = np.tan(angle / 2)
    if abs(tangent) > TANGENT_MAX:
        word, tangent = (*word, *word), np.tan(angle - np.pi)
    exact = Fraction(round(float(tangent) * 10**12), 10**12)
    loop = period(pieces, word)
    point = np.exp(2j * np.arctan(float(exact)))
    _, _, directions = np.linalg.svd(
        loop[2] @ np.linalg.solve(point * np.eye(len(loop[0])) - loop[0], loop[1]) + loop[3]
    )
    best = directions[0].conj().reshape(len(word), -1)
    parts = np.hstack([best.real, best.imag])
    pushed = [[Fraction(round(float(x) * 10**PUSHED), 10**PUSHED) for x in row] for row in parts]
    both = [exact_of(label) for label in word]
    try:
        out, pushing = response(both, exact, pushed)
    except Refused:
        return None
    for slack in SLACKS:
        claimed = rounded_down(value * (1 - slack), DIGITS)
        if claimed**2 * pushing <= out:
            return LowerBound(claimed, word, exact, tuple(map(tuple, pushed)))
    return None


def beside(system: SwitchedSystem, label: Label, gains: Gains | None, names: str) -> ExactRows:
    """[A + B K, E] of a letter for "ABE", [C + D K, F] for "CDF", in fractions."""
    drive = system.exact_drive(label, gains, names[2] + names[1])
    return [[*one, *two] for one, two in zip(system.exact_loop(label, gains, names[:2]), drive, strict=True)]
