"""Errors of the station: each names the field, the value and the limit, and reaches the user as such."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from pydantic import ValidationError


class StationError(ValueError):
    """Base of every error the station raises on what it was given."""


class InputError(StationError):
    """A scenario, station or trace that cannot be run; `problems` lists (field, what is wrong)."""

    def __init__(self, source: str, problems: Iterable[tuple[str, str]]) -> None:
        self.source = source
        self.problems = list(problems)
        lines = "".join(f"\n  {field}: {message}" if field else f"\n  {message}" for field, message in self.problems)
        super().__init__(f"{source}:{lines}")

    def __reduce__(self) -> tuple[type[InputError], tuple[str, list[tuple[str, str]]]]:
        """The arguments that make it again in another process."""
        return type(self), (self.source, self.problems)

    @classmethod
    def of(cls, source: str, error: ValidationError) -> InputError:
        """The problems pydantic found, with field path, limit and value given."""
        return cls(source, [(_path(item["loc"]), _message(item)) for item in error.errors()])


class PlantError(InputError):
    """A claim that holds for one plant alone was asked of a station with another."""

    @classmethod
    def of_claim(cls, claim: str, plant: str, proved: str) -> PlantError:
        """The error of a claim (bounds, margins, ...) that is proved for the plant `proved`, at one of `plant`."""
        return cls(claim, [("station.plant", f"must be {proved!r}, for which alone they are proved; given {plant!r}")])


class UncoveredLimitError(StationError):
    """A limit is registered, and something that has to keep it does not know it."""

    def __init__(self, by: str, limit: str) -> None:
        self.by, self.limit = by, limit
        super().__init__(f"{by}: the limit {limit!r} is not covered")


class ControllerError(StationError):
    """A controller failed, or answered what is no decision."""


def _path(location: tuple[int | str, ...]) -> str:
    return ".".join(str(part) for part in location)


def _message(item: Any) -> str:
    text = str(item["msg"]).removeprefix("Value error, ")
    given = item["input"]
    if item["type"] in ("missing", "value_error") or isinstance(given, dict | list):
        return text
    try:
        return f"{text}; given {given!r:.200}"
    except ValueError:  # a number of thousands of digits, which Python does not write
        return text
