"""The thesis's words with their concatenation lists: Table 3.1, and Steps 1-4 of section 4.3."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

from theory.checker import Label
from theory.errors import TooLargeError
from theory.switching.graph import EDGES_MAX, WordList, check_lift

WORDS_MAX = 100_000

Word = tuple[Label, ...]


def blocks(modes: int, tau: int, delay: int) -> WordList:
    """Table 3.1: synchronous, asynchronous and free blocks, and which may follow which.

    Parameters
    ----------
    modes
        N.
    tau, delay
        Of the asynchronous dwell time, samples.
    """
    every = range(1, modes + 1)
    blocks: dict[tuple[Any, ...], Word] = {}
    for i in every:
        blocks["s", i] = tuple((i, i, clock) for clock in range(tau))
        blocks["f", i] = ((i, i, tau),)
        for j, late in itertools.product(every, range(1, delay + 1)):
            if j != i:
                blocks["a", i, j, late] = ((i, j, tau),) * late + tuple((i, i, clock) for clock in range(late, tau))
    numbers = {key: number for number, key in enumerate(blocks)}
    followers = []
    for key in blocks:
        mode = key[1]
        found: list[tuple[Any, ...]] = [("f", mode)] + [("s", i) for i in every if i != mode]
        found += [("a", i, mode, late) for i in every if i != mode for late in range(1, delay + 1)]
        followers.append(tuple(numbers[follower] for follower in found))
    return WordList(tuple(blocks.values()), tuple(followers))


def portions(modes: int, tau: int, period: int, lift: int) -> WordList:
    """Steps 1-4 of section 4.3.

    Parameters
    ----------
    modes
        N.
    tau, period
        Of the persistent dwell time, samples.
    lift
        L.
    """
    every = range(1, modes + 1)
    gaps: list[Word] = []
    growing: list[Word] = [(i,) for i in every] if tau > 1 else []
    for _ in range(period):
        gaps += growing
        if len(gaps) > WORDS_MAX:
            raise TooLargeError("primary words", len(gaps), WORDS_MAX)
        growing = [(*word, i) for word in growing for i in every if _last_run((*word, i)) < tau]
    portions = [(i,) * length for i in every for length in range(tau, 2 * tau)]
    primary = portions + [(*p, *q) for p in portions for q in gaps if p[-1] != q[0]]
    check_lift(lift)
    if len(primary) ** lift > WORDS_MAX:
        raise TooLargeError(f"words of lift {lift}", len(primary) ** lift, WORDS_MAX)
    words = list(dict.fromkeys(tuple(itertools.chain(*parts)) for parts in itertools.product(primary, repeat=lift)))
    first: dict[Label, list[int]] = {}
    for number, word in enumerate(words):
        first.setdefault(word[0], []).append(number)
    count = sum(
        len(found) for word in words for mode, found in first.items() if mode != word[-1] or _last_run(word) >= tau
    )
    if count > EDGES_MAX:
        raise TooLargeError(f"concatenations of lift {lift}", count, EDGES_MAX)
    followers = []
    for word in words:
        long = _last_run(word) >= tau
        followers.append(tuple(k for mode, found in first.items() if long or mode != word[-1] for k in found))
    return WordList(tuple(words), tuple(followers))


def with_clocks(plain: WordList, clock: int, tau: int, *, share_matrices: bool) -> WordList:
    """Each word twice: its first run begins at clock 0, or continues at the last clock ((4.25)-(4.28))."""
    count = len(plain.words)

    def clocked(word: Word, begin: int) -> Word:
        letters, now = [], begin
        for place, mode in enumerate(word):
            if place and word[place - 1] != mode:
                now = 0
            letters.append((int(str(mode)), int(str(mode)), now))
            now = min(now + 1, clock)
        return tuple(letters)

    words = [clocked(word, 0) for word in plain.words] + [clocked(word, clock) for word in plain.words]
    followers = []
    for word, found in zip(plain.words * 2, plain.successors * 2, strict=True):
        same = [j for j in found if plain.words[j][0] == word[-1] and _last_run(word) >= tau]
        followers.append(tuple([j for j in found if plain.words[j][0] != word[-1]] + [j + count for j in same]))
    twins: tuple[int | None, ...] = (*(None,) * count, *range(count)) if share_matrices else ()
    return WordList(tuple(words), tuple(followers), twins)


def _last_run(word: Sequence[Label]) -> int:
    return sum(1 for _ in itertools.takewhile(lambda mode: mode == word[-1], reversed(word)))
