"""Episodes: the day that an environment plays, drawn by its seed or named by options."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from station import InputError, Scenario, load_scenario, parse_scenario

OPTIONS = ("scenario", "replication", "seed")
"""What `reset` takes as options."""

_REPLICATIONS = 2**31
_SEEDS = 2**32


class Episode(NamedTuple):
    """A replication of a scenario, as `station.simulate` takes it."""

    replication: int
    seed: int


def scenario_of(given: str | Mapping[str, Any] | Scenario) -> Scenario:
    """A scenario by its name or file, as a mapping, or as it is.

    Raises
    ------
    InputError
        if there is none of that name, or something in it is wrong.
    """
    if isinstance(given, Scenario):
        return given
    return load_scenario(given) if isinstance(given, str) else parse_scenario(dict(given))


def check_options(options: Mapping[str, Any]) -> None:
    """Raise InputError for an option that is unknown."""
    wrong = [(name, f"is no option; there are {', '.join(OPTIONS)}") for name in options if name not in OPTIONS]
    if wrong:
        raise InputError("reset", wrong)


def drawn(generator: np.random.Generator) -> Episode:
    """A random day: a replication >= 1, whose arrivals and disturbance nobody has seen before."""
    return Episode(int(generator.integers(1, _REPLICATIONS)), int(generator.integers(_SEEDS)))


def named(options: Mapping[str, Any], number: int) -> list[Episode] | None:
    """The day of each of `number` runs that options name; None where they name none, and days are drawn.

    Raises
    ------
    InputError
        if a replication or seed is no whole number >= 0, or there is not one for each run.
    """
    if "replication" not in options and "seed" not in options:
        return None
    replications, seeds = (_spread(name, options.get(name, 0), number) for name in ("replication", "seed"))
    return [Episode(*each) for each in zip(replications, seeds, strict=True)]


def _spread(name: str, given: Any, number: int) -> list[int]:
    """An option's number for each run, or its numbers."""
    values = (
        list(given) if isinstance(given, Sequence | np.ndarray) and not isinstance(given, str) else [given] * number
    )
    if len(values) != number:
        raise InputError(
            "reset", [(name, f"must be one number, or one for each of {number} runs; given {len(values)}")]
        )
    for value in values:
        if isinstance(value, bool) or not isinstance(value, int | np.integer) or not 0 <= value < _SEEDS:
            raise InputError("reset", [(name, f"must be a whole number from 0 to {_SEEDS - 1}; given {value!r}")])
    return [int(value) for value in values]
