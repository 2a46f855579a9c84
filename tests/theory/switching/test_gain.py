"""Theorems 3.2, 3.3 and Corollary 3.1: the l2 gain of a loop, and gains that minimise it; Table 3.3."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from theory import (
    ArbitrarySwitching,
    Asynchronous,
    DwellTime,
    IllPosedError,
    NotCertifiedError,
    PersistentDwellTime,
    Representation,
    SwitchedSystem,
    verify,
)
from theory.switching import gain, stability, synthesis
from theory.switching.examples import TABLE_3_3_TAU, example, table_3_3


@pytest.mark.slow
@pytest.mark.parametrize("cell", table_3_3(), ids=lambda cell: f"delay {cell.delay}, lift {cell.lift}")
def test_table_3_3(cell):
    """Symmetric X gives the printed gain, free X no more, and the loop's own certificate less than either."""
    system, language = example("example_3_1"), Asynchronous(TABLE_3_3_TAU, cell.delay, modes=2)
    representation = Representation("words", cell.lift)
    printed = synthesis.minimize_gain(system, language, symmetric=True, representation=representation)
    free = synthesis.minimize_gain(system, language, representation=representation)
    assert printed.bound == pytest.approx(cell.gain, abs=1e-4)
    assert free.bound <= printed.bound + 1e-6
    for design in (printed, free):
        assert design.certificate.value <= design.bound + 1e-5
        assert verify(design.certificate.document)
        lower, _ = gain.largest_gain_word(system, language, gains=design.gains, longest=5)
        assert lower <= design.certificate.value


@pytest.mark.slow
def test_example_3_1_reanalysed():
    system = example("example_3_1")
    language = Asynchronous(3, 2, modes=2)
    design = synthesis.minimize_gain(system, language, representation=Representation(lift=3))
    assert design.certificate.value < 5.56
    lower, word = gain.largest_gain_word(system, language, gains=design.gains, longest=3)
    assert lower == pytest.approx(design.certificate.value, rel=1e-4)
    assert word == ((2, 2, 3),)


@pytest.mark.slow
def test_the_gain_falls_with_dwell_time_and_grows_with_delay():
    """Fig. 3.3, at lift 1."""
    system = example("example_3_1")
    found = {
        (tau, delay): synthesis.minimize_gain(
            system, Asynchronous(tau, delay, modes=2), symmetric=True, representation=Representation("words", 1)
        ).bound
        for delay in (0, 1, 2)
        for tau in (delay + 1, delay + 2, 6)
    }
    for delay in (0, 1, 2):
        assert found[delay + 1, delay] >= found[delay + 2, delay] >= found[6, delay] - 1e-6
    assert found[6, 0] <= found[6, 1] <= found[6, 2]


@pytest.mark.slow
def test_orderings_of_example_3_2():
    """Remark 3.7 and Fig. 3.4a: a clock beats a mode, a mode beats one gain for all."""
    system, language = example("example_3_2"), Asynchronous(3, 0, modes=2)
    found = [
        synthesis.minimize_gain(system, language, schedule=s, representation=Representation(lift=1)).bound
        for s in ("clock", "mode", "common")
    ]
    assert found[0] <= found[1] + 1e-7 <= found[2] + 2e-7
    lifts = [synthesis.minimize_gain(system, language, representation=Representation(lift=a)).bound for a in (0, 1, 2)]
    assert lifts[0] + 1e-6 >= lifts[1] >= lifts[2] - 1e-6


def test_one_mode_has_the_gain_of_its_transfer_function():
    """Against the H-infinity norm on a grid of frequencies."""
    system = SwitchedSystem(
        A=[[["0.9", "0.3"], ["-0.4", "0.7"]]], C=[[["1", "0.5"]]], E=[[["1"], ["0.2"]]], F=[[["0.3"]]]
    )
    certificate = gain.certify(system, ArbitrarySwitching(modes=1))
    mode = system.floats[0]
    angles = np.linspace(0, np.pi, 20_001)
    response = [
        abs((mode["C"] @ np.linalg.solve(np.exp(1j * w) * np.eye(2) - mode["A"], mode["E"]) + mode["F"])[0, 0])
        for w in angles
    ]
    assert certificate.value == pytest.approx(max(response), rel=1e-5)
    assert gain.word_gain(system, (1,)) == pytest.approx(max(response), rel=1e-6)
    assert gain.word_gain(system, (1, 1, 1)) == pytest.approx(max(response), rel=1e-6)


@pytest.mark.slow
@given(st.integers(0, 10_000), st.integers(1, 3), st.integers(0, 1))
@settings(max_examples=25, deadline=None)
def test_no_periodic_word_exceeds_a_certified_gain(seed, tau, lift):
    chance = np.random.default_rng(seed)
    maps = chance.normal(size=(2, 2, 2))
    maps *= 0.75 / np.linalg.norm(maps, 2, axis=(1, 2))[:, None, None]
    system = SwitchedSystem(
        A=np.round(maps, 3), C=np.round(chance.normal(size=(2, 1, 2)), 2), E=np.round(chance.normal(size=(2, 2, 1)), 2)
    )
    language = DwellTime(tau, modes=2)
    certificate = gain.certify(system, language, representation=Representation(lift=lift))
    lower, _ = gain.largest_gain_word(system, language, longest=8)
    assert lower <= certificate.value


def test_random_disturbances_stay_below_the_gain():
    system, language = example("example_3_1"), Asynchronous(3, 1, modes=2)
    design = synthesis.minimize_gain(system, language, representation=Representation(lift=1))
    chance = np.random.default_rng(4)
    for seed in range(50):
        word = language.random(120, seed)
        state, out, noise = np.zeros(2), 0.0, 0.0
        for label in word:
            mode = system.floats[label[0] - 1]
            w = chance.normal(size=1)
            gain_now = design.gains[label[1], label[2]]
            out += float(np.sum(((mode["C"] + mode["D"] @ gain_now) @ state + mode["F"] @ w) ** 2))
            noise += float(w @ w)
            state = (mode["A"] + mode["B"] @ gain_now) @ state + mode["E"] @ w
        assert out <= design.certificate.value**2 * noise


@pytest.mark.slow
def test_stabilising_gains():
    """Corollary 3.1 on Example 3.1 and Theorem 4.2 on Example 4.4, for every schedule that exists."""
    design = synthesis.stabilize(example("example_3_1"), Asynchronous(3, 2, modes=2))
    assert design.certificate.value <= design.bound + 1e-6 < 1
    nominal = synthesis.stabilize(example("example_4_4"), PersistentDwellTime(1, 1, modes=2))
    assert nominal.certificate.value < 0.45
    slowest, _ = stability.slowest_word(
        example("example_4_4"), synthesis.with_clock(PersistentDwellTime(1, 1, modes=2)), gains=nominal.gains, longest=8
    )
    assert slowest <= nominal.certificate.value
    mode = synthesis.stabilize(example("example_4_4"), PersistentDwellTime(1, 1, modes=2), schedule="mode")
    assert nominal.bound <= mode.bound + 1e-3


def test_the_smallest_dwell_time_that_can_be_stabilised():
    """Two modes that no common gains hold under arbitrary switching."""
    system = SwitchedSystem(
        A=[[["1.2", "1"], ["0", "0.3"]], [["0.3", "0"], ["1", "1.2"]]], B=[[["1"], ["0"]], [["0"], ["1"]]]
    )
    tau, certificate = stability.smallest(
        lambda tau: synthesis.stabilize(system, DwellTime(tau, modes=2), schedule="common", tolerance=0.05).certificate,
        high=12,
    )
    assert certificate.value < 1
    assert tau >= 1


def test_what_is_missing_is_named():
    with pytest.raises(IllPosedError, match="C: an l2 gain needs"):
        gain.certify(example("example_4_3"), DwellTime(2, modes=2))
    with pytest.raises(IllPosedError, match="B: a synthesis"):
        synthesis.stabilize(example("example_4_3"), DwellTime(2, modes=2))
    with pytest.raises(IllPosedError, match="schedule"):
        synthesis.stabilize(example("example_4_4"), DwellTime(2, modes=2), schedule="weather")


def test_an_unstable_loop_has_no_gain():
    system = SwitchedSystem(A=[[["1.1"]]], C=[[["1"]]], E=[[["1"]]])
    with pytest.raises(NotCertifiedError) as caught:
        gain.certify(system, ArbitrarySwitching(modes=1))
    assert caught.value.counterexample.kind == "unstable"
    with pytest.raises(NotCertifiedError):
        synthesis.stabilize(SwitchedSystem(A=[[["1.1"]]], B=[[["0"]]]), ArbitrarySwitching(modes=1))
