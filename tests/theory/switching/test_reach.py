"""Theorems 4.3-4.5: tubes of given loops, gains of the smallest ball, the double-clock controller; Example 4.4."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import strategies as st

from tests.samples import samples
from theory import (
    ArbitrarySwitching,
    DoubleClock,
    DwellTime,
    EllipsoidalTube,
    IllPosedError,
    NotCertifiedError,
    PersistentDwellTime,
    Representation,
    SwitchedSystem,
    verify,
)
from theory.switching import double_clock, reach, synthesis
from theory.switching.examples import example

CLOCKED = PersistentDwellTime(1, 1, modes=2).clocked(1)


@pytest.fixture(scope="module")
def design():
    """Example 4.4, alpha per mode, by the automaton."""
    return reach.minimize(example("example_4_4"), CLOCKED)


def test_example_4_4_as_printed():
    """Theorem 4.4 with words of L = 1 that share matrices, alpha on the grid 0.1..0.9."""
    found = reach.minimize(
        example("example_4_4"), CLOCKED, representation=Representation("words", 1, share_matrices=True), alpha="grid"
    )
    assert found.bound == pytest.approx(1.4264, abs=1e-4)
    assert found.certificate.document["proof"]["alpha"] == ["0.5", "0.5"]


@pytest.mark.slow
def test_example_4_4_better(design):
    assert design.certificate.value <= 1.387
    assert verify(design.certificate.document)
    common = reach.minimize(example("example_4_4"), CLOCKED, alpha="common")
    assert design.bound < common.bound
    lower, _ = double_clock.largest_radius_word(example("example_4_4"), CLOCKED, gains=design.gains)
    assert 0.98 * design.certificate.value < lower <= design.certificate.value


def test_ten_thousand_signals_with_extremal_disturbances_stay_in_the_tube(design):
    """Disturbances at the peak, each pushing the error outwards, along random signals of both kinds of word."""
    system, tube = example("example_4_4"), EllipsoidalTube.of(design.certificate)
    chance = np.random.default_rng(5)
    count, steps = 10_000, 40
    e = np.zeros((count, 2))
    before = np.zeros(count, dtype=int)
    worst = farthest = 0.0
    loops = {
        (m, c): system.floats[m - 1]["A"] + system.floats[m - 1]["B"] @ design.gains[m, c]
        for m in (1, 2)
        for c in (0, 1)
    }
    for k in range(steps):
        stay = chance.random(count) < np.linspace(0.1, 0.9, count)
        mode = np.where(stay & (before > 0), before, chance.integers(1, 3, count))
        clock = (mode == before).astype(int)
        following = np.empty_like(e)
        for m in (1, 2):
            for c in (0, 1):
                chosen = (mode == m) & (clock == c)
                push = system.floats[m - 1]["E"][:, 0]
                moved = e[chosen] @ loops[m, c].T
                sign = np.where(moved @ push >= 0, 1.0, -1.0)
                if k < 3:
                    sign = chance.choice([-1.0, 1.0], len(moved))
                following[chosen] = moved + sign[:, None] * push
        e, before = following, mode
        worst = max(worst, float(tube.level(e).max()))
        farthest = max(farthest, float(np.linalg.norm(e, axis=1).max()))
    assert worst <= 1
    assert 1.1 < farthest <= design.certificate.value


def test_a_given_loop_and_its_peak_scale(design):
    system = example("example_4_4")
    alpha = [float(item) for item in design.certificate.document["proof"]["alpha"]]
    one = reach.certify(system, CLOCKED, gains=design.gains, alpha=alpha)
    two = reach.certify(system, CLOCKED, gains=design.gains, alpha=alpha, peak="0.25")
    assert two.value == pytest.approx(one.value / 4, rel=1e-5)


def test_the_double_clock_controller(design):
    """Theorem 4.5 with e(0) = 0: the nominal state decays as certified, the error stays in the tube."""
    system = example("example_4_4")
    nominal = synthesis.stabilize(system, CLOCKED)
    controller = DoubleClock(system, nominal.gains, design.gains, clock_nominal=1, clock_error=1)
    tube = EllipsoidalTube.of(design.certificate)
    chance = np.random.default_rng(6)
    for seed in range(20):
        signal = PersistentDwellTime(1, 1, modes=2).random(60, seed)
        noise = chance.choice([-1.0, 1.0], (60, 1))
        x, z = controller.simulate(np.array([-10.0, 1.8]), signal, noise)
        assert np.all(tube.level(x - z) <= 1)
        assert np.linalg.norm(z[-1]) < 1e-6
        assert np.linalg.norm(x[-1] - z[-1]) <= design.certificate.value


@pytest.mark.slow
def test_dwell_time_with_two_clocks():
    """tau_z = 2, tau_e = 3: the controller holds for the larger."""
    system = example("example_4_4")
    nominal = synthesis.stabilize(system, PersistentDwellTime(2, 1, modes=2))
    error = reach.minimize(system, PersistentDwellTime(3, 1, modes=2), alpha="grid")
    controller = DoubleClock(system, nominal.gains, error.gains, clock_nominal=2, clock_error=3)
    signal = PersistentDwellTime(3, 1, modes=2).random(80, 1)
    x, z = controller.simulate(np.array([5.0, -3.0]), signal, np.random.default_rng(0).choice([-1.0, 1.0], (80, 1)))
    assert np.all(EllipsoidalTube.of(error.certificate).level(x - z) <= 1)
    assert np.linalg.norm(z[-1]) < 1e-6


@pytest.mark.slow
@samples(4, 15, seed=st.integers(0, 10_000), tau=st.integers(1, 3))
def test_no_disturbance_leaves_a_certified_ball(seed, tau):
    chance = np.random.default_rng(seed)
    maps = chance.normal(size=(2, 2, 2))
    maps *= 0.7 / np.linalg.norm(maps, 2, axis=(1, 2))[:, None, None]
    system = SwitchedSystem(A=np.round(maps, 3), E=np.round(chance.normal(size=(2, 2, 1)), 2))
    if not np.any(system.floats[0]["E"]) and not np.any(system.floats[1]["E"]):
        return
    language = DwellTime(tau, modes=2)
    certificate = reach.certify(system, language, alpha="common")
    lower, _ = double_clock.largest_radius_word(system, language, longest=5)
    assert lower <= certificate.value


def test_bad_input_is_named(design):
    system = example("example_4_4")
    with pytest.raises(IllPosedError, match="peak"):
        reach.certify(system, CLOCKED, gains=design.gains, peak=0)
    with pytest.raises(IllPosedError, match="alpha"):
        reach.certify(system, CLOCKED, gains=design.gains, alpha=[0.5, 1.0])
    with pytest.raises(IllPosedError, match="alpha"):
        reach.minimize(system, CLOCKED, alpha="luck")
    with pytest.raises(IllPosedError, match="E: a reachable set"):
        reach.certify(example("example_4_3"), DwellTime(1, modes=2))
    with pytest.raises(NotCertifiedError) as caught:
        reach.certify(SwitchedSystem([[["1.2"]]], E=[[["1"]]]), ArbitrarySwitching(modes=1))
    assert caught.value.counterexample.kind == "unstable"
