"""How often what is fuzzed is tried: the same few cases with every run, others when slow, many when full."""

from __future__ import annotations

import pytest


def rounds(few, many):
    """A test's arguments `cases` and `seed`, as `Property.run` takes them."""
    others = pytest.param(many // 4, 2, id="others", marks=pytest.mark.slow)
    often = pytest.param(many, 1, id="often", marks=pytest.mark.full)
    return pytest.mark.parametrize(("cases", "seed"), [pytest.param(few, None, id="few"), others, often])
