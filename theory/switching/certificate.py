"""Certificates: proofs rounded, verified exactly, then written as documents. No other proof leaves this package."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from theory.arrays import Array
from theory.checker import FORMAT, VERSION, Label, Refused, Verdict, checksum, verify
from theory.errors import NotCertifiedError
from theory.switching.coordinates import Coordinates, ExactMatrix
from theory.switching.graph import Graph
from theory.switching.language import Language
from theory.switching.periodic import LowerBound
from theory.switching.system import Gains, SwitchedSystem, decimal

DIGITS_MAX = 200
TRIES = 8
"""Roundings that are tried, each two decimals finer."""


@dataclass(frozen=True)
class Certificate:
    """A verified document and the checker's verdict."""

    document: Mapping[str, Any]
    verdict: Verdict

    @property
    def value(self) -> float:
        """The certified number: a decay rate a sample, an l2 gain, or a radius."""
        return float(Fraction(self.document["claim"]["value"]))

    @property
    def at_least(self) -> float | None:
        """The bound from below beside the value: no certificate can claim less. None where there is none."""
        found = self.document["claim"].get("at_least")
        return None if found is None else float(Fraction(found["value"]))

    @property
    def kind(self) -> str:
        """`stability`, `gain`, `reach`, `mean-square`, `unstable` or `infeasible`."""
        return str(self.document["claim"]["kind"])

    @property
    def gains(self) -> Gains:
        """The gains of the certified loop."""
        return Gains.of_document(self.document["problem"].get("gains", []))

    @property
    def matrices(self) -> Array:
        """The matrices of the proof as floats: nodes (or multipliers) x n x n."""
        proof = self.document["proof"]
        numbers = proof.get("matrices", proof.get("multipliers", []))
        size = math.isqrt(2 * len(numbers[0])) if numbers else len(self.document["problem"]["modes"][0]["A"])
        triangles = np.array(numbers, float).reshape(-1, size * (size + 1) // 2) / float(proof["denominator"])
        found = np.zeros((len(triangles), size, size))
        rows, columns = np.triu_indices(size)
        found[:, rows, columns] = triangles
        found[:, columns, rows] = triangles
        return found

    @property
    def about(self) -> Mapping[str, Any]:
        """The circumstances of the search: representation, lift, margin, digits, seconds. Not part of the proof."""
        return dict(self.document.get("about", {}))

    def text(self) -> str:
        """The document as JSON, a line an entry of its lists."""
        return json.dumps(self.document, indent=None, separators=(", ", ": ")) + "\n"

    def save(self, path: Path | str) -> None:
        """Write the document."""
        Path(path).write_text(self.text(), encoding="utf-8")

    @classmethod
    def of_text(cls, text: str | bytes) -> Certificate:
        """A certificate from JSON; raises `Refused` unless it verifies."""
        try:
            document = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise Refused(f"not a JSON document: {error}") from error
        if not isinstance(document, dict):
            raise Refused("not a JSON object")
        return cls(document, verify(document))


@dataclass(frozen=True)
class Claim:
    """A claim about a loop, before its proof is rounded."""

    kind: str
    value: Fraction
    system: SwitchedSystem
    language: Language
    gains: Gains | None = None
    peak: Fraction = Fraction(1)
    alpha: Sequence[Fraction] = ()
    word: Sequence[Label] = ()
    at_least: LowerBound | None = None
    chain: Sequence[Sequence[Fraction]] = ()

    def document(self, proof: Mapping[str, Any], about: Mapping[str, Any]) -> dict[str, Any]:
        """The document with a proof, its checksum included."""
        problem: dict[str, Any] = {"modes": self.system.as_document(), "constraint": dict(self.language.constraint)}
        if self.gains is not None:
            problem["gains"] = self.gains.as_document()
        if self.kind == "reach":
            problem["peak"] = decimal(self.peak)
        if self.system.period is not None:
            problem["period"] = decimal(self.system.period)
        if self.chain:
            problem["chain"] = [[decimal(item) for item in row] for row in self.chain]
        claim: dict[str, Any] = {"kind": self.kind, "value": decimal(self.value)}
        if self.kind == "unstable":
            claim["word"] = [plain(label) for label in self.word]
        if self.at_least is not None:
            claim["at_least"] = self.at_least.as_document()
        made = {
            "format": FORMAT,
            "version": VERSION,
            "problem": problem,
            "claim": claim,
            "proof": dict(proof),
            "about": dict(about),
        }
        return {**made, "checksum": checksum(made)}


def round_and_verify(
    claim: Claim,
    graph: Graph,
    matrices: Array,
    margin: float,
    about: Mapping[str, Any],
    *,
    name: str = "matrices",
    turn: Coordinates | None = None,
) -> Certificate:
    """The certificate of a claim: its proof rounded as coarsely as the margin allows, and verified exactly.

    Parameters
    ----------
    claim, graph
        What the certificate says, and the graph whose inequalities prove it.
    matrices
        One a node (or, for multipliers, one an edge and jump), count x n x n.
    margin
        Smallest eigenvalue of all the inequalities, in the matrices' scale and coordinates. What is left of it in x, at
        least, stands in the document's `about`.
    about
        Notes for people, which prove nothing.
    name
        Key of the matrices in the document.
    turn
        Coordinates z = S x of the matrices; they are brought back to x exactly, so that no margin is lost.

    Raises
    ------
    NotCertifiedError
        No rounding passes the exact check.
    """
    started = time.perf_counter()
    if not margin > 0:
        raise NotCertifiedError(f"no margin is left at {claim.kind} {float(claim.value):.9g}")
    turn = turn or Coordinates(np.eye(matrices.shape[-1]))
    exact, kept = turn.matrices(matrices), margin * min(turn.smallest, 1.0) ** 2
    first = max(1, math.ceil(-math.log10(kept)) + 1)
    reason: Refused | None = None
    for digits in range(first, min(first + 2 * TRIES, DIGITS_MAX), 2):
        document = claim.document(
            proof_of(graph, exact, 10**digits, claim.alpha, name),
            {**about, "margin": float(f"{kept:.3g}"), "digits": digits},
        )
        try:
            verdict = verify(document)
        except Refused as error:
            reason = error
            continue
        document["about"]["verify_s"] = round(time.perf_counter() - started, 4)
        return Certificate({**document, "checksum": checksum(document)}, verdict)
    raise NotCertifiedError(
        f"{claim.kind} {float(claim.value):.9g}: the rounded matrices fail the exact check: {reason}"
    )


def proof_of(
    graph: Graph, matrices: Sequence[ExactMatrix], denominator: int, alpha: Sequence[Fraction], name: str
) -> dict[str, Any]:
    """Graph and matrices as a document holds them: integers over one denominator, upper triangles row after row.

    Parameters
    ----------
    graph
        The graph of N nodes that the matrices belong to.
    matrices
        N of n x n, symmetric; rounded to multiples of 1 / denominator.
    denominator
        Common denominator of all entries.
    alpha
        Contractions of the theorem, exact; empty where it has none.
    name
        Key of the matrices in the document.

    Returns
    -------
    dict
        JSON values.
    """
    proof: dict[str, Any] = {
        "nodes": graph.nodes,
        "edges": [[u, plain(label), v] for u, label, v in graph.edges],
        "jumps": [list(jump) for jump in graph.jumps],
        "denominator": denominator,
        name: triangles(matrices, denominator),
    }
    return {**proof, "alpha": [decimal(item) for item in alpha]} if alpha else proof


def triangles(matrices: Sequence[ExactMatrix], denominator: int) -> list[list[int]]:
    """Upper triangles row after row, rounded to whole multiples of 1 / denominator.

    Parameters
    ----------
    matrices
        N of n x n, symmetric.
    denominator
        Common denominator of all entries.
    """
    return [[round(item * denominator) for i, row in enumerate(rows) for item in row[i:]] for rows in matrices]


def plain(label: Label) -> Any:
    """A letter as documents hold it."""
    return list(label) if isinstance(label, tuple) else label
