"""Systems whose matrices depend on parameters within bounds and rates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from theory.checker import parameters
from theory.errors import IllPosedError
from theory.switching.system import SwitchedSystem, decimal, exact_matrix, exact_number


@dataclass(frozen=True)
class Parameter:
    """A parameter between `low` and `high` that changes by at most `rate` in a sample; without a rate, at will."""

    low: Fraction
    high: Fraction
    rate: Fraction | None = None

    @classmethod
    def of(cls, low: Any, high: Any, rate: Any = None) -> Parameter:
        """A parameter from numbers, decimal strings or fractions.

        Raises
        ------
        IllPosedError
            `low` is not below `high`, or the rate is negative.
        """
        made = cls(
            exact_number(low, "low"), exact_number(high, "high"), None if rate is None else exact_number(rate, "rate")
        )
        if not made.low < made.high:
            raise IllPosedError("parameters", f"low = {float(made.low):g} has to be below high = {float(made.high):g}")
        if made.rate is not None and made.rate < 0:
            raise IllPosedError("parameters", f"rate = {float(made.rate):g} has to be at least 0")
        return made

    def as_document(self) -> dict[str, str]:
        """As problems hold it."""
        made = {"low": decimal(self.low), "high": decimal(self.high)}
        return made if self.rate is None else {**made, "rate": decimal(self.rate)}


class VaryingSystem:
    """A switched system whose matrices depend on parameters.

    Parameters
    ----------
    modes
        A mapping of matrices a mode, as `SwitchedSystem.of_modes` has them, with `vary`: for each parameter a mapping
        of what it adds to them, by its value.
    varied
        Bounds and rates of the parameters.
    """

    def __init__(self, modes: Sequence[Mapping[str, Any]], varied: Sequence[Parameter]) -> None:
        self.parameters = tuple(varied)
        if not 1 <= len(self.parameters) <= parameters.PARAMETERS_MAX:
            raise IllPosedError(
                "parameters", f"{len(self.parameters)}, within 1..{parameters.PARAMETERS_MAX} are possible"
            )
        self.base = SwitchedSystem.of_modes([{k: v for k, v in mode.items() if k != "vary"} for mode in modes])
        self._vary = [self._changes(number, mode) for number, mode in enumerate(modes)]
        self.ranges = parameters.ranges({"parameters": [one.as_document() for one in self.parameters]})

    def _changes(self, number: int, mode: Mapping[str, Any]) -> list[dict[str, list[list[Fraction]]]]:
        given, own = mode.get("vary", []), self.base.exact[number]
        if len(given) != len(self.parameters):
            raise IllPosedError("vary", f"of mode {number + 1} has {len(given)} tables, one a parameter is needed")
        found = []
        for change in given:
            made = {name: exact_matrix(rows, f"vary.{name} of mode {number + 1}") for name, rows in change.items()}
            for name, rows in made.items():
                if name not in own or name in "MN":
                    raise IllPosedError(f"vary.{name}", "changes no matrix of the mode, or what is measured")
                if (len(rows), len(rows[0])) != (len(own[name]), len(own[name][0])):
                    raise IllPosedError(f"vary.{name}", f"of mode {number + 1} has another size than {name}")
            found.append(made)
        return found

    def at(self, point: Sequence[Fraction]) -> SwitchedSystem:
        """The switched system where parameters have these values."""
        modes = []
        for mode, changes in zip(self.base.exact, self._vary, strict=True):
            made = dict(mode)
            for value, change in zip(point, changes, strict=True):
                for name, rows in change.items():
                    pairs = zip(made[name], rows, strict=True)
                    made[name] = [[x + value * y for x, y in zip(*pair, strict=True)] for pair in pairs]
            modes.append(made)
        return SwitchedSystem.of_modes(modes)

    def as_document(self) -> list[dict[str, Any]]:
        """The modes as certificates hold them."""
        texts = [
            [{name: [[decimal(x) for x in row] for row in rows] for name, rows in change.items()} for change in changes]
            for changes in self._vary
        ]
        return [{**mode, "vary": vary} for mode, vary in zip(self.base.as_document(), texts, strict=True)]
