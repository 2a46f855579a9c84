"""Margins that keep every limit under parameter and sensor error, proved in rational arithmetic.

A limit is a margin function of `station.limits`. Each is affine in what is read (a pressure, a difference of
pressures, a temperature) and, at a given reading, affine in every parameter and sensor error alone, so that over a
box of errors its least value lies at a corner, and over all admitted readings at the edge of what is admitted. That
is a finite check, made with fractions on the very functions the shield runs.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from math import ceil, isfinite
from typing import Any, NamedTuple

from station.geometry import BUFFERS
from station.limits import Situation, StateLimit, check_covered, state_limits
from station.parameters import Station
from station.plants.thesis import PlantConstants, refuse_others
from station.uncertainty import READ, RELATIVE, Uncertainty, deviated

DIGITS = 9
"""Decimals a margin is rounded up to. One unit is added for the rounding of double arithmetic, below 1e-11 here."""

FORMAT = "hrs-margins"

PERIOD = Fraction(1)
"""Sampling period [s]: Eqs (7.13) and (7.15) look one ahead."""

Corner = dict[str, int]


@dataclass(frozen=True)
class Bound:
    """The proof of one limit: at readings whose margin is at least `margin`, the true margin is not negative."""

    limit: str  # name of its margin
    equation: str
    unit: str
    margin: Fraction  # demanded of the readings
    needed: Fraction  # the least that would do
    edge: Fraction  # the reading furthest out that is admitted
    corner: Corner  # signs of the errors that are worst there
    corners: int  # corners of the box of errors

    def as_document(self) -> dict[str, Any]:
        """The figures as JSON holds them; fractions as texts p/q."""
        return {
            "limit": self.limit, "equation": self.equation, "unit": self.unit, "margin": str(self.margin),
            "needed": str(self.needed), "edge": str(self.edge), "corner": self.corner, "corners": self.corners,
        }  # fmt: skip


@dataclass(frozen=True)
class Proof:
    """Margins of one station for one uncertainty, with what proves them."""

    station: Station
    uncertainty: Uncertainty
    bounds: tuple[Bound, ...]

    @property
    def margins(self) -> dict[str, float]:
        """Values that each margin function must reach at the readings before a valve may open, by the limits' names.

        In the units of `StateLimit.unit`; of a limit on several buffers the largest of theirs.
        """
        return {
            limit.name: max(float(bound.margin) for bound in self.bounds if bound.limit == limit.name)
            for limit in covered_limits(self.station.constants())
        }

    def check(self) -> int:
        """Prove every bound anew; the number of corners looked at.

        Raises
        ------
        ValueError
            naming the limit that some error within the box would break.
        """
        refuse_others(self.station.plant, "margins")
        constants = self.station.constants()
        plant = _exact(constants)
        for bound, item in zip(self.bounds, _limits(constants), strict=True):
            nominal = _Line.of(item, plant, self.uncertainty, {})
            edge = nominal.where(bound.margin)
            for corner in _corners(item.errors):
                line = _Line.of(item, plant, self.uncertainty, corner)
                if line.rises != nominal.rises or line.at(edge) < 0:
                    raise ValueError(
                        f"{bound.limit}: a margin of {float(bound.margin):.9g} {bound.unit} is broken by {corner}: "
                        f"{float(line.at(edge)):.3g} {bound.unit} are left at a reading of {float(edge):.6g}"
                    )
        return sum(bound.corners for bound in self.bounds)

    def as_document(self) -> dict[str, Any]:
        """Station, uncertainty and bounds as JSON holds them."""
        return {
            "format": FORMAT, "version": 1, "station": self.station.model_dump(mode="json"),
            "uncertainty": self.uncertainty.model_dump(),
            "bounds": [bound.as_document() for bound in self.bounds],
        }  # fmt: skip

    @classmethod
    def of_document(cls, document: Mapping[str, Any]) -> Proof:
        """The proof of a document, proved anew from its station, uncertainty and margins; the rest is for people.

        Raises
        ------
        ValueError
            if it is no such document, or a margin in it does not hold.
        """
        try:
            if document["format"] != FORMAT:
                raise ValueError(f"not a document of format {FORMAT!r}")
            station = Station.model_validate(document["station"])
            refuse_others(station.plant, "margins")
            limits = _limits(station.constants())
            if len(document["bounds"]) != len(limits):
                raise ValueError(f"not a document of format {FORMAT!r} with every limit")
            bounds = tuple(
                Bound(**{**item, **{name: Fraction(item[name]) for name in ("margin", "needed", "edge")}})
                for item in document["bounds"]
            )
            proof = cls(station, Uncertainty.model_validate(document["uncertainty"]), bounds)
        except (KeyError, TypeError) as error:
            raise ValueError(f"malformed document: {error!r}") from error
        if [bound.limit for bound in bounds] != [item.limit for item in limits]:
            raise ValueError("the limits are not those of the station")
        proof.check()
        return proof


def covered_limits(plant: PlantConstants) -> list[StateLimit]:
    """Every limit on the state that can bind at a station, by its code, each with its errors and its figure.

    Parameters
    ----------
    plant
        The station's constants.

    Returns
    -------
    list[StateLimit]
        The limits.

    Raises
    ------
    UncoveredLimitError
        naming such a limit that says no errors or no figure.
    """
    found = sorted(state_limits(plant=plant), key=lambda limit: limit.limit)
    check_covered("margins", (limit.name for limit in found if limit.errors and limit.figure), plant)
    return found


class _Item(NamedTuple):
    """A limit of one buffer's valve, and the errors it depends on."""

    of: StateLimit
    buffer: int
    equation: str
    errors: tuple[str, ...]

    @property
    def limit(self) -> str:
        """Name of the limit's margin."""
        return self.of.name

    @property
    def unit(self) -> str:
        """Unit of its margin."""
        return self.of.unit

    def margin(self, reading: Fraction, plant: PlantConstants, error: Callable[[str], Fraction]) -> Any:
        """The margin by the true plant of what is read with an error: a gap, a pressure, or a temperature."""
        pressure, temperature = reading + error("pressure"), reading + error("temperature")
        at = Situation(self.buffer, pressure, temperature, error("vehicle pressure"), temperature)
        return self.of.margin(at, plant, PERIOD)


def _limits(plant: PlantConstants) -> list[_Item]:
    """Every limit that can bind at a station as a function of one reading, for each buffer where they differ."""
    found = []
    for limit in covered_limits(plant):
        each = any("{buffer}" in error for error in limit.errors)
        for buffer in range(3 if each else 1):
            named = tuple(error.format(buffer=buffer) for error in limit.errors)
            found.append(
                _Item(limit, buffer, f"{limit.equation}, {BUFFERS[buffer]}" if each else limit.equation, named)
            )
    return found


class _Line(NamedTuple):
    """A margin at one corner as a function of the reading: start + slope * reading."""

    start: Fraction
    slope: Fraction

    @classmethod
    def of(cls, item: _Item, plant: PlantConstants, uncertainty: Uncertainty, corner: Corner) -> _Line:
        """The line of a limit; `ValueError` where the margin is not affine, or not strictly monotone."""
        shares: dict[str, Any] = {}
        for name, sign in corner.items():
            parameter, _, buffer = name.partition(" ")
            if buffer.isdigit():
                shares[parameter] = [sign if place == int(buffer) else 0 for place in range(3)]
            elif name in RELATIVE or name in READ:
                shares[name] = sign
        true = deviated(plant, uncertainty, shares)
        widths = {"pressure": uncertainty.pressure_bar, "temperature": uncertainty.temperature_k}

        def error(name: str) -> Fraction:
            return Fraction(widths[name.rpartition(" ")[2]]) * corner.get(name, 0)

        zero, one, two = (item.margin(Fraction(x), true, error) for x in (0, 1, 2))
        if one - zero != two - one or one == zero:
            raise ValueError(f"{item.limit}: its margin is no line in the reading")
        return cls(zero, one - zero)

    @property
    def rises(self) -> bool:
        """Whether larger readings are safer."""
        return self.slope > 0

    def at(self, reading: Fraction) -> Fraction:
        """The margin at a reading."""
        return self.start + self.slope * reading

    def where(self, margin: Fraction) -> Fraction:
        """The reading with this margin."""
        return (margin - self.start) / self.slope


def _corners(errors: Iterable[str]) -> Iterable[Corner]:
    names = tuple(errors)
    for signs in itertools.product((-1, 1), repeat=len(names)):
        yield dict(zip(names, signs, strict=True))


def _exact(plant: PlantConstants) -> PlantConstants:
    """The doubles of a plant as the fractions they are; infinite ones, of limits that do not bind, stay."""

    def exact(value: Any) -> Any:
        if isinstance(value, tuple):
            return value._make(map(exact, value)) if hasattr(value, "_make") else tuple(map(exact, value))
        return Fraction(value) if isfinite(value) else value

    found: PlantConstants = exact(plant)
    return found


@cache
def _bounds(plant: PlantConstants, uncertainty: Uncertainty) -> tuple[Bound, ...]:
    limits, plant = _limits(plant), _exact(plant)
    found = []
    for item in limits:
        nominal = _Line.of(item, plant, uncertainty, {})
        lines = [(corner, _Line.of(item, plant, uncertainty, corner)) for corner in _corners(item.errors)]
        if any(line.rises != nominal.rises for _, line in lines):
            raise ValueError(f"{item.limit}: an error within the box turns the limit around")
        pick = max if nominal.rises else min
        edge, place = pick((line.where(Fraction(0)), place) for place, (_, line) in enumerate(lines))
        needed = nominal.at(edge)
        margin = Fraction(ceil(needed * 10**DIGITS) + 1, 10**DIGITS)
        found.append(
            Bound(
                item.limit, item.equation, item.unit, margin, needed, nominal.where(margin), lines[place][0], len(lines)
            )
        )
    return tuple(found)


def certify(station: Station, uncertainty: Uncertainty) -> Proof:
    """The least margins, rounded up, that keep every limit of `station` for every error within `uncertainty`.

    Raises
    ------
    ValueError
        naming the limit that no margin keeps.
    PlantError
        for a station with another plant than the thesis's.
    """
    refuse_others(station.plant, "margins")
    return Proof(station, uncertainty, _bounds(station.constants(), uncertainty))
