"""Loops of a plant with parameters at any point, and bounds from below: words with courses of parameters."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np

from theory.arrays import Array
from theory.checker import Label, multiply, parameters, spelled
from theory.errors import NotCertifiedError
from theory.switching import periodic
from theory.switching.coordinates import of_maps
from theory.switching.language import Language
from theory.switching.loops import check_fit, labels_of
from theory.switching.periodic import LowerBound, Word
from theory.switching.system import Gains, SwitchedSystem, closed_by
from theory.switching.varying_system import VaryingSystem

GRID = (Fraction(0), Fraction(1, 4), Fraction(1, 2), Fraction(3, 4), Fraction(1))
"""Shares of the way from the least to the most at which constant parameters, and the ends of waves, are tried."""

WAVE_MAX = 40
"""Longest period of a wave, in samples."""

WORD_MAX = 4

WALKS_MAX = 60
"""Lengths with more words than these are not tried."""

COURSES_MAX = 1000
"""Courses of parameters that are tried."""

Piece = tuple[Array, Array, Array, Array]

Course = list[tuple[Fraction, ...]]


class VaryingLoop:
    """A plant with parameters under its gains, in coordinates in which its loops at all corners are near contractions.

    Parameters
    ----------
    system, language, gains
        The plant, its signals, and gains for letters that tell some.
    kind
        `stability`, or `gain` with outputs and disturbances.
    """

    def __init__(self, system: VaryingSystem, language: Language, gains: Gains | None, kind: str) -> None:
        self.system, self.language, self.gains, self.kind = system, language, gains, kind
        self._made: dict[tuple[Fraction, ...], SwitchedSystem] = {}
        check_fit(self.at(parameters.box(system.ranges)[0]), language, gains)
        self.labels, self.corners = labels_of(language), parameters.corners(system.ranges)
        every = itertools.product(parameters.box(system.ranges), self.labels)
        self.turn = of_maps([self.at(point).exact_loop(label, gains) for point, label in every])

    def at(self, point: Sequence[Fraction]) -> SwitchedSystem:
        """The system on which gains act, where parameters have these values."""
        found = self._made.get(tuple(point))
        if found is None:
            found = self._made[tuple(point)] = closed_by(self.system.at(point), self.gains)
        return found

    def shares(self, point: Sequence[Fraction]) -> tuple[float, ...]:
        """1, and of each parameter the share of the way from its least to its most."""
        pairs = zip(point, self.system.ranges, strict=True)
        return (1.0, *(float((x - low) / (high - low)) for x, (low, high, _) in pairs))

    @cached_property
    def _pieces(self) -> list[dict[Label, Piece]]:
        """[G, E, H, F] of every letter where all parameters are least, and what each adds on its way to its most."""
        lows = [low for low, _, _ in self.system.ranges]
        points = [lows, *([high if i == k else low for i, low in enumerate(lows)]
                          for k, (_, high, _) in enumerate(self.system.ranges))]  # fmt: skip
        found = [{label: self._piece(point, label) for label in self.labels} for point in points]
        added = [{label: _less(one[label], found[0][label]) for label in self.labels} for one in found[1:]]
        return [found[0], *added]

    def _piece(self, point: Sequence[Fraction], label: Any) -> Piece:
        system, n = self.at(point), self.turn.size
        loop = self.turn.loop(system.exact_loop(label, self.gains))
        if self.kind != "gain":
            return loop, np.zeros((n, 0)), np.zeros((0, n)), np.zeros((0, 0))
        direct = np.array([[float(x) for x in row] for row in system.exact_drive(label, self.gains, "FD")])
        drive = self.turn.drive(system.exact_drive(label, self.gains))
        return loop, drive, self.turn.output(system.exact_loop(label, self.gains, "CD")), direct

    def pieces(self, label: Any, shares: Sequence[float]) -> Piece:
        """[G, E, H, F] of a letter at a point."""
        parts = [each[label] for each in self._pieces]
        made = [sum((share * x for share, x in zip(shares, items, strict=True)), np.zeros(items[0].shape))
                for items in zip(*parts, strict=True)]  # fmt: skip
        return made[0], made[1], made[2], made[3]

    def _courses(self) -> Iterator[tuple[Word, Course]]:
        """Words with courses of parameters: constant ones, and waves as steep as the rates allow."""
        count = len(self.system.ranges)
        grid = list(itertools.product(GRID if count <= 2 else GRID[::4], repeat=count))
        steps = [step / (high - low) for low, high, step in self.system.ranges]
        tried = 0
        for word in periodic.short_words(self.language, WORD_MAX, WALKS_MAX):
            lengths = [len(word) * k for k in range(2, 1 + WAVE_MAX // len(word)) if len(word) * k % 2 == 0]
            for begin in grid:
                yield word, [begin] * len(word)
                for length, ups in itertools.product(
                    lengths[:4] + lengths[4::4], itertools.product((1, -1), repeat=count)
                ):
                    rise = [min(k, length - k) for k in range(length)]
                    course = [tuple(min(max(x + up * k * step, Fraction(0)), Fraction(1))
                                    for x, up, step in zip(begin, ups, steps, strict=True)) for k in rise]  # fmt: skip
                    yield word * (length // len(word)), course
                    tried += 1
                    if tried > COURSES_MAX:
                        return

    def _points(self, course: Sequence[Sequence[Fraction]]) -> tuple[tuple[Fraction, ...], ...]:
        return tuple(tuple(low + x * (high - low) for x, (low, high, _) in zip(point, self.system.ranges, strict=True))
                     for point in course)  # fmt: skip

    def slowest(self) -> LowerBound | None:
        """The slowest decay among words with courses of parameters, proved."""
        best: tuple[float, Word, Course] = (0.0, (), [])
        for word, course in self._courses():
            product = np.eye(self.turn.size)
            for label, point in zip(word, course, strict=True):
                product = self.pieces(label, (1.0, *map(float, point)))[0] @ product
            rate = float(np.abs(np.linalg.eigvals(product)).max()) ** (1 / len(word))
            if rate > best[0] * (1 + 1e-9):
                best = (rate, word, course)
        rate, word, course = best
        points = self._points(course)
        exact: list[list[Any]] = [[Fraction(i == j) for j in range(self.turn.size)] for i in range(self.turn.size)]
        for label, point in zip(word, points, strict=True):
            exact = multiply(self.at(point).exact_loop(label, self.gains), exact)
        value = periodic.claimed_rate(exact, rate, len(word)) if word else None
        return None if value is None else LowerBound(value, word, path=points)

    def largest(self) -> LowerBound | None:
        """The largest gain among words with courses of parameters, proved.

        Raises
        ------
        NotCertifiedError
            One of them does not decay.
        """
        best: tuple[float, float, Word, Course] = (0.0, 0.0, (), [])
        for word, course in self._courses():
            value, angle = periodic.coarse_gain(self._along(word, course), tuple(range(len(word))))
            if value == math.inf:
                course_text = spelled(self._points(course))
                raise NotCertifiedError(
                    f"no l2 gain is finite: {spelled(word)} with parameters {course_text} does not decay"
                )
            best = max(best, (value, angle, word, course), key=lambda one: one[0])
        value, angle, word, course = best
        if not value > 0:
            return None
        points, letters = self._points(course), tuple(range(len(word)))
        pieces = self._along(word, course)

        def exact(k: int) -> tuple[periodic.ExactRows, periodic.ExactRows]:
            system, label = self.at(points[k]), word[k]
            return periodic.beside(system, label, self.gains, "ABE"), periodic.beside(system, label, self.gains, "CDF")

        value, angle = periodic.refined_gain(pieces, letters, (value, angle))
        made = periodic.witness(exact, pieces, (value, letters, angle))
        if made is None:
            return None
        times = len(made.word) // len(word)
        return replace(made, word=word * times, path=points * times)

    def _along(self, word: Word, course: Course) -> dict[Label, Piece]:
        """[G, E, H, F] of every letter of a word, by its place."""
        pairs = enumerate(zip(word, course, strict=True))
        return {k: self.pieces(label, (1.0, *map(float, point))) for k, (label, point) in pairs}


def _less(one: Piece, two: Piece) -> Piece:
    return one[0] - two[0], one[1] - two[1], one[2] - two[2], one[3] - two[3]
