"""Random switched systems in random coordinates and units: whether the answers are those of the systems they came from.

`python -m benchmarks.theory_coordinates [COUNT] [SEED]` prints a line a system and the shares.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from decimal import Decimal, localcontext
from fractions import Fraction

import numpy as np
from scipy import linalg, optimize

from theory import ArbitrarySwitching, DwellTime, Representation, SwitchedSystem, TheoryError
from theory.arrays import Array
from theory.checker import multiply
from theory.switching import gain, reach, stability
from theory.switching.coordinates import inverse
from theory.switching.language import Language

SAME = 1e-4
"""Relative difference of two answers that count as equal."""

BUDGET_S = 8.0
"""Seconds in which lifts are raised, for each answer."""

ENTRY_MAX = 1e9


@dataclass(frozen=True)
class Case:
    """A system, the same one in other coordinates and units, and what turns the gain of the one into the other's."""

    base: SwitchedSystem
    moved: SwitchedSystem
    language: Language
    turn: Array
    condition: float
    gain_unit: float
    radius: float | None
    """The smallest ball of Lemma 4.1 in the new coordinates, where a single mode allows to compute it by itself."""


@dataclass(frozen=True)
class Outcome:
    """What came of a case: ratios of the answers less 1, what was not reached in words, and seconds."""

    rate: float
    gain: float
    radius: float
    told: str
    seconds: float

    @property
    def same(self) -> bool:
        """Whether all answers are equal, in time."""
        differences = [abs(one) for one in (self.rate, self.gain, self.radius)]
        return max(differences) <= SAME and self.seconds <= 60


def cases(count: int, seed: int) -> Iterator[Case]:
    """Systems of one to three modes and two to four states, conditions of 1 to 1e6, units of 1e-6 to 1e6."""
    rng = np.random.default_rng(seed)
    made = 0
    while made < count:
        found = _case(rng, single=made % 3 == 0)
        if found is not None:
            made += 1
            yield found


def _case(rng: np.random.Generator, *, single: bool) -> Case | None:
    modes, n = 1 if single else int(rng.integers(2, 4)), int(rng.integers(2, 5))
    a = rng.normal(size=(modes, n, n))
    a = np.round(a * (rng.uniform(0.5, 0.98) / np.abs(np.linalg.eigvals(a)).max(axis=1))[:, None, None], 4)
    e, c = np.round(rng.normal(size=(modes, n, 1)), 3), np.round(rng.normal(size=(modes, 1, n)), 3)
    tau = 1 if single else int(rng.integers(1, 4))
    base = SwitchedSystem(A=a.tolist(), E=e.tolist(), C=c.tolist())
    language = DwellTime(tau, modes=modes) if tau > 1 else ArbitrarySwitching(modes=modes)
    if stability.slowest_word(base, language)[0] > 0.99:  # gains of unstable systems are none
        return None
    condition = 10 ** rng.uniform(0, 6)
    left, right = (linalg.qr(rng.normal(size=(n, n)))[0] for _ in range(2))
    turn = left @ np.diag(np.geomspace(1, condition, n)) @ right
    units = 10 ** rng.uniform(-6, 6, n) if rng.random() < 0.5 else np.ones(n)
    turn = units[:, None] * turn
    drive, seen = 10 ** rng.uniform(-6, 6, 2) if rng.random() < 0.5 else (1.0, 1.0)
    exact = _exact(turn)
    back = inverse(exact)
    moved = {
        "A": [_texts(multiply(multiply(exact, _exact(one)), back)) for one in a],
        "E": [_texts(multiply(exact, _exact(one * drive))) for one in e],
        "C": [_texts(multiply(_exact(one * seen), back)) for one in c],
    }
    if max(abs(float(x)) for rows in moved.values() for one in rows for row in one for x in row) > ENTRY_MAX:
        return None
    radius = _smallest_ball(a[0], e[0] * drive, turn) if single else None
    return Case(base, SwitchedSystem(**moved), language, turn, float(np.linalg.cond(turn)), float(drive * seen), radius)


def _exact(matrix: Array) -> list[list[Fraction]]:
    return [[Fraction(repr(float(item))) for item in row] for row in matrix]


def _texts(rows: list[list[Fraction]]) -> list[list[str]]:
    """Decimals of 30 digits: with 16, coordinates of a condition of 1e6 would make another system of it."""
    with localcontext() as context:
        context.prec = 30
        return [[str(Decimal(x.numerator) / Decimal(x.denominator)) for x in row] for row in rows]


def _smallest_ball(a: Array, e: Array, turn: Array) -> float:
    """The smallest ball around T times the ellipsoids of Lemma 4.1, by Lyapunov's equation and a search of alpha."""
    slowest = float(np.abs(np.linalg.eigvals(a)).max())

    def ball(logit: float) -> float:
        share = slowest**2 + (1 - slowest**2) / (1 + np.exp(-logit))
        shape = linalg.solve_discrete_lyapunov(a / np.sqrt(share), e @ e.T / (1 - share))
        return float(np.sqrt(np.linalg.norm(turn @ shape @ turn.T, 2)))

    start = min(np.linspace(-6, 6, 49), key=ball)
    found = optimize.minimize_scalar(ball, bounds=(start - 0.25, start + 0.25), method="bounded")
    return min(ball(start), float(found.fun))


def outcome(case: Case, budget: float = BUDGET_S) -> Outcome:
    """The answers about the system in new coordinates beside those about the one it came from."""
    started, told = time.perf_counter(), []
    differences = []
    for name, ask, unit in (("rate", stability.decay_rate, 1.0), ("gain", gain.certify, case.gain_unit)):
        try:
            one = ask(case.base, case.language, budget=budget)
            started = time.perf_counter() if name == "rate" else started
            open_still = one.at_least is None or one.value / one.at_least - 1 > SAME
            lift = Representation(lift=one.about["lift"]) if open_still else None  # else the clock chooses another one
            two = ask(case.moved, case.language, representation=lift, budget=budget)
            differences.append(two.value / (one.value * unit) - 1)
            if open_still or two.at_least is None or two.value / two.at_least - 1 > SAME:
                told.append(f"{name} between {two.at_least or 0.0:.6g} and {two.value:.6g}")
        except TheoryError as error:
            differences.append(np.inf)
            told.append(f"{name}: {error}")
    differences.append(0.0)
    if case.radius is not None:
        try:
            differences[-1] = reach.certify(case.moved, case.language).value / case.radius - 1
        except TheoryError as error:
            differences[-1] = np.inf
            told.append(f"radius: {error}")
    rate, loud, radius = differences
    return Outcome(rate, loud, radius, "; ".join(told), time.perf_counter() - started)


def main(count: int, seed: int) -> None:
    """Print every case and the share of equal answers."""
    found = []
    for number, case in enumerate(cases(count, seed)):
        done = outcome(case)
        found.append(done)
        print(  # a report
            f"{number:4d} n={case.base.size} N={case.base.modes} condition {case.condition:8.1e} "
            f"rate {done.rate:+.1e} gain {done.gain:+.1e} radius {done.radius:+.1e} {done.seconds:5.1f} s "
            f"{'' if done.same else 'NOT THE SAME '}{done.told:.200}", flush=True,
        )  # fmt: skip
    times = np.array([one.seconds for one in found])
    print(
        f"equal to {SAME:g}: {sum(one.same for one in found)} of {count}; seconds: median {np.median(times):.2f}, "
        f"largest {times.max():.1f}"
    )


if __name__ == "__main__":
    given = [int(item) for item in sys.argv[1:]]
    main(given[0] if given else 200, given[1] if len(given) > 1 else 0)
