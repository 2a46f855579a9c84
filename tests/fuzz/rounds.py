"""How often what is fuzzed is tried: the same few cases with every run of the tests, many others with the slow ones."""

from __future__ import annotations

import pytest


def rounds(few, many):
    """A test's arguments `cases` and `seed`, as `Property.run` takes them."""
    often = pytest.param(many, 1, id="often", marks=pytest.mark.slow)
    return pytest.mark.parametrize(("cases", "seed"), [pytest.param(few, None, id="few"), often])
