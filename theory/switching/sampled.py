"""Continuous-time plants whose feedback and disturbances are held between samples.

x' = A x + B u + E w becomes x+ = e^(A h) x + ... with matrices that no fraction equals. A search goes on with fractions
next to them; what is certified is proved of everything that enclosures of the exponentials contain.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Any

from theory.checker import Refused
from theory.checker.enclosures import Enclosure
from theory.checker.sampling import sampled
from theory.errors import IllPosedError
from theory.switching.system import SwitchedSystem, exact_number

DIGITS = 22
"""Decimals of the fractions of a search."""


class SampledSystem(SwitchedSystem):
    """The samples of a continuous-time plant.

    Parameters
    ----------
    plant
        A, B and E of x' = A x + B u + E w; C, D, F, M and N are of the samples.
    period
        Time between samples.

    Raises
    ------
    IllPosedError
        The period is not positive, or too long for the plant.
    """

    def __init__(self, plant: SwitchedSystem, period: Any) -> None:
        value = exact_number(period, "period")
        if value <= 0:
            raise IllPosedError("period", f"{float(value):g} is not positive")
        try:
            made = [sampled(mode, value) for mode in plant.exact]
        except Refused as error:
            raise IllPosedError("period", str(error)) from error
        super().__init__(
            **{name: [[[_near(x) for x in row] for row in mode[name]] for mode in made] for name in made[0]}
        )
        self.plant, self.period = plant, value

    def as_document(self) -> list[dict[str, list[list[str]]]]:
        """The plant's modes in continuous time; the checker samples them by itself."""
        return self.plant.as_document()


def _near(item: Any) -> Fraction:
    """The middle of an enclosure, rounded; a fraction itself."""
    return Fraction(round(item.middle * 10**DIGITS), 10**DIGITS) if isinstance(item, Enclosure) else item
