"""Feedback of what is measured: observers and gains found on one language, and certified together.

Of x+ = A x + B u + E w, y = C x + D u + F w the feedback has m = M x + N w alone. With the gains K given, the loop's
inequalities are linear in the observers L where a slack matrix is block triangular; with L given, in K. They are solved
in turn, each on the whole loop, so that an old observer and an old gain may act for a while after a switch.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from theory.errors import NotCertifiedError, SolverError
from theory.switching import gain, stability, synthesis
from theory.switching.language import Language
from theory.switching.output_loops import Known, OutputLoop
from theory.switching.representation import Representation
from theory.switching.synthesis import Design, GainSchedule, with_clock
from theory.switching.system import SwitchedSystem

ROUNDS = 6
"""Times that observers are found for gains and gains for observers, at most."""

NONE = "no observers for these gains at this lift; a larger one may do"

WORTH = 1e-3
"""Relative improvement for which another round is made."""


@dataclass(frozen=True)
class OutputDesign(Design):
    """Controllers, what they are made of, and the certificate of the loop they close.

    `gains` are the controllers; `bound` is the figure of the last synthesis inequalities (in floating point).
    """

    feedback: Known
    """K by the arguments of the schedule."""
    observers: Known
    """L likewise."""


def stabilize(
    system: SwitchedSystem,
    language: Language,
    *,
    schedule: GainSchedule = "clock",
    representation: Representation | None = None,
    tolerance: float = 1e-3,
    progress: Callable[[str], None] | None = None,
) -> OutputDesign:
    """Gains of the fastest decay where the state is known, then observers with which the loop decays fastest.

    Parameters
    ----------
    system
        With B and M.
    language
        With clocks (`with_clock` makes them) or asynchronous.
    schedule
        The arguments of K and L.
    representation
        Graph and lift.
    tolerance
        Of the decay rate, which is bisected.
    progress
        Receives the bounds of the rate in words.

    Raises
    ------
    NotCertifiedError
        No gains or no observers make every admissible signal stable by these inequalities.
    """
    system.need("BM", "a feedback of what is measured")
    language, representation, started = with_clock(language), representation or Representation(), time.perf_counter()
    loop, plain = OutputLoop(system, representation.graph(language), schedule), unmeasured(system)
    first = synthesis.stabilize(plain, language, schedule=schedule, representation=representation, tolerance=tolerance)
    feedback = loop.known(first.gains)
    best = loop.decaying(feedback, 1.0)
    for calm in (_weighed(plain), plain) if best is None else ():  # fast gains leave observers least
        if calm.has("C", "E") and best is None:
            made = synthesis.minimize_gain(calm, language, schedule=schedule, representation=representation).gains
            feedback = loop.known(made)
            best = loop.decaying(feedback, 1.0)
    if best is None:
        raise NotCertifiedError(NONE)
    low, high = 0.0, 1.0
    while high - low > tolerance:
        middle = (low + high) / 2
        found = loop.decaying(feedback, middle)
        low, high, best = (middle, high, best) if found is None else (low, middle, found)
        if progress:
            progress(f"decay rate between {low:.4f} and {high:.4f}")
    controllers = loop.controllers(feedback, best)
    certificate = stability.decay_rate(system, language, gains=controllers, representation=representation.fixed)
    return OutputDesign(controllers, high, certificate, time.perf_counter() - started, feedback, best)


def minimize_gain(
    system: SwitchedSystem,
    language: Language,
    *,
    schedule: GainSchedule = "clock",
    representation: Representation | None = None,
    progress: Callable[[str], None] | None = None,
) -> OutputDesign:
    """Observers and gains of a small l2 gain, found in turn while it falls, and the certificate of their loop.

    Parameters
    ----------
    system
        With B, C, E and M.
    language
        With clocks (`with_clock` makes them) or asynchronous.
    schedule
        The arguments of K and L.
    representation
        Graph and lift.
    progress
        Receives the gain of each round in words.

    Raises
    ------
    NotCertifiedError
        No gains or no observers by these inequalities, or their loop could not be certified.
    """
    system.need("BCDEFMN", "a feedback of what is measured, for the l2 gain")
    language, representation, started = with_clock(language), representation or Representation(), time.perf_counter()
    first = synthesis.minimize_gain(unmeasured(system), language, schedule=schedule, representation=representation)
    loop = OutputLoop(system, representation.graph(language), schedule)
    feedback, found = loop.known(first.gains), list[OutputDesign]()
    failure: Exception | None = None
    for _ in range(ROUNDS):
        try:
            bound, observers = loop.smallest(loop.observers, feedback)
            made = loop.controllers(feedback, observers)
            certificate = gain.certify(system, language, gains=made, representation=representation.fixed)
            found.append(OutputDesign(made, bound, certificate, time.perf_counter() - started, feedback, observers))
            if progress:
                progress(f"l2 gain {certificate.value:.6g} after {len(found)} observers")
            if len(found) > 1 and certificate.value > found[-2].certificate.value * (1 - WORTH):
                break
            _, feedback = loop.smallest(loop.gains, observers)
        except (SolverError, NotCertifiedError) as error:
            failure = error
            break
    if not found:
        raise NotCertifiedError(f"{NONE}: {failure}") from failure
    return min(found, key=lambda one: one.certificate.value)


def unmeasured(system: SwitchedSystem) -> SwitchedSystem:
    """The system whose feedback knows the whole state."""
    names = [name for name in system.exact[0] if name not in "MN"]
    return SwitchedSystem(**{name: [mode[name] for mode in system.exact] for name in names})


def _weighed(system: SwitchedSystem) -> SwitchedSystem:
    """The system with a disturbance on every state, and states and inputs for outputs."""
    n, m = system.size, len(system.exact[0]["B"][0])
    select = [[int(i == j) for j in range(n + m)] for i in range(n + m)]
    outs = {"C": [row[:n] for row in select], "D": [row[n:] for row in select], "E": [row[:n] for row in select[:n]]}
    return SwitchedSystem(
        **{name: [mode[name] for mode in system.exact] for name in "AB"},
        **{name: [rows] * system.modes for name, rows in outs.items()},
    )
