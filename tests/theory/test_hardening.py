"""Questions that once failed, hung or fooled somebody; each stays."""
# ruff: noqa: E501  # a document a line

from __future__ import annotations

import time

import numpy as np
import pytest

from tests.pace import slowness
from theory import (
    ArbitrarySwitching,
    Asynchronous,
    AverageDwellTime,
    DwellTime,
    Gains,
    IllPosedError,
    LabelledGraph,
    NotCertifiedError,
    PersistentDwellTime,
    Refused,
    Representation,
    SwitchedSystem,
    TooLargeError,
    checker,
    language_of,
    verify,
)
from theory.switching import double_clock, gain, reach, stability, synthesis

LOOP = {"nodes": 1, "edges": [[0, 1, 0]], "jumps": [], "denominator": 1, "matrices": [[1]]}


def document(modes, constraint, claim, proof, **problem):
    made = {
        "format": checker.FORMAT,
        "version": checker.VERSION,
        "problem": {"modes": modes, "constraint": constraint, **problem},
        "claim": claim,
        "proof": proof,
    }
    return {**made, "checksum": checker.checksum(made)}


def one(number):
    return {"A": [[number]]}


STABLE = {"kind": "stability", "value": "1"}


@pytest.mark.parametrize(
    "made",
    [
        document([one("0.5"), one("5")], {"kind": "graph", "initial": [0], "edges": [[0, 1, 1], [1, 1, 0], [0, "2", 1]]}, STABLE, LOOP),
        document([one("0.5"), one("5")], {"kind": "graph", "initial": [0], "edges": [[0, 1, 1], [1, 1, 0], [0, 3, 1]]}, STABLE, LOOP),
        document([{**one("0.5"), "B": [["1"]]}], {"kind": "clocked", "clock": 0, "of": {"kind": "arbitrary"}}, STABLE,
                 {**LOOP, "edges": [[0, [1, 1, 0], 0]]},
                 gains=[{"mode": 1, "clock": 0, "K": [["9"]]}, {"mode": 1, "clock": 0, "K": [["0"]]}]),
        document([{**one("0.5"), "B": [["1"]]}], {"kind": "arbitrary"}, STABLE, LOOP, gains=[{"mode": 1, "clock": 0, "K": [["9"]]}]),
        document([one("0.5")], {"kind": "arbitrary"}, {"kind": "infeasible", "value": "1"},
                 {"nodes": 0, "edges": [], "jumps": [], "denominator": 1, "multipliers": []}),
        document([one("0.5"), one("2")], {"kind": "graph", "edges": [[0, 1, 1], [1, 1, 0]]}, {"kind": "infeasible", "value": "1"},
                 {**LOOP, "edges": [[0, 2, 0]], "multipliers": [[1]]}),
        document([one("0.5")], {"kind": "clocked", "clock": 1, "of": {"kind": "clocked", "clock": 1, "of": {"kind": "arbitrary"}}}, STABLE, LOOP),
        document([one(" 0_5 ")], {"kind": "arbitrary"}, STABLE, LOOP),
        document([one("0.5")], {"kind": "dwell", "tau": 100_000}, STABLE, LOOP),
        document([one("0.5")], {"kind": "dwell", "tau": True + 0.5}, STABLE, LOOP),
        document([one("0.5")], {"kind": "dwell", "tau": 2, "period": 3}, STABLE, LOOP),
    ],
)  # fmt: skip
def test_documents_that_mislead_are_refused(made):
    with pytest.raises(Refused):
        verify(made)


@pytest.mark.parametrize(
    "made",
    [
        document([one("0.5")] * 2, {"kind": "average", "tau": "1000000007/1000000006", "burst": "10"}, STABLE, LOOP),
        document([one("0.5")] * 900, {"kind": "dwell", "tau": 1000}, STABLE, LOOP),
        document([one("0.5")] * 2, {"kind": "dwell", "tau": 1000}, {"kind": "unstable", "value": "1", "word": [1] * 20_000 + [2]}, LOOP),
        document([one("0.5")], {"kind": "dwell", "tau": 1000}, STABLE,
                 {**LOOP, "nodes": 4000, "edges": [[k, 1, 0] for k in range(4000)],
                  "jumps": [[k, k + 1] for k in range(3999)], "matrices": [[1]] * 4000}),
    ],
    ids=["average", "many modes", "long word", "chain of jumps"],
)  # fmt: skip
def test_documents_that_would_take_for_ever_are_refused(made):
    started = time.monotonic()
    with pytest.raises(Refused):
        verify(made)
    assert time.monotonic() - started < 60 * slowness()


@pytest.mark.slow
def test_languages_of_one_state_and_of_a_beginning_are_covered():
    two = SwitchedSystem(A=[[["0.5"]], [["0.4"]]])
    assert stability.certify(two, LabelledGraph([(0, 1, 0), (0, 2, 0)], modes=2)).value == 1
    assert stability.certify(two, LabelledGraph([("a", 1, "b"), ("b", 2, "b")], ["a"], modes=2)).value == 1
    single = SwitchedSystem(A=[[["1.5"]]], B=[[["1"]]])
    assert synthesis.stabilize(single, DwellTime(2, modes=1)).certificate.value < 1
    assert synthesis.stabilize(single, Asynchronous(3, 1, modes=1)).certificate.value < 1


@pytest.mark.parametrize("modes", [3, 5])
def test_a_counterexample_is_found_among_many_modes(modes):
    system = SwitchedSystem(A=[[["1.1", "0"], ["0", "0.5"]]] * modes)
    with pytest.raises(NotCertifiedError) as caught:
        stability.certify(system, ArbitrarySwitching(modes=modes))
    assert caught.value.counterexample.kind == "unstable"


@pytest.mark.parametrize("peak", ["0.000001", "0.01", "1", "100", "10000"])
def test_a_reachable_set_scales_with_its_peak(peak):
    system = SwitchedSystem(A=[[["0.5", "0.1"], ["0", "0.3"]]], E=[[["1"], ["0.5"]]])
    language = ArbitrarySwitching(modes=1)
    unit = reach.certify(system, language, alpha=[0.5]).value
    assert reach.certify(system, language, alpha=[0.5], peak=peak).value == pytest.approx(unit * float(peak), rel=1e-4)


@pytest.mark.parametrize("scale", ["0.0001", "1", "10000", "1000000"])
def test_a_gain_scales_with_its_disturbance(scale):
    a = [[["0.5", "0.2"], ["0.1", "0.4"]], [["0.3", "-0.4"], ["0.2", "0.5"]]]
    language = DwellTime(2, modes=2)
    unit = gain.certify(SwitchedSystem(A=a, C=[[["1", "0"]]] * 2, E=[[["1"], ["0.5"]]] * 2), language).value
    drive = [[[scale], [str(float(scale) / 2)]]] * 2
    scaled = gain.certify(SwitchedSystem(A=a, C=[[["1", "0"]]] * 2, E=drive), language).value
    assert scaled == pytest.approx(unit * float(scale), rel=1e-4)


def test_badly_scaled_states_are_balanced():
    system = SwitchedSystem(A=[[["0.5", "10000"], ["0", "0.5"]]])
    assert stability.certify(system, ArbitrarySwitching(modes=1)).value == 1
    assert stability.decay_rate(system, ArbitrarySwitching(modes=1)).value < 0.51


def test_a_gain_that_depends_on_more_does_no_worse():
    system = SwitchedSystem(
        A=[[["0.5", "0.1"], ["0", "0.3"]], [["0.2", "0.1"], ["0.3", "0.5"]]], B=[[["1"], ["0"]]] * 2
    )
    language = DwellTime(2, modes=2)
    mode = synthesis.stabilize(system, language, schedule="mode")
    clock = synthesis.stabilize(system, language)
    assert clock.bound <= mode.bound + 2e-3


def test_nothing_seen_or_nothing_pushed():
    silent = SwitchedSystem(A=[[["0.5"]]], C=[[["0"]]], E=[[["1"]]])
    assert gain.certify(silent, ArbitrarySwitching(modes=1)).value < 1e-2
    with pytest.raises(IllPosedError, match="E: is zero"):
        reach.certify(SwitchedSystem(A=[[["0.5"]]], E=[[["0"]]]), ArbitrarySwitching(modes=1))


def test_marginal_systems_get_a_counterexample():
    for number in ("1", "1.1"):
        with pytest.raises(NotCertifiedError) as caught:
            reach.certify(SwitchedSystem(A=[[[number]]], E=[[["1"]]]), ArbitrarySwitching(modes=1))
        assert caught.value.counterexample.kind == "unstable"


@pytest.mark.parametrize(
    "make",
    [
        lambda: PersistentDwellTime(2, 3, modes=3).words(2),
        lambda: DwellTime(1000, modes=19).automaton,
        lambda: AverageDwellTime("100/3", 200, modes=4).automaton,
    ],
)
def test_sizes_are_estimated_in_time(make):
    started = time.monotonic()
    with pytest.raises(TooLargeError):
        make()
    assert time.monotonic() - started < 10 * slowness()


K = Gains.of_document([{"mode": 1, "clock": 0, "K": [["9"]]}])
TWO = SwitchedSystem(A=[[["0.5", "0"], ["0", "0.5"]]], B=[[["1"], ["0"]]], C=[[["1", "0"]]], E=[[["1"], ["0"]]])
SINGLE = SwitchedSystem(A=[[["0.5"]]], B=[[["1"]]])


@pytest.mark.parametrize(
    "make",
    [
        lambda: stability.certify(SINGLE, ArbitrarySwitching(modes=1), gains=K),
        lambda: stability.certify(TWO, ArbitrarySwitching(modes=1).clocked(0), gains=K),
        lambda: synthesis.stabilize(SINGLE, DwellTime(2, modes=1), tolerance=0),
        lambda: stability.decay_rate(SINGLE, ArbitrarySwitching(modes=1), gap=0),
        lambda: SwitchedSystem(A=[[["1"]]], B=5),
        lambda: SwitchedSystem.of_modes([1]),
        lambda: SwitchedSystem(A=[[["1e99999999"]]]),
        lambda: SwitchedSystem(A=[[["1e-9999999"]]]),
        lambda: language_of({"kind": "graph", "edges": 5}, 2),
        lambda: language_of({"kind": "graph", "edges": [[0, 1, 0]], "initial": [[0]]}, 2),
        lambda: language_of({"kind": []}, 2),
        lambda: language_of(5, 2),
        lambda: ArbitrarySwitching(modes="2"),
        lambda: stability.certify(SINGLE, ArbitrarySwitching(modes=1), representation=Representation(lift=1.5)),
        lambda: ArbitrarySwitching(modes=2).graph(10**6),
        lambda: DwellTime(2, modes=2).words(100_000),
        lambda: reach.certify(TWO, ArbitrarySwitching(modes=1), alpha=5),
        lambda: reach.certify(TWO, ArbitrarySwitching(modes=1), alpha=["x"]),
        lambda: gain.word_gain(TWO, ()),
        lambda: gain.word_gain(TWO, (3,)),
        lambda: gain.word_gain(SINGLE, (1,)),
    ],
)
def test_bad_input_is_a_typed_error(make):
    with pytest.raises(IllPosedError):
        make()


@pytest.mark.slow
def test_no_periodic_word_short_enough_is_no_error():
    ring = LabelledGraph([(k, 1, (k + 1) % 14) for k in range(13)] + [(13, 2, 0)], modes=2)
    system = SwitchedSystem(A=[[["0.5"]]] * 2, C=[[["1"]]] * 2, E=[[["1"]]] * 2)
    assert gain.largest_gain_word(system, ring, longest=3) == (0.0, ())
    assert double_clock.largest_radius_word(system, ring, longest=3) == (0.0, ())
    average = synthesis.stabilize(TWO_MODES, AverageDwellTime("5/2", 2, modes=2))
    assert average.certificate.value < 1


TWO_MODES = SwitchedSystem(A=[[["1.2", "0.1"], ["0", "0.3"]], [["0.2", "0.1"], ["0.3", "0.5"]]], B=[[["1"], ["0"]]] * 2)


def test_matrices_of_a_word_are_none():
    with pytest.raises(NotCertifiedError) as caught:
        stability.certify(SwitchedSystem(A=[[["2", "0"], ["0", "1"]]]), ArbitrarySwitching(modes=1))
    assert caught.value.counterexample.matrices.shape == (0, 2, 2)
    assert np.isfinite(caught.value.counterexample.value)
