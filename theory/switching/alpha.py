"""The contraction of Lemma 4.1, a number alpha a mode: a grid, then Brent's method, then Nelder-Mead.

Next to 1, where slow loops have it, the search is one in log(1 - alpha).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Literal

import numpy as np
from scipy import optimize

from theory.arrays import Array
from theory.errors import IllPosedError

GRID = tuple(k / 10 for k in range(1, 10))
"""Values of alpha tried first, and the only ones where the theorem is applied as printed (section 4.6)."""

LADDER = tuple(-k / 4 for k in range(4, 33))
"""Logarithms of 1 - alpha to base 10 that are tried where the grid's last value is its best, or none does."""

LARGE = 1e12

Alpha = Literal["mode", "common", "grid"]
"""One number a mode, one for all, or one for all from the grid."""


def rounded_alpha(values: Array, digits: int) -> list[Fraction]:
    """Alpha with that many significant digits of 1 - alpha, or of alpha where it is the smaller.

    Parameters
    ----------
    values
        A number a mode, in (0, 1).
    digits
        Digits kept.
    """
    places = [digits - 1 - math.floor(math.log10(min(1 - value, value))) for value in map(float, values)]
    return [
        Fraction(round(value * 10**place), 10**place) for value, place in zip(map(float, values), places, strict=True)
    ]


def search_alpha(
    square: Callable[[Array], float],
    modes: int,
    alpha: Alpha | Sequence[float],
    progress: Callable[[str], None] | None,
    unit: float = 1.0,
) -> tuple[float, Array]:
    """The alpha of the smallest ball: the grid, then Brent's method for one number, then Nelder-Mead for one a mode.

    For one mode's number the ball is smooth but not convex in alpha, hence the grid and the restarts.

    Parameters
    ----------
    square
        Radius^2 at given alpha, infinite where there is no ball.
    modes
        N.
    alpha
        The way to search, or one given number a mode.
    progress
        Receives every trial in words.
    unit
        Unit of the radius, for these words.
    """
    if not isinstance(alpha, str):
        if not isinstance(alpha, list | tuple | np.ndarray) or not all(isinstance(item, int | float) for item in alpha):
            raise IllPosedError("alpha", f"{alpha!r:.60} is neither a way to search nor a list of numbers")
        values = np.array([float(item) for item in alpha])
        if len(values) != modes or not all(0 < item < 1 for item in values):
            raise IllPosedError("alpha", f"needs {modes} numbers between 0 and 1, one a mode")
        return square(values), values
    if alpha not in {"mode", "common", "grid"}:
        raise IllPosedError("alpha", f"{alpha!r} is none of 'mode', 'common', 'grid'")
    return _searched(square, modes, alpha, progress, unit)


def _searched(
    square: Callable[[Array], float], modes: int, alpha: str, progress: Callable[[str], None] | None, unit: float
) -> tuple[float, Array]:
    def evaluated(values: Array) -> float:
        found = square(values)
        if progress and math.isfinite(found):
            progress(f"alpha {np.round(values, 3).tolist()}: radius {unit * math.sqrt(found):.5g}")
        return found

    best, place = min((evaluated(np.full(modes, value)), value) for value in GRID)
    if not math.isfinite(best) or place == GRID[-1]:
        best, place = _climbed(lambda value: evaluated(np.full(modes, value)), best, place)
    chosen = np.full(modes, place)
    if alpha == "grid" or not math.isfinite(best):
        return best, chosen
    if place > GRID[-1]:  # in log(1 - alpha)
        middle, step = math.log(1 - place), math.log(10) / 4
        found = optimize.minimize_scalar(
            lambda value: min(evaluated(np.full(modes, 1 - math.exp(value))), LARGE),
            bounds=(middle - step, middle + step), method="bounded", options={"xatol": 1e-3},
        )  # fmt: skip
        found.x = 1 - math.exp(found.x)
    else:
        found = optimize.minimize_scalar(
            lambda value: min(evaluated(np.full(modes, value)), LARGE),
            bounds=(max(place - 0.1, 1e-3), min(place + 0.1, 1 - 1e-3)), method="bounded", options={"xatol": 1e-4},
        )  # fmt: skip
    if found.fun < best:
        best, chosen = float(found.fun), np.full(modes, float(found.x))
    if alpha == "common" or modes == 1:
        return best, chosen
    for spread in (0.8, 0.4):  # in the logit, where every number is allowed; a restart frees a simplex that collapsed
        start = np.log(chosen / (1 - chosen))
        result = optimize.minimize(
            lambda point: min(evaluated(_logistic(point)), LARGE), start, method="Nelder-Mead",
            options={"initial_simplex": np.vstack([start, start + spread * np.eye(modes)]), "maxfev": 60 * modes,
                     "xatol": 1e-3, "fatol": 1e-7 * best},
        )  # fmt: skip
        if result.fun < best:
            best, chosen = float(result.fun), _logistic(result.x)
    return best, chosen


def _climbed(evaluated: Callable[[float], float], best: float, place: float) -> tuple[float, float]:
    """The best value of alpha on the ladder towards 1; up to where the balls grow again."""
    for logarithm in LADDER:
        value = 1 - 10.0**logarithm
        found = evaluated(value)
        if found < best:
            best, place = found, value
        elif math.isfinite(best):
            break
    return best, place


def _logistic(point: Array) -> Array:
    return np.clip(1 / (1 + np.exp(-point)), 1e-4, 1 - 1e-9)
