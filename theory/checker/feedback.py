"""Feedback as the checker knows it: of the state, of what is measured, or by a controller with a state of its own."""

from collections.abc import Mapping
from fractions import Fraction
from typing import Any

from .algebra import Matrix
from .constraints import number
from .parameters import Point, read, varied
from .sampling import sampled

Entries = dict[str, Matrix]


def closing(
    problem: Mapping[str, Any], point: Point = (), *, held: bool = True
) -> tuple[list[Entries], dict[tuple[int, int], Matrix]]:
    """Modes, where parameters have given values, and gains of a problem: u = K x, or u = K m where modes have M.

    Measured is m = M x + N w. A controller x_c+ = A x_c + B m, u = C x_c + D m is the gain [D C; B A] from (m, x_c) to
    (u, x_c+) of the plant with x_c beside its state. Modes with a period are of continuous time, and sampled if `held`.
    """
    modes = [varied(mode, point) for mode in problem["modes"]]
    if "period" in problem and held:
        modes = [sampled(mode, number(problem["period"])) for mode in modes]
    given = problem.get("gains", [])
    if not any("A" in entry for entry in given):
        return modes, {(entry["mode"], entry["clock"]): read(entry["K"]) for entry in given}
    made = {(entry["mode"], entry["clock"]): [read(entry[name]) for name in "ABCD"] for entry in given}
    gains = {
        key: [[*x, *y] for one, two in ((d, c), (b, a)) for x, y in zip(one, two, strict=True)]
        for key, (a, b, c, d) in made.items()
    }
    return [beside(mode, len(next(iter(made.values()))[0])) for mode in modes], gains


def beside(mode: Mapping[str, Matrix], states: int) -> Entries:
    """A mode with so many states of a controller beside its own: inputs (u, x_c+), measured (m, x_c)."""
    unit, nothing = ([[Fraction(i == j and on) for j in range(states)] for i in range(states)] for on in (1, 0))
    made = {"A": _diagonal(mode["A"], nothing), "B": _diagonal(mode["B"], unit), "M": _diagonal(mode["M"], unit)}
    wider = {name: [[*row, *nothing[0]] for row in mode[name]] for name in "CD" if name in mode}
    taller = {name: [*mode[name], *([Fraction(0)] * len(mode[name][0]) for _ in unit)] for name in "EN" if name in mode}
    return {**mode, **made, **wider, **taller}


def _diagonal(one: Matrix, two: Matrix) -> Matrix:
    return [[*row, *[Fraction(0)] * len(two[0])] for row in one] + [[*[Fraction(0)] * len(one[0]), *row] for row in two]
