"""The checker: what it accepts is true, what breaks a claim it refuses by name, and it needs nothing but Python."""

from __future__ import annotations

import ast
import copy
import json
import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from theory import (
    Asynchronous,
    DwellTime,
    NotCertifiedError,
    PersistentDwellTime,
    Refused,
    Representation,
    SwitchedSystem,
    checker,
    verify,
)
from theory.switching import reach, stability, synthesis
from theory.switching.examples import example

SOURCES = sorted(Path(checker.__file__).parent.glob("*.py"))


def signed(document):
    return {**document, "checksum": checker.checksum(document)}


@pytest.fixture(scope="module")
def documents():
    """A certificate of every kind, as plain JSON."""
    slow = example("example_4_3")
    loud = example("example_3_1")
    pushed = example("example_4_4")
    arbitrary = PersistentDwellTime(1, 1, modes=2)
    made = {
        "stability": stability.certify(slow, arbitrary, representation=Representation("words", 2)),
        "rate": stability.decay_rate(slow, arbitrary, representation=Representation(lift=4)),
        "gain": synthesis.minimize_gain(loud, Asynchronous(3, 2, modes=2)).certificate,
        "reach": reach.minimize(pushed, arbitrary.clocked(1), alpha="grid").certificate,
    }
    with pytest.raises(NotCertifiedError) as caught:
        stability.certify(slow, arbitrary, representation=Representation("words", 1))
    made["infeasible"] = caught.value.counterexample
    with pytest.raises(NotCertifiedError) as caught:
        stability.certify(SwitchedSystem([[["1.01"]], [["0.5"]]]), DwellTime(3, modes=2))
    made["unstable"] = caught.value.counterexample
    return {name: json.loads(certificate.text()) for name, certificate in made.items()}


def test_the_checker_is_small_and_imports_the_standard_library_alone():
    texts = {source.stem: source.read_text() for source in SOURCES}
    assert sum(len(text.splitlines()) for text in texts.values()) < 1050
    imported = {
        ("." * node.level + (node.module or "") if isinstance(node, ast.ImportFrom) else alias.name)
        for text in texts.values()
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Import | ast.ImportFrom)
        for alias in node.names
    }
    own = {f".{name}" for name in texts}
    assert {name.partition(".")[0] for name in imported - own} <= set(sys.stdlib_module_names)


def test_the_checker_runs_alone(tmp_path, documents):
    """Copied somewhere else, in an interpreter without site packages."""
    (tmp_path / "checker").mkdir()
    for source in SOURCES:
        (tmp_path / "checker" / source.name).write_text(source.read_text())
    for name, document in documents.items():
        (tmp_path / f"{name}.json").write_text(json.dumps(document))
    code = (
        "import checker, json, pathlib\n"
        "for p in sorted(pathlib.Path().glob('*.json')): print(p.stem, checker.verify(json.loads(p.read_text())).claim)"
    )
    done = subprocess.run(
        [sys.executable, "-I", "-c", f"import sys; sys.path.insert(0, '.')\n{code}"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    assert len(done.stdout.splitlines()) == len(documents)


def test_every_kind_verifies(documents):
    claims = {name: verify(document).claim for name, document in documents.items()}
    assert "0.99698" in claims["rate"]
    assert "decays no faster" in claims["unstable"]
    assert "no quadratic functions" in claims["infeasible"]


def test_a_change_without_its_checksum_is_refused(documents):
    for document in documents.values():
        with pytest.raises(Refused, match="checksum"):
            verify({**document, "claim": {**document["claim"], "value": "0.1"}})


def lowest(document):
    """The smallest eigenvalue of all inequalities, by NumPy from the theorems: an independent look."""
    problem, proof, claim = document["problem"], document["proof"], document["claim"]
    modes = [{name: np.array(rows, dtype=float) for name, rows in mode.items()} for mode in problem["modes"]]
    gains = {(g["mode"], g["clock"]): np.array(g["K"], dtype=float) for g in problem.get("gains", [])}
    value = float(Fraction(claim["value"]))
    size = len(modes[0]["A"])
    matrices = []
    for triangle in proof["matrices"]:
        rows = np.zeros((size, size))
        rows[np.triu_indices(size)] = [item / proof["denominator"] for item in triangle]
        matrices.append(rows + rows.T - np.diag(np.diag(rows)))
    floor = np.eye(size) / value**2 if claim["kind"] == "reach" else 0.0
    found = [np.linalg.eigvalsh(rows - floor)[0] for rows in matrices]
    found += [np.linalg.eigvalsh(matrices[u] - matrices[v])[0] for u, v in proof["jumps"]]
    for u, label, v in proof["edges"]:
        mode = modes[(label if isinstance(label, int) else label[0]) - 1]
        gain_now = None if isinstance(label, int) else gains[label[1], label[2]]
        a = mode["A"] if gain_now is None else mode["A"] + mode["B"] @ gain_now
        if claim["kind"] == "stability":
            found.append(np.linalg.eigvalsh(value**2 * matrices[u] - a.T @ matrices[v] @ a)[0])
            continue
        e = mode["E"]
        zero = np.zeros((size, e.shape[1]))
        loop = np.hstack([a, e])
        if claim["kind"] == "gain":
            c = mode["C"] if gain_now is None else mode["C"] + mode["D"] @ gain_now
            out = np.hstack([c, mode["F"]])
            here = np.block([[matrices[u], zero], [zero.T, value**2 * np.eye(e.shape[1])]]) - out.T @ out
        else:
            alpha = float(proof["alpha"][(label if isinstance(label, int) else label[0]) - 1])
            share = (1 - alpha) / float(problem["peak"]) ** 2
            here = np.block([[alpha * matrices[u], zero], [zero.T, share * np.eye(e.shape[1])]])
        found.append(np.linalg.eigvalsh(here - loop.T @ matrices[v] @ loop)[0])
    return min(found)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["stability", "rate", "gain", "reach"])
def test_an_entry_beyond_its_margin_is_refused(documents, name):
    """Every entry is pushed up and down until eigenvalues say that an inequality breaks; the checker says so too."""
    document = documents[name]
    assert document["about"]["margin"] * 0.99 <= lowest(document) <= 1000 * document["about"]["margin"]
    accepted = refused = 0
    for node, entry in [(n, e) for n in range(min(6, document["proof"]["nodes"])) for e in range(3)]:
        for sign in (1, -1):
            for power in range(0, 40, 3):
                changed = copy.deepcopy(document)
                changed["proof"]["matrices"][node][entry] += sign * 2**power
                margin = lowest(changed)
                if margin > 1e-12:
                    assert verify(signed(changed))
                    accepted += 1
                elif margin < -1e-12:
                    with pytest.raises(Refused, match=r"violated: (edge|matrix|jump)"):
                        verify(signed(changed))
                    refused += 1
    assert accepted > 20
    assert refused > 100


@pytest.mark.parametrize("name", ["stability", "rate", "gain", "reach"])
def test_a_dropped_or_swapped_edge_is_refused(documents, name):
    document = documents[name]
    for number in range(len(document["proof"]["edges"])):
        changed = copy.deepcopy(document)
        del changed["proof"]["edges"][number]
        with pytest.raises(Refused, match="uncovered word"):
            verify(signed(changed))
    edge = document["proof"]["edges"][0]
    changed = copy.deepcopy(document)
    label = edge[1]
    changed["proof"]["edges"][0][1] = 3 - label if isinstance(label, int) else [3 - label[0], 3 - label[1], label[2]]
    with pytest.raises(Refused, match=r"uncovered word|violated"):
        verify(signed(changed))


def test_a_dropped_word_is_named(documents):
    document = copy.deepcopy(documents["stability"])
    proof = document["proof"]
    gone = {0, 1, 2}  # the word 1 1
    renumber = {node: place for place, node in enumerate(n for n in range(proof["nodes"]) if n not in gone)}
    proof["edges"] = [[renumber[u], x, renumber[v]] for u, x, v in proof["edges"] if not {u, v} & gone]
    proof["jumps"] = [[renumber[u], renumber[v]] for u, v in proof["jumps"] if not {u, v} & gone]
    proof["matrices"] = [rows for node, rows in enumerate(proof["matrices"]) if node not in gone]
    proof["nodes"] = len(renumber)
    with pytest.raises(Refused, match=r"uncovered word: [12 ]+ is admissible"):
        verify(signed(document))


@pytest.mark.parametrize(
    ("name", "factor"),
    [
        ("rate", "0.999"),
        ("gain", "0.99"),
        ("reach", "0.99"),
        ("stability", "0.95"),
        ("unstable", "1.02"),
        ("infeasible", "1.1"),
    ],
)
def test_a_bolder_claim_is_refused(documents, name, factor):
    changed = copy.deepcopy(documents[name])
    changed["claim"]["value"] = str(Fraction(changed["claim"]["value"]) * Fraction(factor))
    with pytest.raises(Refused, match=r"violated|decays faster"):
        verify(signed(changed))


def test_other_constraints_and_gains_are_refused(documents):
    changed = copy.deepcopy(documents["gain"])
    changed["problem"]["constraint"] = {"kind": "asynchronous", "tau": 2, "delay": 1}
    with pytest.raises(Refused, match="uncovered word"):
        verify(signed(changed))
    changed = copy.deepcopy(documents["gain"])
    changed["problem"]["gains"][0]["K"][0][0] = "5"
    with pytest.raises(Refused, match="violated: edge"):
        verify(signed(changed))
    changed = copy.deepcopy(documents["gain"])
    one, two = changed["problem"]["modes"]
    changed["problem"]["modes"] = [two, one]
    with pytest.raises(Refused, match="violated: edge"):
        verify(signed(changed))


JSON = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(10**6), 10**6)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=8,
)


@pytest.mark.slow
@given(st.data())
@settings(max_examples=300, deadline=None)
def test_whatever_is_put_into_a_document_it_is_refused_or_still_proved(documents, data):
    name = data.draw(st.sampled_from(sorted(documents)))
    document = copy.deepcopy(documents[name])
    at, key = document, data.draw(st.sampled_from(["problem", "claim", "proof"]))
    while True:
        inside = at[key]
        keys = (
            list(inside) if isinstance(inside, dict) else list(range(len(inside))) if isinstance(inside, list) else []
        )
        if not keys or data.draw(st.booleans()):
            break
        at, key = inside, data.draw(st.sampled_from(keys))
    at[key] = data.draw(JSON)
    try:
        verdict = verify(signed(document))
    except Refused:
        return
    assert verdict.inequalities > 0


@pytest.mark.parametrize("document", [{}, {"format": "x"}, {"format": "hrs-certificate", "version": 1, "checksum": 3}])
def test_malformed_documents_are_refused(document):
    with pytest.raises(Refused):
        verify(document)


@pytest.mark.parametrize("number", ["1e999999999", "nan", "inf", "1/0", 0.5, None, [1]])
def test_numbers_are_integers_decimals_or_fractions(documents, number):
    changed = copy.deepcopy(documents["stability"])
    changed["problem"]["modes"][0]["A"][0][0] = number
    with pytest.raises(Refused):
        verify(signed(changed))


def test_schur_stability_against_eigenvalues():
    chance = np.random.default_rng(1)
    for _ in range(300):
        size = int(chance.integers(1, 6))
        rows = [[Fraction(int(item), 100) for item in row] for row in chance.integers(-90, 90, (size, size))]
        radius = float(np.abs(np.linalg.eigvals(np.array(rows, dtype=float))).max())
        if abs(radius - 1) > 1e-9:
            assert checker.schur_stable(rows) == (radius < 1)


def test_definiteness_against_eigenvalues():
    chance = np.random.default_rng(2)
    for _ in range(300):
        size = int(chance.integers(1, 7))
        half = chance.integers(-9, 9, (size, size))
        rows = half @ half.T + int(chance.integers(-20, 20)) * np.eye(size, dtype=int)
        lowest = float(np.linalg.eigvalsh(rows)[0])
        if abs(lowest) < 1e-9:
            continue
        if lowest > 0:
            checker.prove(rows.tolist(), "it")
        else:
            with pytest.raises(Refused, match="violated: it"):
                checker.prove(rows.tolist(), "it")


def numbers_in(value, *at):
    """The places of the whole numbers of a document."""
    if isinstance(value, dict | list):
        items = value.items() if isinstance(value, dict) else enumerate(value)
        return [path for key, item in items for path in numbers_in(item, *at, key)]
    return [at] if type(value) is int else []


@pytest.mark.parametrize("kind", ["stability", "gain", "infeasible", "unstable"])
def test_numbers_equal_to_whole_ones_are_none(documents, kind):
    """True reads as 1 and 2.0 as 2: the same claim, in other words, or a letter that no mode has."""
    places = [path for path in numbers_in(documents[kind]) if path[0] in ("problem", "claim", "proof")]
    assert places
    for path in places[:: max(1, len(places) // 20)]:
        made = json.loads(json.dumps(documents[kind]))
        holder = made
        for key in path[:-1]:
            holder = holder[key]
        value = holder[path[-1]]
        for other in (float(value), *([bool(value)] if value in (0, 1) else [])):
            holder[path[-1]] = other
            with pytest.raises(Refused, match="whole numbers"):
                verify(signed(made))
