"""Switching constraints as the checker knows them: the automaton of each definition, and words that a graph misses."""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from fractions import Fraction
from operator import index
from typing import Any

STEPS_MAX = 2_000_000  # moves that are looked at before a document is refused as too large
Label = int | tuple[int, int, int]  # a mode from 1 on, or (mode, mode whose gain acts, clock of that gain)


class Refused(Exception):  # noqa: N818  # it reads as what it is
    """The document proves nothing: a violated inequality, an uncovered word, or something malformed, in words."""


def exact(values: list[Any]) -> None:
    """Refuse truth values and floats, wherever they stand."""
    while values:
        value = values.pop()
        if type(value) in {bool, float}:
            raise Refused(f"whole numbers, or texts of rationals, are needed; given {value!r}")
        values += value.values() if isinstance(value, dict) else value if isinstance(value, list | tuple) else ()


def number(text: Any) -> Fraction:
    """An integer, a decimal or a fraction p/q, exactly; no exponents, which would make short texts huge."""
    if type(text) in {int, str} and re.fullmatch(r"-?[0-9]{1,60}([./][0-9]{1,60})?", str(text)):
        return Fraction(text)
    raise Refused(f"{text!r:.40} is not an integer, a decimal or a fraction")


def spelled(word: Iterable[Any]) -> str:
    """A word in print: `1 1 2`, or `(1,1,0) (2,1,3)` where gains have clocks."""
    return " ".join(str(label).replace(" ", "") for label in word)


def rules(constraint: Mapping[str, Any], modes: int) -> tuple[Any, Any]:
    """Start and successors of the automaton that a constraint's definition describes; k = 0 is a switching instant.

    Definitions 2.14 (`dwell`), 2.15 (`persistent`), 2.16 (`average`), section 3.2 (`asynchronous`), (4.10) (`clocked`).
    """
    kind, every, whole = constraint["kind"], range(1, modes + 1), number if constraint["kind"] == "average" else index
    tau, burst = whole(constraint.get("tau", 1)), whole(constraint.get("burst", 0))
    period, delay, clock = (index(constraint.get(name, 0)) for name in ("period", "delay", "clock"))
    inner, edges = rules(constraint["of"], modes) if kind == "clocked" else (0, dict), constraint.get("edges", [])
    limits = 1 <= tau <= 1000 and 0 <= delay < tau and 0 <= period <= 1000 and 0 <= clock <= 1000 and modes <= 1000
    if not limits or any(m not in every for _, m, _ in edges) or kind == "clocked" == constraint["of"]["kind"]:
        raise Refused(f"constraint: a number out of its limits, an edge without a mode of 1..{modes}, or clocked twice")

    def graph(nodes: Any) -> dict[Any, Any]:
        new = {mode for at, mode, _ in edges if at in nodes}
        return {m: frozenset(to for at, mode, to in edges if mode == m and at in nodes) for m in new}

    def clocked(state: Any) -> dict[Any, Any]:  # inner state, mode, clock if that mode stays
        at, mode, stays = state
        new = {m: (then, stays if m == mode else 0) for m, then in inner[1](at).items()}
        return {(m, m, now): (then, m, min(now + 1, clock)) for m, (then, now) in new.items()}

    def average(state: Any) -> dict[Any, Any]:  # mode, level of a bucket: a switch pours 1 in, a step drains 1/tau
        rest = max(state[1] - Fraction(1, tau), Fraction(0))
        return {m: (m, rest + (m != state[0])) for m in every if rest + (m != state[0]) <= burst}

    def persistent(state: Any) -> dict[Any, Any]:  # mode, its run up to tau, steps from the last portion to this run
        mode, run, gap = state
        used = 0 if run == tau else gap + run
        new = {m: (m, 1, used if tau > 1 else 0) for m in every if m != mode and used <= period}
        return {mode: (mode, run + 1, gap) if run + 1 < tau else (mode, tau, 0), **new} if mode else new

    def asynchronous(state: Any) -> dict[Any, Any]:  # mode, mode whose gain acts, steps since the switch up to tau
        mode, acting, run = state
        new: dict[Any, Any] = {(mode, mode, run): (mode, mode, min(run + 1, tau))} if mode else {}
        if acting != mode and run < delay:
            new[mode, acting, tau] = (mode, acting, run + 1)
        if acting == mode and (run >= tau or not mode):
            new |= {(m, m, 0): (m, m, 1) for m in every if m != mode}
            new |= {(m, mode, tau): (m, mode, 1) for m in every if m != mode and mode and delay}
        return new

    known: dict[str, tuple[Any, Any, set[str]]] = {
        "arbitrary": ((0, 0, 0), persistent, set()), "clocked": ((inner[0], 0, 0), clocked, {"of", "clock"}),
        "dwell": ((0, 0, 0), persistent, {"tau"}), "persistent": ((0, 0, period), persistent, {"tau", "period"}),
        "average": ((0, Fraction(0)), average, {"tau", "burst"}),
        "asynchronous": ((0, 0, 0), asynchronous, {"tau", "delay"}),
        "graph": (frozenset(constraint.get("initial") or [at for at, _, _ in edges]), graph, {"edges", "initial"}),
    }  # fmt: skip
    if kind not in known or not constraint.keys() - {"kind"} <= known[kind][2]:
        raise Refused(f"constraint {sorted(constraint)} of kind {kind!r}: known are {', '.join(known)}")
    return known[kind][:2]


def explored(start: Any, successors: Callable[[Any], dict[Any, Any]], weight: Any = lambda _: 1) -> dict[Any, Any]:
    """Everything reachable from `start`, in order; each with (where from, label), the start with None."""
    came, spent = {start: None}, 0
    for state in (waiting := [start]):
        found = successors(state)
        new: dict[Any, Any] = {then: (state, label) for label, then in found.items() if then not in came}
        came.update(new)
        waiting.extend(new)
        spent += weight(state) * (1 + len(found))
        if spent > STEPS_MAX:
            raise Refused(f"more than {STEPS_MAX} moves to look at")
    return came


def covered(signals: tuple[Any, Any], nodes: int, edges: Sequence[Any], tick: Callable[[], None] = lambda: None) -> int:
    """Prove that every signal is a path of the graph: the set of nodes it may be in is never empty; count them."""

    def weight(pair: Any) -> int:
        tick()
        return 1 + len(pair[1])

    leaving: dict[Any, set[int]] = {}  # by (node, label), and by (node,) for jumps
    for u, *label, v in edges:
        leaving.setdefault((u, *label), set()).add(v)

    def after(nodes: Iterable[int], *label: Label) -> frozenset[int]:
        return frozenset().union(*(leaving.get((u, *label), ()) for u in nodes))

    came = explored(
        (signals[0], frozenset(range(nodes))),
        lambda pair: {
            x: (to, (then := after(pair[1], x)) | after(then))  # a jump after a jump would be no letter
            for x, to in (signals[1](pair[0]) if pair[1] else {}).items()
        },
        weight,
    )
    end, word = next((pair for pair in came if not pair[1]), None), list[Label]()
    while end is not None and came[end]:
        end, letter = came[end]
        word.insert(0, letter)
    if word or not signals[1](signals[0]):
        raise Refused(f"uncovered word: {spelled(word)} is admissible, and no path of the graph")
    return len(came)
