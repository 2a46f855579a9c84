"""How close the fitted stations come to tables 7.4-7.7: rewrites the generated parts of docs/reproduction.md.

Run as `python -m benchmarks.reproduction`; two minutes on two cores, the same figures every time.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from api.comparisons.thesis import COLUMNS, TABLES, Cells, agreements, closeness, log_errors, printed
from benchmarks.documents import rewrite, seconds, table
from benchmarks.fits import CONTROLLERS, FITS, PARAMETERS, figures, own_shapes, perturbed, shapes, shipped, unclamped

DOCUMENT = "reproduction.md"
SAMPLES = 200
SIZES = (0.003, 0.01)
SEED = 7
WORST = 14


def tables_part(ours: Cells) -> str:
    """Tables 7.4-7.7, ours beside the printed figure, each with its percentage against logic."""
    parts = []
    for scenario, number in TABLES.items():
        rows = [
            [controller, *(_pair(ours, scenario, controller, column) for column in COLUMNS)]
            for controller in CONTROLLERS
        ]
        parts.append(f"**Table {number}, {scenario}** (ours / thesis)\n\n" + table(
            ["controller", *(f"{column} [s]" for column in COLUMNS)], rows))  # fmt: skip
    return "\n\n".join(parts)


def _pair(ours: Cells, scenario: str, controller: str, column: str) -> str:
    texts = []
    for cells in (ours, printed()):
        value, logic = cells[scenario, controller, column], cells[scenario, "logic", column]
        percent = "" if controller == "logic" else f" ({100 * (value / logic - 1):+.1f} %)"
        texts.append(seconds(value) + percent)
    return " / ".join(texts)


def closeness_part(fits: dict[str, tuple[Cells, Cells]]) -> str:
    """Signs, orderings and log errors of each fit: S2 and S4 as they ship, and with the fit's own shapes."""
    rows = []
    for name, (ships, own) in fits.items():
        variants = [("as shipped", ships), ("own", own)] if shapes().get(name) else [("as shipped = own", ships)]
        for shape, cells in variants:
            found = closeness(cells)
            rows.append([
                name, shape, f"{found.signs} of {found.signs_of}", f"{found.orderings} of {found.orderings_of}",
                f"{found.log_error_median:.3f}", f"{found.log_error_p90:.2f}",
            ])  # fmt: skip
    headings = ["station", "shapes of S2 and S4", "signs", "orderings", "median", "90th percentile"]
    return table(headings, rows, left=2)


@dataclass(frozen=True)
class Spread:
    """What perturbations of one size did."""

    size: float
    signs: tuple[int, ...]  # a sample
    orderings: tuple[int, ...]
    agree: dict[tuple[str, str, str, str], float]  # share of samples, by (scenario, column, first, second)


def spread(size: float, samples: int = SAMPLES, seed: int = SEED) -> Spread:
    """`samples` seeded perturbations of thesis-fit of that size."""
    random = np.random.default_rng([seed, round(1e6 * size)])
    signs, orderings, agree = [], [], Counter[tuple[str, str, str, str]]()
    for _ in range(samples):
        same = agreements(figures(perturbed(size, random)))
        signs.append(sum(value for key, value in same.items() if key[2] == "logic"))
        orderings.append(sum(same.values()))
        agree.update({key: int(value) for key, value in same.items()})
    shares = {key: count / samples for key, count in agree.items()}
    return Spread(size, tuple(signs), tuple(orderings), shares)


def sensitivity_part(spreads: Sequence[Spread]) -> str:
    """Distribution of signs and orderings under perturbation."""
    rows = []
    for found in spreads:
        for what, values, of in (("signs", found.signs, 36), ("orderings", found.orderings, 72)):
            rows.append([
                f"+-{100 * found.size:g} %", f"{what}, of {of}", f"{min(values)}", f"{np.median(values):g}",
                f"{max(values)}", f"{100 * np.mean(np.array(values) == of):.0f} %",
            ])  # fmt: skip
    summary = table(["perturbation", "what", "minimum", "median", "maximum", "all agree"], rows, left=2)
    counts = [Counter(found.signs) for found in spreads]
    histogram = table(
        ["signs", *(f"+-{100 * found.size:g} %: samples" for found in spreads)],
        [[f"{value}", *(f"{count[value]}" for count in counts)]
         for value in sorted(set().union(*counts), reverse=True)],
    )  # fmt: skip
    lead = f"{len(spreads[0].signs)} samples a size, all {len(PARAMETERS)} fitted numbers drawn anew in each."
    return f"{lead}\n\n{summary}\n\n{histogram}"


def fragile_part(spreads: Sequence[Spread]) -> str:
    """The signs that some sample loses, the most fragile first, and how many orderings are lost ever."""
    keys = [key for key in spreads[-1].agree if key[2] == "logic" and any(found.agree[key] < 1 for found in spreads)]
    keys.sort(key=lambda key: [found.agree[key] for found in spreads])
    rows = [
        [f"{scenario} {second} {column}", *(f"{100 * found.agree[scenario, column, first, second]:.0f} %"
                                            for found in spreads)]
        for scenario, column, first, second in keys
    ]  # fmt: skip
    signs = table(["sign against logic", *(f"kept at +-{100 * found.size:g} %" for found in spreads)], rows)
    lost = ", ".join(
        f"{sum(share < 1 for share in found.agree.values())} at +-{100 * found.size:g} %" for found in spreads
    )
    return f"{signs}\n\nEvery other sign is kept in every sample. Orderings lost in at least one sample, of 72: {lost}."


def worst_part(own: dict[str, Cells]) -> str:
    """The cells furthest from print at thesis-fit, and what the other fits give there."""
    errors = log_errors(own["thesis-fit"])
    rows = []
    for scenario, controller, column in sorted(errors, key=lambda key: -abs(errors[key]))[:WORST]:
        key = scenario, controller, column
        ours = own["thesis-fit"][key]
        factor = f"{ours / printed()[key]:.2f}"
        rows.append([f"{scenario} {controller} {column}", seconds(printed()[key]), seconds(ours), factor,
                     *(seconds(own[name][key]) for name in FITS[1:])])  # fmt: skip
    close = sum(min(abs(log_errors(cells)[key]) for cells in own.values()) < np.log(1.1) for key in errors)
    lead = f"Of the {len(errors)} cells, {close} are met within a tenth by at least one of the four fits."
    headings = ["cell", "thesis [s]", "thesis-fit [s]", "factor", *(f"{name} [s]" for name in FITS[1:])]
    return f"{lead}\n\n{table(headings, rows)}"


def clamp_part(clamped: Cells) -> str:
    """What the clamp of thesis-fit-b's medium buffer changes."""
    free = figures(unclamped())
    one, other = closeness(clamped), closeness(free)
    changes = {key: clamped[key] / value - 1 for key, value in free.items() if key[2] != "t_avg" and value}
    differing = sorted((key for key, change in changes.items() if change), key=lambda key: -abs(changes[key]))
    same, same_free = agreements(clamped), agreements(free)
    flipped = [
        f"{scenario} {column}, {first} against {second}"
        for scenario, column, first, second in same
        if same[scenario, column, first, second] != same_free[scenario, column, first, second]
    ]
    rows = [[" ".join(key), seconds(free[key]), seconds(clamped[key]), f"{100 * changes[key]:+.1f} %"]
            for key in differing[:6]]  # fmt: skip
    return (
        f"Unclamped: {other.signs} signs, {other.orderings} orderings, log error median {other.log_error_median:.3f}. "
        f"Clamped: {one.signs}, {one.orderings}, {one.log_error_median:.3f}. {len(differing)} of 48 cells move; "
        f"orderings that differ: {'; '.join(flipped) or 'none'}. The cells that move most:\n\n"
        + table(["cell", "unclamped [s]", "clamped [s]", "change"], rows)
    )


def main() -> None:
    """Recompute every part and rewrite the document."""
    fits = {name: (figures(shipped(name)), figures(own_shapes(name))) for name in FITS}
    own = {name: cells for name, (_, cells) in fits.items()}
    spreads = [spread(size) for size in SIZES]
    rewrite(DOCUMENT, {
        "tables": tables_part(fits["thesis-fit"][0]),
        "closeness": closeness_part(fits),
        "sensitivity": sensitivity_part(spreads),
        "fragile": fragile_part(spreads),
        "worst": worst_part(own),
        "clamp": clamp_part(own["thesis-fit-b"]),
    })  # fmt: skip


if __name__ == "__main__":
    main()
