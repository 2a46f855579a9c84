"""Languages against their definitions, by brute force: words, automata and definitions give the same signals."""

from __future__ import annotations

import itertools
import random
from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from theory import (
    ArbitrarySwitching,
    Asynchronous,
    AverageDwellTime,
    DwellTime,
    IllPosedError,
    LabelledGraph,
    Language,
    PersistentDwellTime,
    TooLargeError,
    language_of,
    persistent_around,
)
from theory.checker import Refused, covered, rules
from theory.switching.graph import WordList

LENGTH = 8


def runs(word):
    return [(mode, len(list(group))) for mode, group in itertools.groupby(word)]


def is_dwell(word, tau):
    """Definition 2.14, of a prefix: every run that has ended has at least tau samples."""
    return all(length >= tau for _, length in runs(word)[:-1])


def is_persistent(word, tau, period):
    """Definition 2.15, of a prefix that begins with a portion: some runs of tau or more, at most `period` apart."""
    lengths = [length for _, length in runs(word)]
    if not lengths:
        return True
    if len(lengths) > 1 and lengths[0] < tau:
        return False
    gap = 0
    for length in lengths[1:-1]:
        gap = 0 if length >= tau else gap + length
        if gap > period:
            return False
    return True  # the last run may still grow into a portion


def is_average(word, tau, burst):
    """Definition 2.16 over every interval; k = 0 counts as a switch."""
    switches = [k for k in range(len(word)) if k == 0 or word[k] != word[k - 1]]
    return all(
        j - i + 1 <= burst + Fraction(switches[j] - switches[i]) / tau
        for i in range(len(switches))
        for j in range(i, len(switches))
    )


def asynchronous_words(modes, tau, delay, length):
    """Section 3.2 literally: a dwell-time signal, and after each switch but the first a delay of its own."""
    found = set()
    for signal in itertools.product(range(1, modes + 1), repeat=length):
        if not is_dwell(signal, tau):
            continue
        starts = [k for k in range(length) if k == 0 or signal[k] != signal[k - 1]]
        for delays in itertools.product(range(delay + 1), repeat=len(starts) - 1):
            word = []
            for k, mode in enumerate(signal):
                place = max(i for i, start in enumerate(starts) if start <= k)
                since = k - starts[place]
                late = place > 0 and since < delays[place - 1]
                word.append((mode, signal[starts[place] - 1], tau) if late else (mode, mode, min(since, tau)))
            found.add(tuple(word))
    return found


def _steps(graph):
    """Nodes that each node reaches without a letter; (letter, node) of the edges that leave it."""
    silent: dict[int, set[int]] = {}
    for u, v in graph.jumps:
        silent.setdefault(u, set()).add(v)
    leaving: dict[int, list] = {}
    for u, label, v in graph.edges:
        leaving.setdefault(u, []).append((label, v))
    return silent, leaving


def path_words(graph, length):
    """Every word of that length along the paths of a graph."""
    silent, leaving = _steps(graph)

    def closed(nodes):
        nodes = set(nodes)
        while more := {v for u in nodes for v in silent.get(u, ())} - nodes:
            nodes |= more
        return frozenset(nodes)

    words = {((), closed(range(graph.nodes)))}
    for _ in range(length):
        grown: dict[tuple, set] = {}
        for word, nodes in words:
            for node in nodes:
                for label, v in leaving.get(node, ()):
                    grown.setdefault((*word, label), set()).add(v)
        words = {(word, closed(nodes)) for word, nodes in grown.items()}
    return {word for word, _ in words}


def started(graph, begin, length):
    """Words along paths that begin at the first letter of a word of the list."""
    silent, leaving = _steps(graph)
    found = {((), node) for node in begin}
    for _ in range(length):
        found = {((*word, label), v) for word, node in found for label, v in leaving.get(node, ())}
        found |= {(word, v) for word, node in found for v in silent.get(node, ())}
    return {word for word, _ in found}


@pytest.mark.parametrize("modes", [1, 2, 3])
@pytest.mark.parametrize("tau", [1, 2, 3, 4])
def test_dwell_time(modes, tau):
    length = 7 if modes == 3 else LENGTH
    language = DwellTime(tau, modes=modes)
    expected = {w for w in itertools.product(range(1, modes + 1), repeat=length) if is_dwell(w, tau)}
    assert set(language.enumerate(length)) == expected
    assert language.count(length) == len(expected)
    check_words(language, 1, length, expected)


@pytest.mark.parametrize(
    ("modes", "tau", "period"),
    [
        (1, 2, 1),
        (2, 1, 1),
        (2, 1, 3),
        (2, 2, 0),
        (2, 2, 1),
        (2, 2, 2),
        (2, 2, 3),
        (2, 3, 1),
        (2, 3, 2),
        (2, 4, 3),
        (3, 2, 1),
    ],
)
def test_persistent_dwell_time(modes, tau, period):
    length = 7 if modes == 3 else 10
    language = PersistentDwellTime(tau, period, modes=modes)
    every = itertools.product(range(1, modes + 1), repeat=length)
    expected = {word for word in every if is_persistent(word, tau, period)}
    assert set(language.enumerate(length)) == expected
    check_words(language, 1, length, expected)
    if modes == 2 and tau <= 2:
        check_words(language, 2, length, expected)


@pytest.mark.parametrize(
    ("modes", "tau", "delay", "length"),
    [(2, 1, 0, 7), (2, 2, 0, 7), (2, 2, 1, 7), (2, 3, 1, 8), (2, 3, 2, 8), (2, 4, 3, 8), (3, 2, 1, 6), (3, 3, 2, 6)],
)
def test_asynchronous(modes, tau, delay, length):
    language = Asynchronous(tau, delay, modes=modes)
    expected = asynchronous_words(modes, tau, delay, length)
    assert set(language.enumerate(length)) == expected
    for lift in (1, 2):
        check_words(language, lift, length, expected)


def check_words(language, lift, length, expected):
    """The words generate exactly the signals that begin with one of them, and every signal besides."""
    words = language.words(lift)
    graph = words.graph()
    begins = {0}
    place = 0
    for word in words.words:
        begins.add(place)
        place += len(word) + 1
    if language.constraint["kind"] == "asynchronous":  # a signal begins with a synchronous block
        begins = {u for u, label, _ in graph.edges if u in begins and label[2] == 0}
    assert started(graph, begins, length) == expected
    assert path_words(language.graph(0), 5) == path_words(graph, 5)
    assert path_words(language.graph(1), 5) == path_words(graph, 5)
    assert covered(rules(language.constraint, language.modes), graph.nodes, [*graph.edges, *graph.jumps]) > 1


@pytest.mark.parametrize(
    ("tau", "burst"), [("1", "1"), ("2", "1"), ("3", "2"), ("5/2", "2"), ("3/2", "3/2"), ("4", "3")]
)
def test_average_dwell_time(tau, burst):
    language = AverageDwellTime(tau, burst, modes=2)
    every = itertools.product((1, 2), repeat=9)
    assert set(language.enumerate(9)) == {w for w in every if is_average(w, Fraction(tau), Fraction(burst))}


@pytest.mark.parametrize("tau", [1, 2, 3, 5])
def test_dwell_time_is_average_with_burst_one_and_persistent_with_period_zero(tau):
    languages = [DwellTime(tau, modes=3), AverageDwellTime(tau, 1, modes=3), PersistentDwellTime(tau, 0, modes=3)]
    for one, two in itertools.permutations(languages, 2):
        assert one.missing(two) is None
        assert len(one.automaton.transitions) == len(two.automaton.transitions)


@pytest.mark.parametrize(
    ("tau", "burst", "share"), [(4, 2, "1/2"), (3, 2, "1/3"), ("5/2", 3, "1/2"), (4, 3, "3/4"), (6, 2, "2/3")]
)
def test_average_is_included_in_persistent_dwell_time(tau, burst, share):
    average = AverageDwellTime(tau, burst, modes=2)
    least, period = persistent_around(tau, burst, share)
    assert PersistentDwellTime(least, period, modes=2).missing(average, whenever=True) is None


def test_a_word_that_is_missing_is_one():
    longer, shorter = DwellTime(3, modes=2), DwellTime(2, modes=2)
    word = longer.missing(shorter)
    assert word is not None
    assert shorter.contains(word)
    assert not longer.contains(word)
    assert shorter.missing(longer) is None


@pytest.mark.parametrize(
    ("modes", "tau", "delay", "lift"),
    [(2, 3, 1, 1), (2, 3, 2, 1), (2, 3, 1, 2), (3, 3, 2, 1), (3, 2, 1, 2), (2, 4, 0, 3)],
)
def test_counts_of_table_3_2(modes, tau, delay, lift):
    words = Asynchronous(tau, delay, modes=modes).words(lift)
    d = 1 + (modes - 1) * (1 + delay)
    count = modes * (2 + (modes - 1) * delay) * d ** (lift - 1)
    graph = words.graph()
    assert len(words.words) == count
    assert sum(map(len, words.successors)) == count * d**lift
    assert graph.nodes == sum(len(word) + 1 for word in words.words)
    assert len(graph.jumps) == count * d**lift
    assert len(graph.edges) == sum(map(len, words.words))


def test_counts_of_section_4_3():
    language = PersistentDwellTime(2, 1, modes=2)
    assert len(language.words(1).words) == 8
    assert len(language.words(2).words) == 52  # 64 before the same ones are taken away
    assert len(PersistentDwellTime(1, 1, modes=2).words(2).words) == 4
    assert [PersistentDwellTime(1, 1, modes=2).graph(a).inequalities for a in range(5)] == [2, 4, 8, 16, 32]


def test_the_list_of_example_4_1_is_not_equivalent():
    """Words 1 1 1 and 2 1, any after any: they miss 2 2 1, and make 2 1 2 1, which is not admissible."""
    language = PersistentDwellTime(2, 1, modes=2)
    graph = WordList(((1, 1, 1), (2, 1)), ((0, 1), (0, 1))).graph()
    with pytest.raises(Refused, match="uncovered word"):
        covered(rules(language.constraint, 2), graph.nodes, [*graph.edges, *graph.jumps])
    assert language.contains((2, 2, 1))
    assert not language.contains((2, 1, 2, 1))
    assert (2, 1, 2, 1) in path_words(graph, 4)


def test_clocks_of_example_4_2():
    language = PersistentDwellTime(3, 2, modes=3).clocked(3)

    def tell(*pairs):
        return tuple((mode, mode, clock) for mode, clock in pairs)

    assert language.contains(tell((1, 0), (1, 1), (1, 2), (2, 0), (3, 0), (3, 1), (3, 2)))
    assert language.contains(tell((2, 0), (2, 1), (2, 2), (2, 3), (2, 3), (2, 3), (1, 0)))
    assert not language.contains(tell((1, 0), (1, 1), (1, 2), (2, 1)))
    words = language.words(1)
    assert len(words.words) == 2 * len(PersistentDwellTime(3, 2, modes=3).words(1).words)
    graph = words.graph()
    assert covered(rules(language.constraint, 3), graph.nodes, [*graph.edges, *graph.jumps])
    assert path_words(graph, 6) == path_words(language.graph(0), 6)


def test_step_5_as_printed_loses_signals():
    """Keeping any one of several ways to say the same word leaves admissible signals without a path."""
    words = PersistentDwellTime(3, 1, modes=2).words(1)
    ways: dict[tuple, list[tuple[int, int]]] = {}
    for i, followers in enumerate(words.successors):
        for j in followers:
            ways.setdefault((*words.words[i], *words.words[j]), []).append((i, j))
    lost = []
    for seed in range(20):
        chance = random.Random(seed)
        kept = {chance.choice(found) for found in ways.values()}
        graph = WordList(
            words.words,
            tuple(tuple(j for j in range(len(words.words)) if (i, j) in kept) for i in range(len(words.words))),
        ).graph()
        try:
            covered(rules({"kind": "persistent", "tau": 3, "period": 1}, 2), graph.nodes, [*graph.edges, *graph.jumps])
        except Refused as error:
            lost.append(str(error))
    assert lost
    assert all(reason.startswith("uncovered word") for reason in lost)


@given(st.integers(1, 3), st.integers(1, 4), st.integers(0, 3), st.integers(0, 10_000))
@settings(max_examples=60, deadline=None)
def test_random_signals_are_admissible(modes, tau, period, seed):
    language = PersistentDwellTime(tau, period, modes=modes)
    word = language.random(40, seed)
    assert language.contains(word)
    assert is_persistent(word, tau, period)
    assert word == language.random(40, seed)


@given(st.integers(2, 3), st.integers(1, 3), st.integers(0, 2))
@settings(max_examples=20, deadline=None)
def test_periodic_words_are_those_that_repeat(modes, tau, period):
    language = PersistentDwellTime(tau, period, modes=modes)
    found = set(language.periodic_words(5))
    for word in itertools.chain.from_iterable(itertools.product(range(1, modes + 1), repeat=n) for n in range(1, 6)):
        turns = [word[i:] + word[:i] for i in range(len(word))]
        primitive = len(set(turns)) == len(word) and word == min(turns, key=repr)
        assert (word in found) == (primitive and language.repeats(word))


def test_labelled_graph():
    language = LabelledGraph([("a", 1, "b"), ("b", 2, "a"), ("b", 2, "b")], ["a"], modes=2)
    assert language.contains((1, 2, 2, 1, 2))
    assert not language.contains((2,))
    assert not language.contains((1, 1))
    assert LabelledGraph([(0, 1, 0), (0, 2, 0)], modes=2).missing(ArbitrarySwitching(modes=2)) is None


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: DwellTime(0, modes=2), "tau"),
        (lambda: DwellTime(True, modes=2), "tau"),
        (lambda: DwellTime(2.5, modes=2), "tau"),
        (lambda: DwellTime(2, modes=0), "modes"),
        (lambda: PersistentDwellTime(2, -1, modes=2), "period"),
        (lambda: Asynchronous(3, 3, modes=2), "delay"),
        (lambda: Asynchronous(2, -1, modes=2), "delay"),
        (lambda: AverageDwellTime("1/2", modes=2), "tau"),
        (lambda: AverageDwellTime(3, "nan", modes=2), "burst"),
        (lambda: LabelledGraph([("a", 1, "b")], modes=2), "edges"),
        (lambda: LabelledGraph([("a", 3, "a")], modes=2), "edges.1"),
        (lambda: LabelledGraph([], modes=2), "edges"),
        (lambda: language_of({"kind": "weekly"}, 2), "constraint.kind"),
        (lambda: language_of({"kind": "dwell"}, 2), "constraint"),
        (lambda: language_of({"kind": "dwell", "tau": 3, "period": 2}, 2), "constraint"),
        (lambda: DwellTime(3, modes=2).clocked(-1), "clock"),
        (lambda: Asynchronous(3, 1, modes=2).clocked(1), "clock"),
        (lambda: AverageDwellTime(3, 2, modes=2).words(), "constraint"),
        (lambda: DwellTime(2, modes=2).words(0), "lift"),
        (lambda: DwellTime(2, modes=2).graph(-1), "lift"),
    ],
)
def test_bad_input_names_the_field(make, field):
    with pytest.raises(IllPosedError) as caught:
        make()
    assert caught.value.field == field


@pytest.mark.parametrize(
    "make",
    [
        lambda: ArbitrarySwitching(modes=4).graph(20),
        lambda: PersistentDwellTime(4, 12, modes=3).words(1),
        lambda: PersistentDwellTime(2, 1, modes=2).words(8),
        lambda: Asynchronous(3, 2, modes=3).words(9),
        lambda: PersistentDwellTime(900, 900, modes=10).automaton,
        lambda: ArbitrarySwitching(modes=2).enumerate(60),
    ],
)
def test_too_large_is_estimated_before_it_is_built(make):
    with pytest.raises(TooLargeError) as caught:
        make()
    assert caught.value.estimate > caught.value.limit


def test_languages_can_be_kept_in_sets():
    assert len({DwellTime(2, modes=2), DwellTime(2, modes=2), DwellTime(3, modes=2)}) == 2
    assert isinstance(DwellTime(2, modes=2), Language)
