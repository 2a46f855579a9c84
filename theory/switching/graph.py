"""Graphs along which matrices have to decrease: an automaton looked ahead, or words with a concatenation list."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from theory.checker import Label, Refused, explored, spelled
from theory.errors import IllPosedError, TooLargeError

COUNT_MAX = 10**30

EDGES_MAX = 200_000
"""Edges and jumps together; beyond, solving takes hours. Estimated before a graph is built."""


LIFT_MAX = 60


def check_lift(lift: int) -> None:
    """Raise unless a lift of words is a whole number from 1 on."""
    if not isinstance(lift, int) or not 1 <= lift <= LIFT_MAX:
        raise IllPosedError("lift", f"{lift!r:.40} is not a whole number within 1..{LIFT_MAX}")


@dataclass(frozen=True)
class Graph:
    """One matrix a node, one inequality an edge and a jump. A signal is a path; jumps take no time."""

    nodes: int
    edges: tuple[tuple[int, Label, int], ...]
    jumps: tuple[tuple[int, int], ...] = ()
    names: tuple[str, ...] = ()  # of the nodes, for people

    @property
    def inequalities(self) -> int:
        """Number of matrix inequalities besides the positivity of the nodes' matrices."""
        return len(self.edges) + len(self.jumps)

    @property
    def labels(self) -> tuple[Label, ...]:
        """The letters on the edges, each once."""
        return tuple(dict.fromkeys(label for _, label, _ in self.edges))


@dataclass(frozen=True)
class WordList:
    """Words and which may follow which: the thesis's representation (Definitions 4.3 and 4.4, Table 3.1)."""

    words: tuple[tuple[Label, ...], ...]
    successors: tuple[tuple[int, ...], ...]
    twins: tuple[int | None, ...] = ()  # word whose matrices this word shares, where a theorem is applied as printed

    def lifted(self, lift: int) -> WordList:
        """Sequences of `lift` words that do not overlap (section 3.3: W; section 4.3: L)."""
        check_lift(lift)
        paths: list[tuple[int, ...]] = [(i,) for i in range(len(self.words))]
        for _ in range(lift - 1):
            count = sum(len(self.successors[path[-1]]) for path in paths)
            if count > EDGES_MAX:
                raise TooLargeError("words of this lift", count, EDGES_MAX)
            paths = [(*path, j) for path in paths for j in self.successors[path[-1]]]
        first: dict[int, list[int]] = {}
        for number, path in enumerate(paths):
            first.setdefault(path[0], []).append(number)
        count = sum(len(first.get(j, ())) for path in paths for j in self.successors[path[-1]])
        if count > EDGES_MAX:
            raise TooLargeError("concatenations of this lift", count, EDGES_MAX)
        return WordList(
            tuple(tuple(letter for i in path for letter in self.words[i]) for path in paths),
            tuple(tuple(k for j in self.successors[path[-1]] for k in first.get(j, ())) for path in paths),
        )

    def graph(self) -> Graph:
        """A node a word and place, an edge a letter, a jump a concatenation."""
        begin: list[int] = []
        count = 0
        for number, word in enumerate(self.words):
            twin = self.twins[number] if self.twins else None
            begin.append(count if twin is None else begin[twin])
            count += len(word) + 1 if twin is None else 0
        edges = dict.fromkeys(
            (at + place, letter, at + place + 1)
            for at, word in zip(begin, self.words, strict=True)
            for place, letter in enumerate(word)
        )
        jumps = dict.fromkeys(
            (at + len(word), begin[follower])
            for at, word, followers in zip(begin, self.words, self.successors, strict=True)
            for follower in followers
        )
        names = {
            at + place: f"{spelled(word[:place])} | {spelled(word[place:])}".strip()
            for at, word in zip(begin, self.words, strict=True)
            for place in range(len(word) + 1)
        }
        if len(edges) + len(jumps) > EDGES_MAX:
            raise TooLargeError("edges and jumps", len(edges) + len(jumps), EDGES_MAX)
        return Graph(count, tuple(edges), tuple(jumps), tuple(names[node] for node in range(count)))


@dataclass(frozen=True)
class Automaton:
    """A deterministic automaton without dead ends, all of whose states accept; state 0 is the start."""

    transitions: tuple[dict[Label, int], ...]

    def look_ahead(self, length: int) -> Graph:
        """A node for each state and each of its next `length` letters: one matrix per (state, next letters)."""
        if not isinstance(length, int) or not 0 <= length <= LIFT_MAX:
            raise IllPosedError("lift", f"{length!r:.40} is not a whole number within 0..{LIFT_MAX}")
        states = self._recurrent()
        count = sum(self.count(state, length + 1) for state in states)
        if count > EDGES_MAX:
            raise TooLargeError(f"inequalities with {length} letters looked ahead", count, EDGES_MAX)
        nodes = {
            (state, word): number
            for number, (state, word) in enumerate((s, w) for s in states for w in self.words(s, length))
        }
        edges = [
            (number, word[0], nodes[self.transitions[state][word[0]], word[1:]])
            for state in states
            for word in self.words(state, length + 1)
            for number in [nodes[state, word[:-1]]]
            if (self.transitions[state][word[0]], word[1:]) in nodes
        ]
        names = tuple(f"state {state}" + (f", next {spelled(word)}" if word else "") for state, word in nodes)
        return Graph(len(nodes), tuple(edges), (), names)

    def _recurrent(self) -> list[int]:
        """States on a cycle, and those after cycles, if every signal can be read from one of them; else all states.

        The others are visited once at most, at the beginning; matrices for them would only cost time.
        """
        arriving = [0] * len(self.transitions)
        for leaving in self.transitions:
            for state in leaving.values():
                arriving[state] += 1
        passed = [state for state, count in enumerate(arriving) if count == 0]
        for state in passed:
            for then in self.transitions[state].values():
                arriving[then] -= 1
                if arriving[then] == 0:
                    passed.append(then)
        states = [state for state in range(len(self.transitions)) if state not in set(passed)]
        return states if self._reads_all(states) else list(range(len(self.transitions)))

    def _reads_all(self, states: Sequence[int]) -> bool:
        """Whether every word from the start can be read from one of these states."""

        def step(pair: tuple[int, frozenset[int]]) -> dict[Label, tuple[int, frozenset[int]]]:
            return {
                x: (to, frozenset(self.transitions[at][x] for at in pair[1] if x in self.transitions[at]))
                for x, to in self.transitions[pair[0]].items()
            }

        try:
            return all(pair[1] for pair in explored((0, frozenset(states)), step))
        except Refused:  # too many to say
            return False

    def words(self, state: int, length: int) -> list[tuple[Label, ...]]:
        """Every word of that length that can be read from a state."""
        found: list[tuple[tuple[Label, ...], int]] = [((), state)]
        for _ in range(length):
            found = [((*word, x), to) for word, at in found for x, to in self.transitions[at].items()]
        return [word for word, _ in found]

    def count(self, state: int, length: int) -> int:
        """The number of words of that length that can be read from a state."""
        counts = [1] * len(self.transitions)
        for _ in range(length):
            counts = [sum(counts[to] for to in leaving.values()) for leaving in self.transitions]
            if min(counts) > COUNT_MAX:
                break  # no limit is so high, and the numbers only grow longer
        return counts[state]


def minimal(start: object, transitions: dict[object, dict[Label, object]]) -> Automaton:
    """The smallest automaton of the same signals: dead ends taken away, states with the same future merged (Moore)."""
    alive = dict(transitions)
    while dead := {state for state, leaving in alive.items() if not any(to in alive for to in leaving.values())}:
        alive = {state: leaving for state, leaving in alive.items() if state not in dead}
    if start not in alive:
        raise IllPosedError("constraint", "admits no infinite signal")
    moves = {state: {x: to for x, to in leaving.items() if to in alive} for state, leaving in alive.items()}
    block = dict.fromkeys(moves, 0)
    while True:
        keys = {
            state: (block[state], frozenset((x, block[to]) for x, to in leaving.items()))
            for state, leaving in moves.items()
        }
        numbers: dict[object, int] = {keys[start]: 0}
        for key in keys.values():
            numbers.setdefault(key, len(numbers))
        if len(numbers) == len(set(block.values())):
            break
        block = {state: numbers[key] for state, key in keys.items()}
    block = {state: numbers[key] for state, key in keys.items()}
    merged: dict[int, dict[Label, int]] = {}
    for state, leaving in moves.items():
        merged.setdefault(block[state], {x: block[to] for x, to in leaving.items()})
    return Automaton(tuple(merged[number] for number in range(len(numbers))))
