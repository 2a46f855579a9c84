"""Proof of a certificate: the graph covers the constraint, and every inequality holds, in rational arithmetic."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from fractions import Fraction
from math import lcm
from operator import index, mul
from typing import Any, NamedTuple

from .constraints import STEPS_MAX, Label, Refused, covered, explored, number, rules, spelled

FORMAT, VERSION = "hrs-certificate", 1
Matrix = list[list[Any]]  # of integers or of fractions


Verdict = NamedTuple("Verdict", [("claim", str), ("inequalities", int), ("states", int)])  # noqa: UP014  # short


def verify(document: Mapping[str, Any]) -> Verdict:
    """Prove the claim of a document, or raise `Refused` with the violated inequality or the uncovered word."""
    try:
        if (document["format"], document["version"], document["checksum"]) == (FORMAT, VERSION, checksum(document)):
            return _Checker(document).verdict()
    except (LookupError, TypeError, ValueError, AttributeError, ArithmeticError, RecursionError) as error:
        raise Refused(f"malformed document: {type(error).__name__}: {error}") from error
    raise Refused(f"not format {FORMAT!r} in version {VERSION}, or the checksum does not belong to the document")


def checksum(document: Mapping[str, Any]) -> str:
    """SHA-256 of the document without its checksum. It finds accidents; the claim is proved, not trusted."""
    body = {key: value for key, value in document.items() if key != "checksum"}
    return "sha256:" + hashlib.sha256(json.dumps(body, sort_keys=True, allow_nan=False).encode()).hexdigest()


def multiply(one: Sequence[Sequence[Any]], two: Sequence[Sequence[Any]]) -> list[list[Any]]:
    """The product of two matrices."""
    columns = list(zip(*two, strict=True))
    list(zip(zip(*one, strict=True), two, strict=True))  # they fit, or this raises
    return [[sum(map(mul, row, column)) for column in columns] for row in one]


def prove(rows: Sequence[Sequence[Any]], what: str) -> None:
    """Refuse a symmetric matrix that is not positive definite (Bareiss 1968, doi:10.1090/S0025-5718-1968-0226829-0)."""
    rest, before = [[*row[place:]] for place, row in enumerate(rows)], 1  # whole numbers, as all divisions are exact
    for place, (pivot, *others) in enumerate(rest):
        if pivot <= 0:  # a leading minor
            raise Refused(f"violated: {what}: not positive definite (leading minor {place + 1})")
        for down, left in enumerate(others):
            pairs = zip(rest[place + down + 1], others[down:], strict=True)
            rest[place + down + 1] = [(pivot * item - left * above) // before for item, above in pairs]
        before = pivot


def schur_stable(rows: Matrix) -> bool:
    """Whether all eigenvalues lie inside the unit circle: Faddeev-LeVerrier for the polynomial, then Schur-Cohn.

    Parameters
    ----------
    rows
        A square matrix of rationals.

    Returns
    -------
    bool
        True where the spectral radius is below 1, exactly.
    """
    power, polynomial = [[Fraction(0)] * len(rows) for _ in rows], [Fraction(1)]
    for k in range(1, len(rows) + 1):
        power = multiply(rows, [[x + polynomial[-1] * (i == j) for j, x in enumerate(r)] for i, r in enumerate(power)])
        polynomial.append(-sum((power[i][i] for i in range(len(rows))), Fraction(0)) / k)
    while len(polynomial) > 1 and abs(polynomial[-1]) < abs(polynomial[0]):
        share = polynomial[-1] / polynomial[0]
        polynomial = [a - share * b for a, b in zip(polynomial, reversed(polynomial), strict=True)][:-1]
    return len(polynomial) == 1


class _Checker:  # one document on its way to a verdict
    def __init__(self, document: Mapping[str, Any]) -> None:
        problem, self._claim, self._proof = document["problem"], document["claim"], document["proof"]
        self._modes = [{key: [[*map(number, r)] for r in rows] for key, rows in m.items()} for m in problem["modes"]]
        self._gains = {(g["mode"], g["clock"]): [[*map(number, r)] for r in g["K"]] for g in problem.get("gains", [])}
        self._peak, self._value = number(problem.get("peak", 1)), number(self._claim["value"])
        self._alpha, self._unit = [*map(number, self._proof.get("alpha", []))], index(self._proof["denominator"])
        self._rules, self._size = rules(problem["constraint"], len(self._modes)), len(self._modes[0]["A"])
        self._nodes, edges = range(index(self._proof["nodes"])), [*self._proof["edges"], *self._proof["jumps"]]
        self._edges = [(u, *(tuple(x) if isinstance(x, list) else x for x in label), v) for u, *label, v in edges]
        inside = all(u in self._nodes and v in self._nodes for u, *_, v in self._edges)
        counts = min(self._unit, self._size, len(self._nodes), STEPS_MAX - len(self._nodes))
        positive = [self._value, self._peak, Fraction(counts), *self._alpha, *(1 - item for item in self._alpha)]
        if any(x <= 0 for x in positive) or not inside or len(self._gains) < len(problem.get("gains", [])):
            raise Refused("value, peak, sizes or alpha out of bounds, an edge outside the nodes, or a gain given twice")

    def verdict(self) -> Verdict:
        if (kind := self._claim["kind"]) in {"unstable", "infeasible"}:
            return self._unstable() if kind == "unstable" else self._infeasible()
        statement = {
            "stability": f"|x(k)| <= c r^k |x(0)| for some c and some r < {self._claim['value']}",
            "gain": f"stable, and the l2 gain from w to y is below {self._claim['value']}",
            "reach": f"if e(0) = 0, |w(k)| <= {self._peak}: |e(k)| < {self._claim['value']}, and e(k) is in the tube",
        }[kind]
        unit, matrices = self._unit, self._symmetric("matrices", len(self._nodes))
        states = covered(self._rules, len(self._nodes), self._edges)
        low, lift = (unit / self._value**2 if kind == "reach" else Fraction(0)).as_integer_ratio()
        for node, rows in enumerate(matrices):
            above = [[lift * x - low * (i == j) for j, x in enumerate(row)] for i, row in enumerate(rows)]
            prove(above, f"matrix of node {node}, above {Fraction(low, lift * unit)} I")
        terms = {label: self._terms(kind, label) for label in dict.fromkeys(edge[1:-1] for edge in self._edges)}
        for place, (u, *label, v) in enumerate(self._edges):
            own, base, moved, loop, turned = terms[*label,]
            pairs = zip(base, multiply(turned, multiply(matrices[v], loop)), strict=True)
            found = [[unit * b - moved * x for b, x in zip(*pair, strict=True)] for pair in pairs]
            for i, here in enumerate(matrices[u]):
                found[i][: self._size] = [x + own * y for x, y in zip(found[i], here, strict=False)]
            prove(found, f"edge {place}, node {u} --{spelled(label)}--> node {v}")
        return Verdict(f"for every admissible signal: {statement}", len([*matrices, *self._edges]), states)

    def _terms(self, kind: str, label: tuple[Label, ...]) -> tuple[int, Matrix, int, Matrix, Any]:
        """Integers of own diag(L_u, 0) + diag(0, noise I) - [H F]' [H F] - [G E]' L_v [G E] > 0 of a label or jump."""
        alpha = self._alpha[_mode(label[0]) - 1] if kind == "reach" and label else Fraction(1)
        own, noise = {  # (4.12), (3.16), (4.39); (4.13)
            "stability": (self._value**2, Fraction(0)), "gain": (Fraction(1), self._value**2),
            "reach": (alpha, (1 - alpha) / self._peak**2), "jump": (Fraction(1), Fraction(0)),
        }[kind if label else "jump"]  # fmt: skip
        loop = self._loop(label, "ABE" if noise else "AB")
        base = [[noise * (i == j >= self._size) for j, _ in enumerate(loop[0])] for i, _ in enumerate(loop[0])]
        if kind == "gain" and label:
            out = self._loop(label, "CDF")
            squares = multiply(list(zip(*out, strict=True)), out)
            base = [[a - b for a, b in zip(*pair, strict=True)] for pair in zip(base, squares, strict=True)]
        scale = lcm(*(item.denominator for row in loop for item in row))
        common = lcm(own.denominator, scale**2, *(item.denominator for row in base for item in row))
        whole, base_whole = ([[int(x * by) for x in row] for row in of] for of, by in ((loop, scale), (base, common)))
        return int(own * common), base_whole, common // scale**2, whole, list(zip(*whole, strict=True))

    def _loop(self, label: Sequence[Label], names: str) -> Matrix:
        """[A + B K, E] of a label for "ABE", [C + D K, F] for "CDF", without the last for two names; I of a jump."""
        mode = self._modes[_mode(label[0]) - 1] if label else {}
        rows = mode[names[0]] if label else [[Fraction(i == j) for j in range(self._size)] for i in range(self._size)]
        if label and isinstance(label[0], tuple):
            added = multiply(mode[names[1]], self._gains[label[0][1:]])
            rows = [[a + b for a, b in zip(*pair, strict=True)] for pair in zip(rows, added, strict=True)]
        known = not label or (_mode(label[0]) > 0 and isinstance(label[0], tuple) == bool(self._gains))
        if {len(row) for row in rows} != {self._size} or not known:
            raise Refused(f"the matrices of {spelled(label)} do not fit {self._size} states")
        return [[*row, *other] for row, other in zip(rows, mode[names[2]], strict=True)] if names[2:] else rows

    def _unstable(self) -> Verdict:
        """The claimed word can be repeated for ever, and its product has an eigenvalue of at least value^length."""
        states, word = explored(*self._rules), [tuple(x) if isinstance(x, list) else x for x in self._claim["word"]]

        def again(state: Any) -> dict[int, Any]:
            for label in word:
                state = None if state is None else self._rules[1](state).get(label)
            return {0: state}

        if not 0 < len(word) * len(states) <= STEPS_MAX or all(None in explored(state, again) for state in states):
            raise Refused(f"no admissible signal repeats the word {spelled(word)} for ever")
        product = self._loop((), "AB")
        for label in word:
            product = multiply([[item / self._value for item in row] for row in self._loop((label,), "AB")], product)
        if schur_stable(product):
            raise Refused(f"the word {spelled(word)}, repeated, decays faster than {self._claim['value']}^k")
        claim = f"repeating {spelled(word)} is admissible and decays no faster than {self._claim['value']}^k"
        return Verdict(claim, 1, len(states))

    def _infeasible(self) -> Verdict:
        """Multipliers Z > 0 of edges and jumps: at every node, G Z G' arriving exceeds r^2 Z leaving, summed up."""
        if len(self._nodes) > len(self._edges):  # each needs inflow; their matrices alone would fill the memory
            raise Refused(f"{len(self._nodes)} nodes, of which {len(self._edges)} edges and jumps cannot reach all")
        flows = [[[Fraction(0)] * self._size for _ in range(self._size)] for _ in self._nodes]
        for rows, (u, *label, v) in zip(self._symmetric("multipliers", len(self._edges)), self._edges, strict=True):
            prove(rows, f"multiplier of the edge or jump from node {u} to node {v}")
            loop = self._loop(label, "AB")
            for i, line in enumerate(multiply(multiply(loop, rows), list(zip(*loop, strict=True)))):
                for j, item in enumerate(line):
                    flows[v][i][j] += item
                    flows[u][i][j] -= (self._value**2 if label else 1) * rows[i][j]
        for node, flow in enumerate(flows):
            scale = lcm(*(item.denominator for row in flow for item in row))
            prove([[int(scale * item) for item in row] for row in flow], f"inflow above outflow at node {node}")
        claim = f"no quadratic functions on this graph prove a rate of {self._claim['value']}"
        return Verdict(claim, len(flows) + len(self._edges), covered(self._rules, len(flows), self._edges))

    def _symmetric(self, name: str, count: int) -> list[Matrix]:
        """Symmetric integer matrices from their upper triangles, row after row."""
        triangles, n = self._proof[name], self._size
        entries = n * (n + 1) // 2
        if len(triangles) != count or any(len(t) != entries or any(type(x) is not int for x in t) for t in triangles):
            raise Refused(f"proof.{name}: {count} upper triangles of {entries} integers are needed")
        places = [[min(i, j) * (2 * n - min(i, j) - 1) // 2 + max(i, j) for j in range(n)] for i in range(n)]
        return [[[items[place] for place in row] for row in places] for items in triangles]


def _mode(label: Label) -> int:
    return label if isinstance(label, int) else label[0]
