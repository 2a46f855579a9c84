"""Switched linear systems: matrices per mode, as exact decimals and as floats."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np

from theory.arrays import Array
from theory.checker import Label, beside, multiply
from theory.errors import IllPosedError

NAMES = ("A", "B", "C", "D", "E", "F", "M", "N")
"""x+ = A x + B u + E w, y = C x + D u + F w: (3.14); (4.1) calls E by the name D and has no outputs. Feedback may have
m = M x + N w alone."""

ENTRY_MAX = 10.0**9
"""No entry may be larger; beyond, floating-point solvers give up."""

STATES_MAX = 60

TEXT_MAX = 60
"""Longest text of a number; the checker reads as many digits."""

EXPONENT_MAX = 30

_EXPONENT = re.compile(r"[eE]([+-]?[0-9]{1,9})")


class SwitchedSystem:
    """Modes 1..N of x+ = A x + B u + E w, y = C x + D u + F w (Eq. (3.14)), measured m = M x + N w.

    Parameters
    ----------
    A
        One n x n matrix a mode, nested lists or arrays of floats, integers, decimal strings or fractions. A float is
        taken as the decimal it prints as: 0.39 is exactly 39/100.
    B, C, D, E, F
        Likewise; n x m, p x n, p x m, n x q, p x q. Left out, an input, output or disturbance does not
        exist; D and F left out beside C are zero.
    M, N
        Likewise; s x n, s x q. With M feedback acts on m, without on x; N left out beside M is zero.

    Raises
    ------
    IllPosedError
        Matrices that do not fit, entries that are not finite, or modes without a matrix.
    """

    period: Fraction | None = None
    """Time between the samples of a plant in continuous time; None for one in samples alone."""

    def __init__(
        self, A: Any, B: Any = None, C: Any = None, D: Any = None, E: Any = None, F: Any = None,  # noqa: N803
        M: Any = None, N: Any = None,  # noqa: N803
    ) -> None:  # fmt: skip
        given = dict(zip(NAMES, (A, B, C, D, E, F, M, N), strict=True))
        if not isinstance(A, list | tuple | np.ndarray) or len(A) == 0:
            raise IllPosedError("A", "needs a matrix for every mode, given none")
        self.exact: list[dict[str, list[list[Fraction]]]] = [{} for _ in A]
        for name, matrices in given.items():
            if matrices is None:
                continue
            if not isinstance(matrices, list | tuple | np.ndarray):
                raise IllPosedError(name, "has to be a list with a matrix for every mode")
            if len(matrices) != len(A):
                raise IllPosedError(name, f"a mode without a matrix: {len(matrices)} matrices for {len(A)} modes")
            for number, rows in enumerate(matrices, 1):
                self.exact[number - 1][name] = exact_matrix(rows, f"{name} of mode {number}")
        self._complete()
        self._check()

    @classmethod
    def of_modes(cls, modes: Sequence[Mapping[str, Any]]) -> SwitchedSystem:
        """A system from one mapping of matrices a mode, as files have it; every mode has the same names."""
        if not modes:
            raise IllPosedError("modes", "at least one mode is needed")
        for number, mode in enumerate(modes, 1):
            if not isinstance(mode, Mapping):
                raise IllPosedError(f"modes.{number}", "has to be a table of matrices")
            unknown = set(mode) - set(NAMES)
            if unknown:
                raise IllPosedError(f"modes.{number}", f"unknown matrix {min(unknown)!r}; known are {', '.join(NAMES)}")
            missing = set().union(*modes) - set(mode)
            if missing or "A" not in mode:
                raise IllPosedError(
                    f"modes.{number}", f"a mode without a matrix: {', '.join(sorted(missing | {'A'} - set(mode)))}"
                )
        return cls(**{name: [mode[name] for mode in modes] for name in NAMES if name in modes[0]})

    def _complete(self) -> None:
        for mode in self.exact:
            for name, tall, wide in (("D", "C", "B"), ("F", "C", "E"), ("N", "M", "E")):
                if tall in mode and wide in mode and name not in mode:
                    mode[name] = [[Fraction(0)] * len(mode[wide][0]) for _ in mode[tall]]

    def _check(self) -> None:
        sizes = [{name: (len(rows), len(rows[0])) for name, rows in mode.items()} for mode in self.exact]
        n = sizes[0]["A"][0]
        if n > STATES_MAX:
            raise IllPosedError("A of mode 1", f"{n} states, the limit is {STATES_MAX}")
        inputs, outputs, noises, measured = (sizes[0].get(name, (0, 0)) for name in ("B", "C", "E", "M"))
        fits = {"A": (n, n), "B": (n, inputs[1]), "C": (outputs[0], n), "D": (outputs[0], inputs[1]),
                "E": (n, noises[1]), "F": (outputs[0], noises[1]), "M": (measured[0], n),
                "N": (measured[0], noises[1])}  # fmt: skip
        for number, mode in enumerate(sizes, 1):
            for name, size in mode.items():
                if size != fits[name]:
                    raise IllPosedError(
                        f"{name} of mode {number}",
                        f"is {size[0]} x {size[1]}, has to be {fits[name][0]} x {fits[name][1]}",
                    )

    @property
    def modes(self) -> int:
        """Number of modes."""
        return len(self.exact)

    @cached_property
    def size(self) -> int:
        """Number of states."""
        return len(self.exact[0]["A"])

    def has(self, *names: str) -> bool:
        """Whether the system has these matrices."""
        return all(name in self.exact[0] for name in names)

    def need(self, names: str, purpose: str) -> None:
        """Raise `IllPosedError` unless the system has all these matrices."""
        for name in names:
            if not self.has(name):
                raise IllPosedError(name, f"{purpose} needs this matrix for every mode")

    @cached_property
    def floats(self) -> list[dict[str, Array]]:
        """The matrices of each mode as floats."""
        return [
            {name: np.array([[float(item) for item in row] for row in rows]) for name, rows in mode.items()}
            for mode in self.exact
        ]

    def loop(self, label: Label, gains: Gains | None, names: str = "AB") -> Array:
        """A + B K of a label, or C + D K for `names` = "CD"; A or C alone where labels are modes. K M for K with M."""
        mode = self.floats[mode_of(label) - 1]
        if isinstance(label, int):
            return mode[names[0]]
        driven = mode[names[1]] @ _given(gains)[label[1], label[2]]
        return mode[names[0]] + (driven @ mode["M"] if "M" in mode else driven)

    def exact_loop(self, label: Label, gains: Gains | None, names: str = "AB") -> list[list[Fraction]]:
        """As `loop`, in fractions."""
        mode = self.exact[mode_of(label) - 1]
        if isinstance(label, int):
            return mode[names[0]]
        driven = multiply(mode[names[1]], _given(gains).exact[label[1], label[2]])
        return _plus(mode[names[0]], multiply(driven, mode["M"]) if "M" in mode else driven)

    def exact_drive(self, label: Label, gains: Gains | None, names: str = "EB") -> list[list[Fraction]]:
        """E + B K N of a label, or F + D K N for `names` = "FD"; E or F alone where feedback measures nothing."""
        mode = self.exact[mode_of(label) - 1]
        if isinstance(label, int) or "M" not in mode:
            return mode[names[0]]
        driven = multiply(mode[names[1]], _given(gains).exact[label[1], label[2]])
        return _plus(mode[names[0]], multiply(driven, mode["N"]))

    def as_document(self) -> list[dict[str, list[list[str]]]]:
        """The modes as certificates hold them: numbers as decimal strings or fractions."""
        return [
            {name: [[decimal(item) for item in row] for row in rows] for name, rows in mode.items()}
            for mode in self.exact
        ]


class ControlledSystem(SwitchedSystem):
    """A plant with the states of a controller beside its own: inputs (u, x_c+), measured (m, x_c).

    Parameters
    ----------
    plant
        With B and M.
    states
        Of the controller.
    """

    def __init__(self, plant: SwitchedSystem, states: int) -> None:
        plant.need("BM", "a controller")
        made = [beside(mode, states) for mode in plant.exact]
        super().__init__(**{name: [mode[name] for mode in made] for name in made[0]})
        self.plant, self.period = plant, plant.period

    def as_document(self) -> list[dict[str, list[list[str]]]]:
        """The plant's modes; the checker puts the controller's states beside them by itself."""
        return self.plant.as_document()


@dataclass(frozen=True)
class Gains:
    """Feedback gains u = K x, or u = K m where the system has M, by (mode, clock), each m x n, exact decimals.

    With `states`, those of a controller x_c+ = A x_c + B m, u = C x_c + D m: K = [D C; B A].
    """

    exact: Mapping[tuple[int, int], list[list[Fraction]]]
    states: int = 0

    def __getitem__(self, key: tuple[int, int]) -> Array:
        return self._floats[key]

    @cached_property
    def _floats(self) -> dict[tuple[int, int], Array]:
        return {key: np.array([[float(item) for item in row] for row in rows]) for key, rows in self.exact.items()}

    @classmethod
    def rounded(cls, gains: Mapping[tuple[int, int], Array], digits: int = 9, states: int = 0) -> Gains:
        """Gains with that many decimals; the rounded gains are certified.

        Parameters
        ----------
        gains
            K, n_u x n, of each (mode, clock).
        digits
            Decimals that are kept.
        states
            Of a controller.

        Returns
        -------
        Gains
            Rationals.
        """
        return cls(
            {
                key: [[Fraction(round(float(item) * 10**digits), 10**digits) for item in row] for row in rows]
                for key, rows in gains.items()
            },
            states,
        )

    def as_document(self) -> list[dict[str, Any]]:
        """The gains as certificates hold them: K, or A, B, C and D of a controller."""
        found = []
        for (mode, clock), rows in sorted(self.exact.items()):
            inputs, outputs = len(rows) - self.states, len(rows[0]) - self.states
            parts = {"K": rows} if not self.states else {
                "A": [row[outputs:] for row in rows[inputs:]], "B": [row[:outputs] for row in rows[inputs:]],
                "C": [row[outputs:] for row in rows[:inputs]], "D": [row[:outputs] for row in rows[:inputs]],
            }  # fmt: skip
            texts = {name: [[decimal(item) for item in row] for row in part] for name, part in parts.items()}
            found.append({"mode": mode, "clock": clock, **texts})
        return found

    @classmethod
    def of_document(cls, gains: Sequence[Mapping[str, Any]]) -> Gains:
        """Gains from a list of {mode, clock, K}, or of {mode, clock, A, B, C, D} with D zero if left out."""
        states = {len(gain["A"]) if "A" in gain else 0 for gain in gains}
        if len(states) > 1:
            raise IllPosedError("gains", "have to be all K, or all controllers with as many states as each other")
        return cls({(int(gain["mode"]), int(gain["clock"])): _stacked(gain) for gain in gains}, max(states, default=0))


def _stacked(gain: Mapping[str, Any]) -> list[list[Fraction]]:
    """K, or [D C; B A] of a controller."""
    where = f"of mode {gain['mode']}, clock {gain['clock']}"
    if "A" not in gain:
        return exact_matrix(gain["K"], f"K {where}")
    a, b, c = (exact_matrix(gain[name], f"{name} {where}") for name in "ABC")
    d = exact_matrix(gain["D"], f"D {where}") if "D" in gain else [[Fraction(0)] * len(b[0]) for _ in c]
    sizes = {"A": (len(a), len(a)), "B": (len(a), len(b[0])), "C": (len(c), len(a)), "D": (len(c), len(b[0]))}
    for (name, size), rows in zip(sizes.items(), (a, b, c, d), strict=True):
        if (len(rows), len(rows[0])) != size:
            raise IllPosedError(f"{name} {where}", f"is {len(rows)} x {len(rows[0])}, has to be {size[0]} x {size[1]}")
    return [[*x, *y] for one, two in ((d, c), (b, a)) for x, y in zip(one, two, strict=True)]


def closed_by(system: SwitchedSystem, gains: Gains | None) -> SwitchedSystem:
    """The system on which gains act: with the controller's states beside its own where they have some."""
    if gains is None or not gains.states or isinstance(system, ControlledSystem):
        return system
    return ControlledSystem(system, gains.states)


def _given(gains: Gains | None) -> Gains:
    if gains is None:
        raise IllPosedError("gains", "the constraint tells which gain acts; gains are needed")
    return gains


def _plus(one: list[list[Fraction]], two: list[list[Fraction]]) -> list[list[Fraction]]:
    return [[a + b for a, b in zip(*pair, strict=True)] for pair in zip(one, two, strict=True)]


def mode_of(label: Label) -> int:
    """The mode of a letter."""
    return label if isinstance(label, int) else label[0]


def exact_matrix(rows: Any, field: str) -> list[list[Fraction]]:
    """Rows of fractions from floats, integers, decimal strings or fractions; typed errors for anything else."""
    if isinstance(rows, np.ndarray):
        rows = rows.tolist()
    if not isinstance(rows, list | tuple) or not rows or not all(isinstance(row, list | tuple) and row for row in rows):
        raise IllPosedError(field, "has to be a list of rows, each a list of numbers")
    if len({len(row) for row in rows}) != 1:
        raise IllPosedError(field, "has rows of different lengths")
    return [
        [exact_number(item, f"{field}, row {i}, column {j}") for j, item in enumerate(row, 1)]
        for i, row in enumerate(rows, 1)
    ]


def exact_number(item: Any, field: str) -> Fraction:
    """A number as a fraction; a float as the decimal it prints as."""
    text = repr(float(item)) if isinstance(item, float | np.floating) else str(item).strip()
    exponent = _EXPONENT.search(text)
    if isinstance(item, bool) or len(text) > TEXT_MAX or (exponent and abs(int(exponent[1])) > EXPONENT_MAX):
        limits = f"{TEXT_MAX} characters and exponents up to {EXPONENT_MAX}"
        raise IllPosedError(field, f"{text!r:.40} is not a number within {limits}")
    try:
        value = Fraction(text)
    except (ValueError, TypeError, ZeroDivisionError, OverflowError) as error:
        raise IllPosedError(field, f"{item!r:.40} is not a finite number") from error
    if abs(value) > ENTRY_MAX:
        raise IllPosedError(field, f"{float(value):g} is beyond the limit of {ENTRY_MAX:g}")
    return value


def decimal(value: Fraction) -> str:
    """A fraction as a decimal if it is one, else as p/q."""
    digits = 0
    rest = value.denominator
    while rest % 10 == 0:
        rest //= 10
        digits += 1
    twos = fives = 0
    while rest % 2 == 0:
        rest //= 2
        twos += 1
    while rest % 5 == 0:
        rest //= 5
        fives += 1
    if rest != 1:
        return f"{value.numerator}/{value.denominator}"
    digits += max(twos, fives)
    whole = abs(value.numerator) * 10**digits // value.denominator
    text = str(whole).rjust(digits + 1, "0")
    text = f"{text[:-digits]}.{text[-digits:]}" if digits else text
    return ("-" if value < 0 else "") + text


def rounded_up(value: float, digits: int = 7) -> Fraction:
    """The next decimal of that many significant digits above a positive value; one more after a leading 1 to 4."""
    scale = _scale(value, digits)
    return Fraction(math.ceil(Fraction(value) * scale)) / scale


def rounded_down(value: float, digits: int = 7) -> Fraction:
    """The next decimal below, as `rounded_up`."""
    scale = _scale(value, digits)
    return Fraction(math.floor(Fraction(value) * scale)) / scale


def _scale(value: float, digits: int) -> Fraction:
    if not (math.isfinite(value) and value > 0):
        raise IllPosedError("value", f"{value!r} is not positive and finite")
    place = math.floor(math.log10(value))
    return Fraction(10) ** (digits - 1 - place + (value < 5 * 10.0**place))
