"""The figures and tables of chapters 3 and 4, ours beside the thesis's: rewrites the generated parts of docs/theory.md.

Run as `python -m benchmarks.theory_document`, or with the names of some parts; some two minutes on two cores.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

from benchmarks import theory_figures
from benchmarks.documents import DOCS, recompute, table
from theory import Asynchronous, NotCertifiedError, PersistentDwellTime, Representation
from theory.switching import baselines, double_clock, gain, reach, stability, synthesis
from theory.switching.alpha import Alpha
from theory.switching.examples import TABLE_3_3_TAU, example, radii, table_3_3
from theory.switching.system import mode_of

DOCUMENT = "theory.md"


def table_3_3_part() -> str:
    """The four printed gains beside ours: symmetric X, free X, the loop analysed again, the automaton."""
    system, rows = example("example_3_1"), []
    for cell in table_3_3():
        language, representation = Asynchronous(TABLE_3_3_TAU, cell.delay, modes=2), Representation("words", cell.lift)
        printed = synthesis.minimize_gain(system, language, symmetric=True, representation=representation)
        free = synthesis.minimize_gain(system, language, representation=representation)
        automaton = synthesis.minimize_gain(system, language, representation=Representation(lift=cell.lift))
        lower, _ = gain.largest_gain_word(system, language, gains=automaton.gains, longest=6)
        rows.append([
            f"{cell.delay}", f"{cell.lift}", f"{cell.gain:.4f}", f"{printed.bound:.5f}", f"{free.bound:.5f}",
            f"{free.certificate.value:.5f}", f"{free.certificate.about['inequalities']}",
            f"{automaton.certificate.value:.5f}", f"{automaton.certificate.about['inequalities']}", f"{lower:.5f}",
        ])  # fmt: skip
    headings = ["delay", "lift", "printed", "symmetric X", "free X", "its loop, certified", "inequalities",
                "automaton's loop, certified", "inequalities", "reached by a word"]  # fmt: skip
    return table(headings, rows, left=0)


def example_4_3_part() -> str:
    """What is decided at each lift, and how fast the slowest signal decays."""
    system, language, rows = example("example_4_3"), PersistentDwellTime(1, 1, modes=2), []
    for representation in [Representation("words", lift) for lift in (1, 2, 3, 4)] + [
        Representation(lift=lift) for lift in range(5)
    ]:
        inequalities = representation.graph(language).inequalities
        try:
            stability.certify(system, language, representation=representation)
            verdict = "certified"
        except NotCertifiedError as error:
            verdict = "infeasible, proved" if error.counterexample is not None else "not certified"
        rate = stability.decay_rate(system, language, representation=representation)
        lift = (
            f"L = {representation.lift}" if representation.kind == "words" else f"{representation.lift} letters ahead"
        )
        rows.append([representation.kind, lift, f"{inequalities}", verdict, f"{rate.value:.7f}"])
    slowest, word = stability.slowest_word(system, language)
    rows.append(["a periodic word", " ".join(map(str, word)), "", "", f"{slowest:.7f}"])
    return table(["representation", "lift", "inequalities", "stability", "decay rate certified"], rows, left=2)


def example_4_4_part() -> str:
    """Radii of the ball around the reachable set, as printed and better."""
    system, language = example("example_4_4"), PersistentDwellTime(1, 1, modes=2).clocked(1)
    rows = []
    tries: list[tuple[str, Representation, Alpha]] = [
        ("Theorem 4.4 as printed, L = 1, alpha on 0.1..0.9", Representation("words", 1, share_matrices=True), "grid"),
        ("... alpha common, searched", Representation("words", 1, share_matrices=True), "common"),
        ("... copies of a word with matrices of their own", Representation("words", 1), "grid"),
        ("... alpha a mode, searched", Representation("words", 1, share_matrices=True), "mode"),
        ("automaton, alpha a mode", Representation(), "mode"),
    ]
    gains = None
    for name, representation, alpha in tries:
        began = time.perf_counter()
        design = reach.minimize(system, language, representation=representation, alpha=alpha)
        took = time.perf_counter() - began
        values = " ".join(f"{float(item):.3f}" for item in design.certificate.document["proof"]["alpha"])
        rows.append([name, f"{design.bound:.5f}", f"{design.certificate.value:.5f}", values, f"{took:.2f}"])
        gains = design.gains
    rival = baselines.mode_dependent_ball(system)
    rows.append(["mode-dependent rival", f"{rival.bound:.5f}", f"{rival.certificate.value:.5f}", "", ""])
    tuned = baselines.quasi_time_dependent_ball(
        system, 1, 1, [k / 10 for k in range(1, 10)], [1 + k / 10 for k in range(1, 11)]
    )
    rows.append([
        f"quasi-time-dependent rival, mu on 1.1..2.0 (best {tuned.mu:g})", f"{tuned.value:.5f}", "",
        f"{tuned.alpha:g}", "",
    ])  # fmt: skip
    lower, word = double_clock.largest_radius_word(system, language, gains=gains)
    rows.append(
        [f"reached by repeating {' '.join(str(mode_of(letter)) for letter in word)}", "", f"{lower:.5f}", "", ""]
    )
    return table(["method", "synthesis", "certified", "alpha", "time [s]"], rows)


def radii_part() -> str:
    """Published joint and constrained spectral radii beside the bounds found, and what they took."""
    rows = []
    for one in radii():
        began = time.process_time()
        found = stability.decay_rate(one.system, one.language, budget=4.0)
        took, below = time.process_time() - began, found.at_least or 0.0
        rows.append([
            one.name, f"{one.value:.9g}", f"{below:.9g}", f"{found.value:.9g}", f"{found.value / below - 1:.1e}",
            f"{found.about['lift']}", f"{took:.1f}",
        ])  # fmt: skip
    return table(["radius of", "published", "at least", "below", "apart", "lift", "CPU [s]"], rows)


def figures_part(draw: Callable[[], dict[str, str]]) -> str:
    """Pictures with what they show; written beside the page."""
    lines = []
    for name, caption in draw().items():
        lines.append(f"![{caption}](images/{name})\n\n*{caption}*\n")
    return "\n".join(lines)


def parts() -> dict[str, Callable[[], str]]:
    """What computes each generated part, by its name."""
    folder = DOCS / "images"
    return {
        "table 3.3": table_3_3_part,
        "example 4.3": example_4_3_part,
        "example 4.4": example_4_4_part,
        "radii": radii_part,
        "figure 3.3": lambda: figures_part(lambda: theory_figures.figure_3_3(folder)),
        "figure 3.4": lambda: figures_part(lambda: theory_figures.figure_3_4(folder)),
        "figure 4.3": lambda: figures_part(lambda: theory_figures.figure_4_3(folder)),
        "figure 4.4": lambda: figures_part(lambda: theory_figures.figure_4_4(folder)),
        "figure 4.5": lambda: figures_part(lambda: theory_figures.figure_4_5(folder)),
        "figure 4.6": lambda: figures_part(lambda: theory_figures.figure_4_6(folder)),
    }


if __name__ == "__main__":
    recompute(DOCUMENT, parts(), sys.argv[1:])
