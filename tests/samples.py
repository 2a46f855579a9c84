"""What properties are tried on: few examples with every run of the tests, twice as many with the
slow ones, many with the full ones; presets.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest
from hypothesis import given, settings

from station import load_station, presets
from station.plants.thesis import THESIS

THESIS_PRESETS = [name for name in presets() if load_station(name).plant == THESIS.name]
"""Stations of the thesis's plant: what is proved for its equations is tried on them."""


def first_quick(values: Iterable[Any]) -> list[Any]:
    """Parameters of a test: the first with every run of the tests, the others with the slow ones."""
    first, *others = values
    return [first, *(pytest.param(value, marks=pytest.mark.slow) for value in others)]


def samples(few: int, many: int, **strategies: Any):
    """Makes a test of a property: `few` of its drawn arguments, and `many` when it is full."""

    def made(holds):
        @pytest.mark.parametrize(
            "examples",
            [few, pytest.param(2 * few, marks=pytest.mark.slow), pytest.param(many, marks=pytest.mark.full)],
        )
        def test(examples):
            settings(max_examples=examples, deadline=None)(given(**strategies)(holds))()

        test.__name__, test.__doc__, test.__module__ = holds.__name__, holds.__doc__, holds.__module__
        return test

    return made
