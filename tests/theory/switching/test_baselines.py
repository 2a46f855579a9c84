"""The rivals: valid bounds, and never below what the theorems give."""

from __future__ import annotations

import math

import numpy as np
import pytest

from theory import Asynchronous, NotCertifiedError, Representation
from theory import PersistentDwellTime as Persistent
from theory.switching import baselines, reach, synthesis
from theory.switching.examples import example

ALPHAS, MUS = [k / 10 for k in range(1, 10)], [1.0, 1.1, 1.2, 1.5]


def test_a_level_is_the_largest_over_the_slowest_stage():
    for alpha, mu, tau, period in [(0.5, 1.1, 1, 1), (0.6, 1.2, 3, 2), (0.9, 1.01, 2, 0), (0.3, 2.0, 4, 1)]:
        level = baselines.largest_level(alpha, mu, tau, period)
        value, highest = 0.0, 0.0
        for k in range(6_000):
            place = k % (tau + period)
            value *= mu if place == 0 or place >= tau else 1.0
            highest = max(highest, value)
            value = alpha * value + 1 - alpha
        assert level == pytest.approx(max(highest, value), rel=1e-9)
    assert baselines.largest_level(0.9, 1.5, 1, 1) == math.inf


@pytest.mark.slow
def test_example_4_4_against_its_rivals():
    """Fig. 4.4 in its spirit: no rival has a smaller ball than Theorem 4.4 by the automaton."""
    system = example("example_4_4")
    ours = reach.minimize(system, Persistent(1, 1, modes=2))
    rival = baselines.mode_dependent_ball(system)
    tuned = baselines.quasi_time_dependent_ball(system, 1, 1, ALPHAS, MUS)
    assert ours.certificate.value <= rival.certificate.value
    assert ours.certificate.value < tuned.value
    with pytest.raises(NotCertifiedError):
        baselines.quasi_time_dependent_ball(system, 1, 1, [0.9], [2.0])


@pytest.mark.slow
def test_example_3_2_against_its_rivals():
    """Fig. 3.4a: the clock beats the mode, which beats one gain for all; and the tuned rival, at every dwell time."""
    system = example("example_3_2")
    mode, common = baselines.mode_dependent_gain(system), baselines.mode_dependent_gain(system, common=True)
    for tau in (2, 3, 4):
        ours = synthesis.minimize_gain(system, Asynchronous(tau, 0, modes=2), representation=Representation(lift=1))
        tuned = baselines.quasi_time_dependent_gain(system, tau, [0.9, 0.99, 0.994], [1.0001, 1.01, 1.1])
        assert ours.bound <= tuned.value
        assert ours.bound <= mode.bound <= common.bound
        assert np.isfinite(tuned.value)
