"""Parameters that vary within bounds and rates: modes at a point, and the corners of what parameters are and become."""

from collections.abc import Mapping, Sequence
from fractions import Fraction
from itertools import pairwise, product
from typing import Any

from .algebra import Matrix
from .constraints import Refused, number

PARAMETERS_MAX = 4
Point = tuple[Fraction, ...]
Range = tuple[Fraction, Fraction, Fraction]  # least, most, and largest change in a sample


def ranges(problem: Mapping[str, Any]) -> list[Range]:
    """Bounds and rate of every parameter; one without a rate may be anything from sample to sample."""
    found = []
    for entry in problem.get("parameters", []):
        low, high = number(entry["low"]), number(entry["high"])
        step = number(entry["rate"]) if "rate" in entry else high - low
        if not low < high or step < 0 or not entry.keys() <= {"low", "high", "rate"}:
            raise Refused("parameters: low below high, and a rate of at least 0 or none, are needed")
        found.append((low, high, min(step, high - low)))
    if len(found) > PARAMETERS_MAX:
        raise Refused(f"parameters: {len(found)}, the limit is {PARAMETERS_MAX}")
    return found


def corners(every: Sequence[Range]) -> list[tuple[Point, Point]]:
    """The corners of all (parameters, parameters a sample later): six for each with a rate, four without, at most."""
    each = [dict.fromkeys([(a, a), (a, a + d), (a + d, a), (b, b), (b, b - d), (b - d, b)]) for a, b, d in every]
    return [(tuple(p for p, _ in pairs), tuple(q for _, q in pairs)) for pairs in product(*each)]


def box(every: Sequence[Range]) -> list[Point]:
    """The corners of all parameters."""
    return list(product(*((low, high) for low, high, _ in every)))


def cycle(every: Sequence[Range], path: Any, length: int) -> list[Point]:
    """Points of parameters, one a letter, that may be repeated for ever; refused where they leave bounds or rates."""
    points = [tuple(map(number, point)) for point in path]
    inside = all(a <= x <= b for point in points for (a, b, _), x in zip(every, point, strict=True))
    slow = all(
        abs(x - y) <= d
        for one, two in pairwise([*points, *points[:1]])
        for (_, _, d), x, y in zip(every, one, two, strict=True)
    )
    if len(points) != length or not inside or not slow:
        raise Refused("path: a point within bounds for every letter, and no step beyond a rate, are needed")
    return points


def varied(mode: Mapping[str, Any], point: Point) -> dict[str, Matrix]:
    """The matrices of a mode at a point: each plus its changes by the parameters; M and N do not change."""
    made = {name: read(rows) for name, rows in mode.items() if name != "vary"}
    for value, change in zip(point, mode.get("vary", []), strict=True):
        for name, rows in change.items():
            if name in {"M", "N"}:
                raise Refused(f"vary: {name} is the same for all parameters")
            pairs = zip(made[name], read(rows), strict=True)
            made[name] = [[x + value * y for x, y in zip(*pair, strict=True)] for pair in pairs]
    return made


def read(rows: Any) -> Matrix:
    """A matrix of numbers."""
    return [[*map(number, row)] for row in rows]
