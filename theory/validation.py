"""Checks of arguments from outside: arrays of finite numbers, whole numbers within limits."""

from __future__ import annotations

import numpy as np

from theory.arrays import Array
from theory.errors import IllPosedError


def finite_array(name: str, value: object, shape: tuple[int | None, ...]) -> Array:
    """An array of that shape (None: any length); raises `IllPosedError` unless it is one of finite numbers."""
    try:
        array = np.asarray(value, float)
    except (TypeError, ValueError):
        raise IllPosedError(name, "must be an array of numbers") from None
    wanted = tuple("any" if length is None else length for length in shape)
    if array.ndim != len(shape) or any(
        length not in {None, given} for length, given in zip(shape, array.shape, strict=True)
    ):
        raise IllPosedError(name, f"must have the shape {wanted}, given {array.shape}")
    if not np.isfinite(array).all():
        raise IllPosedError(name, "an entry is not finite")
    return array


def check_integer(name: str, value: object, low: int, high: int) -> None:
    """Raise `IllPosedError` unless a value is a whole number within limits."""
    if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
        raise IllPosedError(name, f"must be a whole number between {low} and {high}, given {value}")


def check_noise(noise: float) -> None:
    """Raise `IllPosedError` unless a bound of the disturbance is finite and not negative."""
    if not 0 <= noise < np.inf:
        raise IllPosedError("noise", f"must be finite and at least 0, given {noise}")


def check_weights(Q: object, R: object, states: int, inputs: int) -> None:  # noqa: N803  # the thesis's letters
    """Raise `IllPosedError` unless Q and R are symmetric, of these sizes, not negative and positive definite."""
    found = {"Q": finite_array("Q", Q, (states, states)), "R": finite_array("R", R, (inputs, inputs))}
    for name, weight in found.items():
        if np.abs(weight - weight.T).max() > 1e-9 * np.abs(weight).max():
            raise IllPosedError(name, "must be symmetric")
    if np.linalg.eigvalsh(found["Q"]).min() < -1e-12 or np.linalg.eigvalsh(found["R"]).min() <= 0:
        raise IllPosedError("Q, R", "Q must not have a negative eigenvalue, and R only positive ones")
