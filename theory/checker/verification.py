"""Proof of a certificate: the graph covers the constraint, and every inequality holds, in rational arithmetic."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from fractions import Fraction
from itertools import product
from math import lcm
from operator import index
from typing import Any, NamedTuple

from .algebra import Matrix, bordered, multiply, prove, prove_fractions, schur_stable, weighted
from .constraints import STEPS_MAX, Label, Refused, covered, exact, number, rules, spelled
from .feedback import closing
from .lower import orbit, repeatable, response
from .parameters import Point, box, corners, cycle, ranges
from .sampling import norm, wandering
from .work import Limits

FORMAT, VERSION = "hrs-certificate", 1
LETTERS_MAX = 1000  # of a bound from below: the digits of a product grow with every letter


Verdict = NamedTuple("Verdict", [("claim", str), ("inequalities", int), ("states", int)])  # noqa: UP014  # short


def verify(document: Mapping[str, Any], *, seconds: float | None = None, memory_bytes: int | None = None) -> Verdict:
    """Prove the claim of a document, or raise `Refused` with the violated inequality or the uncovered word.

    Parameters
    ----------
    document
        A certificate, as `json.loads` gives it.
    seconds, memory_bytes
        Limits; a document beyond them is refused by `OverLimit`, mostly before any work is done.
    """
    limits = Limits(seconds, memory_bytes)
    try:
        limits.foresee(document)
        if (document["format"], document["version"], document["checksum"]) == (FORMAT, VERSION, checksum(document)):
            exact([document["problem"], document["claim"], document["proof"]])
            return _Checker(document, limits).verdict()
    except (LookupError, TypeError, ValueError, AttributeError, ArithmeticError, RecursionError) as error:
        raise Refused(f"malformed document: {type(error).__name__}: {error}") from error
    raise Refused(f"not format {FORMAT!r} in version {VERSION}, or the checksum does not belong to the document")


def checksum(document: Mapping[str, Any]) -> str:
    """SHA-256 of the document without its checksum. It finds accidents; the claim is proved, not trusted."""
    body = {key: value for key, value in document.items() if key != "checksum"}
    return "sha256:" + hashlib.sha256(json.dumps(body, sort_keys=True, allow_nan=False).encode()).hexdigest()


class _Checker:  # one document on its way to a verdict
    def __init__(self, document: Mapping[str, Any], limits: Limits) -> None:
        self._limits = limits
        problem, self._claim, self._proof = document["problem"], document["claim"], document["proof"]
        self._problem, self._ranges = problem, ranges(problem)
        self._modes, self._gains = closing(problem, tuple(low for low, _, _ in self._ranges))
        self._period = number(problem["period"]) if "period" in problem else None
        if self._period is not None and (self._period <= 0 or self._ranges):
            raise Refused("period: above 0, and without parameters, is needed")
        self._apart = "" if self._period is None else f" at samples {problem['period']} apart"
        self._at = {tuple(low for low, _, _ in self._ranges): self._modes}
        self._peak, self._value = number(problem.get("peak", 1)), number(self._claim["value"])
        self._chain = [[*map(number, row)] for row in problem.get("chain", [])]
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
        kind, others = self._claim["kind"], {"unstable": self._unstable, "infeasible": self._infeasible,
                                             "mean-square": self._mean_square}  # fmt: skip
        if self._ranges and kind not in {"stability", "gain"}:
            raise Refused(f"parameters: nothing is proved of {kind!r}")
        if kind in others:
            return others[kind]()
        labelled = [edge for edge in self._edges if len(edge) > 2]
        self._edges = list(dict.fromkeys(self._edges))  # what is proved once need not be proved again
        statement = {
            "stability": f"|x(k)| <= c r^k |x(0)| for some c and some r < {self._claim['value']}",
            "gain": f"stable, and the l2 gain from w to y is below {self._claim['value']}",
            "reach": f"if e(0) = 0, |w(k)| <= {self._peak}: |e(k)| < {self._claim['value']}, and e(k) is in the tube",
        }[kind]
        states = covered(self._rules, len(self._nodes), self._edges, self._limits.tick)
        if self._ranges:
            count, below = self._varying(kind, labelled), self._at_least(kind) if "at_least" in self._claim else ""
            told = f"for every admissible signal, and parameters within bounds and rates: {statement}{below}"
            return Verdict(told, count, states)
        unit, matrices = self._unit, self._symmetric("matrices", len(self._nodes))
        low, lift = (unit / self._value**2 if kind == "reach" else Fraction(0)).as_integer_ratio()
        for node, rows in enumerate(matrices):
            self._limits.tick()
            above = [[lift * x - low * (i == j) for j, x in enumerate(row)] for i, row in enumerate(rows)]
            prove(above, f"matrix of node {node}, above {Fraction(low, lift * unit)} I")
        labels = list(dict.fromkeys(edge[1:-1] for edge in self._edges))
        terms = {} if self._period else {label: self._terms(kind, label) for label in labels}
        for place, (u, *label, v) in enumerate(self._edges):
            self._limits.tick()
            what = f"edge {place}, node {u} --{spelled(label)}--> node {v}"
            if self._period is not None:
                self._prove_enclosed(kind, tuple(label), matrices[u], matrices[v], what)
                continue
            own, base, moved, loop, turned = terms[*label,]
            pairs = zip(base, multiply(turned, multiply(matrices[v], loop)), strict=True)
            found = [[unit * b - moved * x for b, x in zip(*pair, strict=True)] for pair in pairs]
            for i, here in enumerate(matrices[u]):
                found[i][: self._size] = [x + own * y for x, y in zip(found[i], here, strict=False)]
            prove(found, what)
        below = self._at_least(kind) if "at_least" in self._claim else ""
        if self._period is not None:
            below = f"{self._wandering(labels, 'AB' if kind == 'stability' else 'ABE')}{below}"
        return Verdict(f"for every admissible signal: {statement}{below}", len([*matrices, *self._edges]), states)

    def _varying(self, kind: str, labelled: Sequence[Any]) -> int:
        """Prove [r^2 L_u(p), G' X'; ., X + X' - L_v(q)], or that of a gain, and L_u(p) at all corners; count them."""
        n, parts, count = self._size, len(self._ranges) + 1, len(self._nodes)
        given, slacks = self._symmetric("matrices", count * parts), self._proof["slacks"]
        if len(slacks) != len(labelled) or any(len(x) != n * n or any(type(y) is not int for y in x) for x in slacks):
            raise Refused(f"proof.slacks: {n} x {n} integers for every edge are needed")

        def shape(node: int, point: Point) -> Matrix:
            shares = [(x - low) / (high - low) for x, (low, high, _) in zip(point, self._ranges, strict=True)]
            weights = [share / self._unit for share in (Fraction(1), *shares)]
            return weighted(weights, given[node * parts : (node + 1) * parts])

        points, pairs = box(self._ranges), corners(self._ranges)
        for node, point in product(self._nodes, points):
            self._limits.tick()
            prove_fractions(shape(node, point), f"matrix of node {node} at {spelled(point)}")
        for (u, v), point in product([edge for edge in self._edges if len(edge) == 2], points):
            prove_fractions(weighted([1, -1], [shape(u, point), shape(v, point)]), f"jump from node {u} to node {v}")
        own = self._value**2 if kind == "stability" else Fraction(1)
        for (place, (u, *label, v)), (p, q) in product(enumerate(labelled), pairs):
            self._limits.tick()
            loop = self._placed(p, label, "ABE" if kind == "gain" else "AB")
            slack = [[Fraction(x, self._unit) for x in slacks[place][i * n : i * n + n]] for i in range(n)]
            both = weighted([1, 1, -1], [slack, [*map(list, zip(*slack, strict=True))], shape(v, q)])
            here = weighted([own], [shape(u, p)])
            rows = [[*row, *[Fraction(0)] * (len(loop[0]) - n)] for row in here]
            rows += [[self._value**2 * (i == j) for j in range(len(loop[0]))] for i in range(n, len(loop[0]))]
            rows = bordered(rows, multiply(slack, loop), both)
            if kind == "gain":
                out = self._placed(p, label, "CDF")
                unit = [[Fraction(i == j) for j in range(len(out))] for i in range(len(out))]
                rows = bordered(rows, [[*row, *[Fraction(0)] * n] for row in out], unit)
            prove_fractions(rows, f"edge {place}, node {u} --{spelled(label)}--> node {v} at {spelled(p)}")
        return len(points) * (count + len(self._proof["jumps"])) + len(pairs) * len(labelled)

    def _placed(self, point: Point, label: Sequence[Label], names: str) -> Matrix:
        """The loop of a label where parameters have given values."""
        if point not in self._at:
            self._at[point] = closing(self._problem, point)[0]
        self._modes = self._at[point]
        return self._loop(label, names)

    def _at_least(self, kind: str) -> str:
        """The claim from below: a word whose repetition decays no faster, or has at least the gain."""
        found = self._claim["at_least"]
        value, word = number(found["value"]), _word(found["word"])
        repeatable(self._rules, word)
        points = cycle(self._ranges, found.get("path", [()] * len(word)), len(word))
        if value <= 0 or len(word) > LETTERS_MAX:
            raise Refused(f"at_least: {value} by {len(word)} letters; above 0, and by {LETTERS_MAX} at most, is needed")
        if kind == "stability":
            self._decays(word, value, points)
            return f"; and repeating {spelled(word)} decays no faster than {found['value']}^k"
        pushed = [[*map(number, row)] for row in found["disturbances"]]
        if kind == "reach":
            split = [self._loop((label,), "ABE") for label in word]
            pieces = [([r[: self._size] for r in rows], [r[self._size :] for r in rows]) for rows in split]
            if any(sum(x * x for x in row) > self._peak**2 for row in pushed) or orbit(pieces, pushed) < value**2:
                raise Refused(f"the word {spelled(word)}, repeated, is not led as far as {value} by these disturbances")
            return f"; and disturbances along {len(word)} letters, repeated, lead as near to {found['value']} as wished"
        letters = [*zip(points, word, strict=True)]
        pieces = [(self._placed(at, (x,), "ABE"), self._placed(at, (x,), "CDF")) for at, x in letters]
        out, pushing = response(pieces, number(found["tangent"]), pushed)
        if pushing == 0 or out < value**2 * pushing:
            raise Refused(f"the word {spelled(word)}, repeated, has no gain of {value} at this angle")
        return f"; and repeating {spelled(word)} has a gain of at least {found['value']}"

    def _terms(self, kind: str, label: tuple[Label, ...]) -> tuple[int, Matrix, int, Matrix, Any]:
        """Integers of own diag(L_u, 0) + diag(0, noise I) - [H F]' [H F] - [G E]' L_v [G E] > 0 of a label or jump."""
        own, loop, base = self._parts(kind, label)
        scale = lcm(*(item.denominator for row in loop for item in row))
        common = lcm(own.denominator, scale**2, *(item.denominator for row in base for item in row))
        whole, base_whole = ([[int(x * by) for x in row] for row in of] for of, by in ((loop, scale), (base, common)))
        return int(own * common), base_whole, common // scale**2, whole, list(zip(*whole, strict=True))

    def _parts(self, kind: str, label: tuple[Label, ...]) -> tuple[Fraction, Matrix, Matrix]:
        """Own, [G E], and diag(0, noise I) - [H F]' [H F] of a label or jump."""
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
            base = weighted([1, -1], [base, squares])
        return own, loop, base

    def _prove_enclosed(self, kind: str, label: tuple[Label, ...], here: Matrix, there: Matrix, what: str) -> None:
        """The inequality of an edge or jump for all loops that enclosures contain."""
        own, loop, base = self._parts(kind, label)
        moved = multiply(list(zip(*loop, strict=True)), multiply(there, loop))
        found = weighted([self._unit, -1], [base, moved])
        for i, row in enumerate(here):
            found[i][: self._size] = [x + own * y for x, y in zip(found[i], row, strict=False)]
        prove_fractions(found, what)

    def _wandering(self, labels: Sequence[tuple[Label, ...]], names: str) -> str:
        """What the plant's state moves by between samples: at most (e^(a h) - 1) / a times |A x + B u + E w|."""
        plant, period = len(self._problem["modes"][0]["A"]), self._period or Fraction(0)
        self._modes = closing(self._problem, held=False)[0]
        far = wandering(self._modes, period)
        loops = [self._loop(label, names)[:plant] for label in labels if label]
        cuts = (slice(self._size), slice(self._size, None))
        bounds = [norm([row[cut] for row in loop]) for cut in cuts for loop in loops]
        by_state, by_noise = max(bounds[: len(loops)]) * far, max(bounds[len(loops) :]) * far
        text = f"{self._apart}; in between x moves by at most {_above(by_state)} |x|"
        return f"{text} + {_above(by_noise)} |w|" if names == "ABE" else text

    def _loop(self, label: Sequence[Label], names: str) -> Matrix:
        """[A + B K, E] of a label for "ABE", [C + D K, F] for "CDF", without the last for two names; I of a jump.

        Where M is measured, [A + B K M, E + B K N] and [C + D K M, F + D K N].
        """
        mode = self._modes[_mode(label[0]) - 1] if label else {}
        rows = mode[names[0]] if label else [[Fraction(i == j) for j in range(self._size)] for i in range(self._size)]
        noise = mode[names[2]] if names[2:] else []
        if label and isinstance(label[0], tuple):
            driven = multiply(mode[names[1]], self._gains[label[0][1:]])
            rows = weighted([1, 1], [rows, multiply(driven, mode["M"]) if "M" in mode else driven])
            noise = weighted([1, 1], [noise, multiply(driven, mode["N"])]) if noise and "M" in mode else noise
        known = not label or (_mode(label[0]) > 0 and isinstance(label[0], tuple) == bool(self._gains))
        if {len(row) for row in rows} != {self._size} or not known:
            raise Refused(f"the matrices of {spelled(label)} do not fit {self._size} states")
        return [[*row, *other] for row, other in zip(rows, noise, strict=True)] if names[2:] else rows

    def _unstable(self) -> Verdict:
        """The claimed word can be repeated for ever, and its product has an eigenvalue of at least value^length."""
        word = _word(self._claim["word"])
        states = repeatable(self._rules, word)
        self._decays(word, self._value, [()] * len(word))
        claim = f"repeating {spelled(word)} is admissible and decays no faster than {self._claim['value']}^k"
        return Verdict(claim + self._apart, 1, states)

    def _decays(self, word: Sequence[Label], value: Fraction, points: Sequence[Point]) -> None:
        """Refuse a word whose repetition decays faster than value^k."""
        power = self._loop((), "AB")
        for label, point in zip(word, points, strict=True):
            self._limits.tick()
            power = multiply([[item / value for item in row] for row in self._placed(point, (label,), "AB")], power)
        if schur_stable(power):
            raise Refused(f"the word {spelled(word)}, repeated, decays faster than {value}^k")

    def _infeasible(self) -> Verdict:
        """Multipliers Z > 0 of edges and jumps: at every node, G Z G' arriving exceeds r^2 Z leaving, summed up."""
        if len(self._nodes) > len(self._edges):  # each needs inflow; their matrices alone would fill the memory
            raise Refused(f"{len(self._nodes)} nodes, of which {len(self._edges)} edges and jumps cannot reach all")
        flows = [[[Fraction(0)] * self._size for _ in range(self._size)] for _ in self._nodes]
        for rows, (u, *label, v) in zip(self._symmetric("multipliers", len(self._edges)), self._edges, strict=True):
            self._limits.tick()
            prove(rows, f"multiplier of the edge or jump from node {u} to node {v}")
            loop = self._loop(label, "AB")
            for i, line in enumerate(multiply(multiply(loop, rows), list(zip(*loop, strict=True)))):
                for j, item in enumerate(line):
                    flows[v][i][j] += item
                    flows[u][i][j] -= (self._value**2 if label else 1) * rows[i][j]
        for node, flow in enumerate(flows):
            prove_fractions(flow, f"inflow above outflow at node {node}")
        claim = f"no quadratic functions on this graph prove a rate of {self._claim['value']}{self._apart}"
        states = covered(self._rules, len(flows), self._edges, self._limits.tick)
        return Verdict(claim, len(flows) + len(self._edges), states)

    def _mean_square(self) -> Verdict:
        """r^2 L_i > A_i' (sum_j p_ij L_j) A_i and L_i > 0, and moments X_j > 0 that grow by s^2 or more in a step."""
        chain, count, value = self._chain, len(self._modes), self._claim["value"]
        if len(chain) != count or any(len(row) != count or sum(row) != 1 or min(row) < 0 for row in chain):
            raise Refused(f"chain: {count} rows of probabilities that sum up to 1 are needed")
        loops = [self._loop((mode,), "AB") for mode in range(1, count + 1)]
        turned = [[*zip(*loop, strict=True)] for loop in loops]
        matrices = self._symmetric("matrices", count)
        for i, (loop, rows) in enumerate(zip(loops, matrices, strict=True)):
            moved = multiply(multiply(turned[i], weighted(chain[i], matrices)), loop)
            prove(rows, f"matrix of mode {i + 1}")
            prove_fractions(weighted([self._value**2, -1], [rows, moved]), f"decrease from mode {i + 1}")
        told = f"the root of E |x(k)|^2 is at most c r^k |x(0)| for some c and some r < {value}{self._apart}"
        if "at_least" not in self._claim:
            return Verdict(f"for every mode to begin with: {told}", 2 * count, count)
        least, moments = number(self._claim["at_least"]["value"]), self._symmetric("moments", count)
        if least <= 0:
            raise Refused(f"at_least: {least} is no bound from below")
        after = [multiply(multiply(loop, rows), back) for loop, rows, back in zip(loops, moments, turned, strict=True)]
        for j, rows in enumerate(moments):
            prove(rows, f"moments of mode {j + 1}")
            arriving = weighted([row[j] for row in chain], after)
            prove_fractions(weighted([1, -(least**2)], [arriving, rows]), f"growth of the moments of mode {j + 1}")
        told += f"; from some beginning it decays no faster than {self._claim['at_least']['value']}^k"
        return Verdict(f"for every mode to begin with: {told}", 4 * count, count)

    def _symmetric(self, name: str, count: int) -> list[Matrix]:
        """Symmetric integer matrices from their upper triangles, row after row."""
        triangles, n = self._proof[name], self._size
        entries = n * (n + 1) // 2
        if len(triangles) != count or any(len(t) != entries or any(type(x) is not int for x in t) for t in triangles):
            raise Refused(f"proof.{name}: {count} upper triangles of {entries} integers are needed")
        places = [[min(i, j) * (2 * n - min(i, j) - 1) // 2 + max(i, j) for j in range(n)] for i in range(n)]
        return [[[items[place] for place in row] for row in places] for items in triangles]


def _above(value: Fraction) -> str:
    return f"{-(-value * 10**6 // 1) / 10**6:.6f}"


def _mode(label: Label) -> int:
    return label if isinstance(label, int) else label[0]


def _word(labels: Sequence[Any]) -> list[Label]:
    return [tuple(label) if isinstance(label, list) else label for label in labels]
