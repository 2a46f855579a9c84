"""The work of a check is foreseen, and its limits hold."""

from __future__ import annotations

import json
import time

import numpy as np
import pytest

from tests.pace import slowness
from theory import ArbitrarySwitching, OverLimit, Representation, SwitchedSystem, checker, verify
from theory.switching import stability


@pytest.fixture(scope="module")
def document():
    """A certificate of some hundred inequalities."""
    rng = np.random.default_rng(0)
    maps = rng.normal(size=(2, 3, 3))
    system = SwitchedSystem(A=np.round(0.7 * maps / np.linalg.norm(maps, 2, axis=(1, 2))[:, None, None], 3))
    made = stability.certify(system, ArbitrarySwitching(modes=2), representation=Representation(lift=6))
    return json.loads(made.text())


def test_the_estimate_is_near_what_it_takes(document):
    started = time.process_time()
    verify(document)
    took = time.process_time() - started
    found = checker.estimate(document)
    took /= slowness()
    assert took / 8 < found.seconds < 8 * max(took, 1e-3)
    assert found.memory_bytes > len(json.dumps(document))


def test_a_document_beyond_a_limit_is_not_begun(document):
    with pytest.raises(OverLimit, match=r"not checked: an estimated .* s, the limit"):
        verify(document, seconds=1e-4)
    with pytest.raises(OverLimit, match=r"bytes, the limit"):
        verify(document, memory_bytes=1000)
    assert verify(document, seconds=60, memory_bytes=10**9)


def test_a_check_ends_with_its_time(document, monkeypatch):
    """Where the estimate was too low, the clock tells."""
    monkeypatch.setattr(checker.work, "estimate", lambda _: checker.Work(0.0, 0))
    with pytest.raises(OverLimit, match="not checked to its end"):
        verify(document, seconds=1e-6)


@pytest.mark.slow
def test_edges_that_repeat_are_proved_once(document):
    changed = json.loads(json.dumps(document))
    changed["proof"]["edges"] *= 2000
    changed["checksum"] = checker.checksum(changed)
    started = time.process_time()
    assert verify(changed) == verify(document)
    assert time.process_time() - started < 3 * slowness()
