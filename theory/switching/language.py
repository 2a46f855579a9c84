"""Switching constraints as languages: one type, whatever the constraint.

A constraint has a definition (`theory.checker.rules`, the one the checker uses too), a minimal automaton made from it,
and, for dwell time, persistent dwell time and asynchronous dwell time, the thesis's words with concatenation list.
"""

from __future__ import annotations

import random
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np

from theory.checker import STEPS_MAX, Label, Refused, explored, rules
from theory.errors import IllPosedError, TooLargeError
from theory.switching.graph import Automaton, Graph, WordList, minimal
from theory.switching.system import exact_number
from theory.switching.words import WORDS_MAX, Word, blocks, portions, with_clocks

MODES_MAX = 1000
NUMBER_MAX = 1000
"""Largest dwell time, period, delay or clock [samples]."""
STATES_MAX = 5_000
"""States of a constraint's automaton before it is minimised."""


@dataclass(frozen=True)
class Language:
    """The admissible signals of a constraint over modes 1..`modes`.

    A signal begins with a switching instant (thesis: k_0 = 0). Make one with the constructors below.
    """

    constraint: Mapping[str, Any]
    modes: int

    def __post_init__(self) -> None:
        if isinstance(self.modes, bool) or not isinstance(self.modes, int):
            raise IllPosedError("modes", f"{self.modes!r:.40} is not a whole number")
        if not 1 <= self.modes <= MODES_MAX:
            raise IllPosedError("modes", f"{self.modes} is not within 1..{MODES_MAX}")

    def __hash__(self) -> int:
        return hash((repr(self.constraint), self.modes))

    @cached_property
    def automaton(self) -> Automaton:
        """The minimal automaton."""
        bound = _states(self.constraint, self.modes)
        if bound > STATES_MAX:
            raise TooLargeError("states of the constraint's automaton", bound, STATES_MAX)
        try:
            start, successors = rules(self.constraint, self.modes)
            return minimal(start, {state: successors(state) for state in explored(start, successors)})
        except Refused as error:
            if "moves to look at" in str(error):
                raise TooLargeError("moves of the constraint's automaton", STEPS_MAX + 1, STEPS_MAX) from error
            raise IllPosedError("constraint", str(error)) from error

    # ------------------------------------------------ words of the language

    def contains(self, word: Sequence[Label]) -> bool:
        """Whether an admissible signal begins with this word."""
        state: int | None = 0
        for label in word:
            if state is None:
                return False
            state = self.automaton.transitions[state].get(label)
        return state is not None

    def count(self, length: int) -> int:
        """The number of words of that length that begin an admissible signal."""
        return self.automaton.count(0, length)

    def enumerate(self, length: int) -> list[Word]:
        """All words of that length that begin an admissible signal; `TooLargeError` beyond a hundred thousand."""
        if (count := self.count(length)) > WORDS_MAX:
            raise TooLargeError(f"words of length {length}", count, WORDS_MAX)
        return self.automaton.words(0, length)

    def random(self, length: int, seed: int) -> Word:
        """The first letters of a random admissible signal: each next letter is drawn from those that may come."""
        chance = random.Random(seed)  # noqa: S311  # a signal, not a secret
        state, word = 0, []
        for _ in range(length):
            label, state = chance.choice(list(self.automaton.transitions[state].items()))
            word.append(label)
        return tuple(word)

    def repeats(self, word: Sequence[Label]) -> bool:
        """Whether some admissible signal ends in this word repeated infinitely."""
        states: set[int] = set(range(len(self.automaton.transitions)))
        while states:
            then: set[int] = set()
            for state in states:
                at: int | None = state
                for label in word:
                    at = None if at is None else self.automaton.transitions[at].get(label)
                if at is not None:
                    then.add(at)
            if then == states:
                return True
            states = then if then < states else then & states
        return False

    def periodic_words(self, longest: int, *, most: int | None = None) -> Iterator[Word]:
        """Every word up to that length that an admissible signal may repeat infinitely; each cycle once, none a power.

        Stops before a length with more than `most` closed walks.
        """
        step = np.zeros((len(self.automaton.transitions),) * 2)
        for state, leaving in enumerate(self.automaton.transitions):
            for to in leaving.values():
                step[state, to] += 1
        walks = np.eye(len(step))
        for length in range(1, longest + 1):
            walks = walks @ step
            if most is not None and np.trace(walks) > most:
                return
            cycles = {word for state in range(len(self.automaton.transitions)) for word in self._cycles(state, length)}
            for word in sorted(cycles, key=repr):
                turns = [word[i:] + word[:i] for i in range(length)]
                if word == min(turns, key=repr) and len(set(turns)) == length:
                    yield word

    def _cycles(self, state: int, length: int) -> Iterator[Word]:
        """Words that lead from a state back to it."""
        near = self._distances(state)

        def extend(at: int, word: Word) -> Iterator[Word]:
            left = length - len(word)
            if left == 0:
                if at == state:
                    yield word
                return
            for label, to in self.automaton.transitions[at].items():
                if near.get(to, length + 1) <= left - 1:
                    yield from extend(to, (*word, label))

        return extend(state, ())

    def _distances(self, target: int) -> dict[int, int]:
        arriving: dict[int, set[int]] = {}
        for state, leaving in enumerate(self.automaton.transitions):
            for to in leaving.values():
                arriving.setdefault(to, set()).add(state)
        found, front = {target: 0}, [target]
        for state in front:
            for one in arriving.get(state, ()):
                if one not in found:
                    found[one] = found[state] + 1
                    front.append(one)
        return found

    def missing(self, other: Language, *, whenever: bool = False) -> Word | None:
        """A shortest word of `other` that is none of this language, or None: then `other` is included.

        With `whenever`, signals may be watched from any moment of their life, not from a switching instant only:
        section 2.2.3's inclusion of average in persistent dwell time holds in that sense.
        """
        ours, theirs = self.automaton.transitions, other.automaton.transitions
        everywhere = frozenset(range(len(ours)))
        front: dict[tuple[int, frozenset[int]], Word] = {}
        for state in range(len(theirs)) if whenever else (0,):
            front[state, everywhere if whenever else frozenset({0})] = ()
        waiting = list(front)
        for pair in waiting:
            for label, to in theirs[pair[0]].items():
                then = frozenset(ours[at][label] for at in pair[1] if label in ours[at])
                if (to, then) not in front:
                    front[to, then] = (*front[pair], label)
                    if not then:
                        return front[to, then]
                    waiting.append((to, then))
        return None

    # ------------------------------------------------ graphs of the language

    def clocked(self, clock: int) -> Language:
        """The same signals with letters (mode, mode, clock): the clock counts from each switch and stays at `clock`."""
        if self.constraint["kind"] in {"clocked", "asynchronous"}:
            raise IllPosedError(
                "clock", f"letters of a constraint of kind {self.constraint['kind']!r} have a clock already"
            )
        return Language(
            {"kind": "clocked", "of": dict(self.constraint), "clock": _whole(clock, "clock", 0)}, self.modes
        )

    def graph(self, look_ahead: int = 0) -> Graph:
        """The minimal automaton with a node for each state and its next `look_ahead` letters."""
        return self.automaton.look_ahead(look_ahead)

    def words(self, lift: int = 1, *, share_matrices: bool = False) -> WordList:
        """The thesis's words: Table 3.1 lifted by W, or Steps 1-4 of section 4.3 with L (Step 5 loses signals).

        For letters with a clock each word has a copy that begins at clock 0 and one that begins at the last clock
        ((4.25)-(4.28)); `share_matrices`, as printed, gives both copies the same matrices.
        """
        kind, of = self.constraint["kind"], self.constraint
        if kind == "asynchronous":
            return blocks(self.modes, of["tau"], of["delay"]).lifted(lift)
        clock = of["clock"] if kind == "clocked" else None
        inner = of["of"] if kind == "clocked" else of
        if inner["kind"] not in {"dwell", "persistent"}:
            raise IllPosedError("constraint", f"the thesis has no words for kind {inner['kind']!r}; use the automaton")
        if clock is not None and clock > inner["tau"]:
            raise IllPosedError(
                "clock", f"{clock} exceeds tau = {inner['tau']}: the words do not tell it; use the automaton"
            )
        plain = portions(self.modes, inner["tau"], inner.get("period", 0), lift)
        return plain if clock is None else with_clocks(plain, clock, inner["tau"], share_matrices=share_matrices)


# ---------------------------------------------------------------- constructors


def ArbitrarySwitching(*, modes: int) -> Language:  # noqa: N802  # they read as types
    """Any mode at any instant."""
    return Language({"kind": "arbitrary"}, modes)


def DwellTime(tau: int, *, modes: int) -> Language:  # noqa: N802
    """At least `tau` samples between switches (Definition 2.14)."""
    return Language({"kind": "dwell", "tau": _whole(tau, "tau", 1)}, modes)


def AverageDwellTime(tau: Any, burst: Any = 1, *, modes: int) -> Language:  # noqa: N802
    """At most `burst` + (t - s) / `tau` switches in every interval [s, t] (Definition 2.16, read over every interval).

    Both may be fractions. The first instant counts as a switch, as in the other constraints: burst 1 is dwell time.
    """
    values = {"tau": exact_number(tau, "tau"), "burst": exact_number(burst, "burst")}
    for name, value in values.items():
        if not 1 <= value <= NUMBER_MAX:
            raise IllPosedError(name, f"{value} is not within 1..{NUMBER_MAX}")
    return Language({"kind": "average", **{name: str(value) for name, value in values.items()}}, modes)


def PersistentDwellTime(tau: int, period: int, *, modes: int) -> Language:  # noqa: N802
    """Portions of at least `tau` samples in one mode, at most `period` (thesis: T) apart (Definition 2.15)."""
    return Language({"kind": "persistent", "tau": _whole(tau, "tau", 1), "period": _whole(period, "period", 0)}, modes)


def Asynchronous(tau: int, delay: int, *, modes: int) -> Language:  # noqa: N802
    """Dwell time `tau`; after a switch the old gain acts for up to `delay` (thesis: Delta) < tau samples more."""
    constraint = {"kind": "asynchronous", "tau": _whole(tau, "tau", 1), "delay": _whole(delay, "delay", 0)}
    if delay >= tau:
        raise IllPosedError("delay", f"{delay} is not below tau = {tau}: the right gain might never act")
    return Language(constraint, modes)


def LabelledGraph(  # noqa: N802
    edges: Sequence[tuple[Any, int, Any]], initial: Sequence[Any] = (), *, modes: int
) -> Language:
    """Signals are the paths of a graph with edges (from, mode, to), beginning at any of `initial` (default: all)."""
    for name, value in (("edges", edges), ("initial", initial)):
        if not isinstance(value, list | tuple):
            raise IllPosedError(name, "has to be a list")
    if not edges:
        raise IllPosedError("edges", "a graph needs at least one edge")
    if not all(isinstance(node, int | str) for node in initial):
        raise IllPosedError("initial", "nodes are named by integers or texts")
    for number, edge in enumerate(edges, 1):
        if not isinstance(edge, list | tuple) or len(edge) != 3:
            raise IllPosedError(f"edges.{number}", "has to be [from, mode, to]")
        if not isinstance(edge[1], int) or not 1 <= edge[1] <= modes:
            raise IllPosedError(f"edges.{number}", f"mode {edge[1]!r} is not within 1..{modes}")
        if not all(isinstance(end, int | str) for end in (edge[0], edge[2])):
            raise IllPosedError(f"edges.{number}", "nodes are named by integers or texts")
    leaving = {edge[0] for edge in edges}
    if stuck := sorted(({edge[2] for edge in edges} | set(initial)) - leaving, key=str):
        raise IllPosedError("edges", f"node {stuck[0]!r} is a dead end: no edge leaves it")
    return Language({"kind": "graph", "edges": [list(edge) for edge in edges], "initial": list(initial)}, modes)


def language_of(constraint: Mapping[str, Any], modes: int) -> Language:
    """The language that a constraint's description names, its numbers checked; problem files hold such descriptions."""
    if not isinstance(constraint, Mapping) or not isinstance(constraint.get("kind"), str):
        raise IllPosedError("constraint.kind", "is missing")
    given = dict(constraint)
    kind = given.pop("kind")
    made = {"arbitrary": ArbitrarySwitching, "dwell": DwellTime, "average": AverageDwellTime,
            "persistent": PersistentDwellTime, "asynchronous": Asynchronous, "graph": LabelledGraph}  # fmt: skip
    names = {"arbitrary": (), "dwell": ("tau",), "average": ("tau", "burst"), "persistent": ("tau", "period"),
             "asynchronous": ("tau", "delay"), "graph": ("edges", "initial")}  # fmt: skip
    if kind not in made:
        raise IllPosedError("constraint.kind", f"{kind!r} is none of {', '.join(made)}")
    unknown = [name for name in given if name not in names[kind]]
    needed = [name for name in names[kind] if name not in given and name not in {"burst", "initial"}]
    if unknown or needed:
        what = f"unknown {unknown[0]!r}" if unknown else f"{needed[0]!r} is missing"
        raise IllPosedError("constraint", f"{what}; kind {kind!r} has {', '.join(names[kind]) or 'no numbers'}")
    language: Language = made[kind](**given, modes=modes)  # type: ignore[operator]
    return language


def persistent_around(tau: Any, burst: Any, share: Any) -> tuple[int, int]:
    """(tau, period) of a persistent dwell time that includes an average dwell time (section 2.2.3), 0 < share < 1."""
    one, two, delta = (exact_number(item, name) for item, name in ((tau, "tau"), (burst, "burst"), (share, "share")))
    if not 0 < delta < 1:
        raise IllPosedError("share", f"{delta} is not between 0 and 1")
    return -(-delta * one // 1).__int__() or 1, int(delta * one * (two - delta) / (1 - delta) // 1)


def _states(constraint: Mapping[str, Any], modes: int) -> int:
    """An upper bound of the states of a constraint's automaton."""
    kind, tau = constraint["kind"], constraint.get("tau", 1)
    if kind == "average":
        step = Fraction(tau)
        return 1 + modes * int(
            Fraction(constraint["burst"]) * step.numerator * Fraction(constraint["burst"]).denominator + 1
        )
    if kind == "clocked":
        return _states(constraint["of"], modes) * (constraint["clock"] + 1)
    if kind == "asynchronous":
        return 1 + modes * (tau + (modes - 1) * constraint["delay"])
    if kind == "graph":
        return len({edge[0] for edge in constraint["edges"]})
    return 1 + modes * tau * (constraint.get("period", 0) + 1) if kind != "arbitrary" else 1


def _whole(value: Any, name: str, low: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int):
        raise IllPosedError(name, f"{value!r:.40} is not a whole number of samples")
    if not low <= value <= NUMBER_MAX:
        raise IllPosedError(name, f"{value} is not within {low}..{NUMBER_MAX} samples")
    return value
