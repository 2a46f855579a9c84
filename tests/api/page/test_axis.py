"""Axes of the page: any range whatever gives few ticks at once, and any figures whatever a chart."""

from __future__ import annotations

import json
import math

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from playwright.sync_api import expect

EDGES = [0.0, -0.0, 5e-324, 2e-13, 1e-9, 1.0, 177.0, 86_400.0, 2.0**53, 1e17, 1e300, 1.7976931348623157e308, math.inf]
FLOATS = st.one_of(st.floats(), st.sampled_from([*EDGES, *(-edge for edge in EDGES), math.nan]))
"""Whatever a double can be."""

NEAR = st.builds(
    lambda middle, apart: (middle, middle + apart),
    st.floats(-1e6, 1e6),
    st.sampled_from([2e-13, -2e-13, 1e-15, 5e-11, 1e-7, 0.0]),
)
"""Two figures that differ by rounding alone, as the means of equal replications do."""

CASES = st.lists(st.tuples(st.one_of(st.tuples(FLOATS, FLOATS), NEAR), st.integers(1, 12)), min_size=50, max_size=50)

ANSWERS = """cases => import('/static/lib/axis.js').then(({ clockTicks, digitsOf, linear, padded, ticks }) =>
  cases.map(([[low, high], count]) => {
    const edges = padded([low, high]);
    const at = linear(edges, [0, 100]);
    const drawn = ticks(...edges, count);
    return { ticks: ticks(low, high, count), clock: clockTicks(low, high, count).map(([time]) => time), padded: edges,
      places: drawn.map(at), digits: [digitsOf(drawn), digitsOf([low, high])], back: [at.back(0), at.back(100)] };
  }))"""


@pytest.mark.slow
@settings(deadline=None, max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(cases=CASES)
def test_every_range_has_few_ticks_that_lie_in_it(blank, cases):
    for ((low, high), count), found in zip(cases, blank.evaluate(ANSWERS, cases), strict=True):
        least, greatest = sorted(min(max(bound, -1e300), 1e300) for bound in (low, high))
        for values, most in ((found["ticks"], max(6, 2 * count + 2)), (found["clock"], count + 2)):
            assert len(values) <= most
            assert all(math.isfinite(value) for value in values)
            assert values == sorted(set(values))
        if math.isnan(low) or math.isnan(high):
            assert found["ticks"] == found["clock"] == []
        else:
            slack = 1e-6 * (greatest - least) + 1e-270
            assert found["ticks"], "a range that can be drawn has a tick"
            assert all(least - slack <= value <= greatest + slack for value in found["ticks"])
        assert math.isfinite(found["padded"][0])
        assert found["padded"][0] < found["padded"][1] < math.inf
        assert all(math.isfinite(place) for place in (*found["places"], *found["back"]))
        assert len(found["places"]) >= 2, "an axis says its scale"
        assert all(0 <= digits <= 20 for digits in found["digits"])


def test_ticks_are_the_round_values(blank):
    script = "([low, high, count]) => import('/static/lib/axis.js').then(({ ticks }) => ticks(low, high, count))"
    for asked, expected in [
        ((0, 10, 5), [0, 2, 4, 6, 8, 10]),
        ((0.3, 0.9, 3), [0.4, 0.6, 0.8]),
        ((-3, 3, 4), [-2, 0, 2]),
        ((187, 187, 4), [187]),
    ]:
        assert [round(value, 12) for value in blank.evaluate(script, list(asked))] == expected


@pytest.mark.slow
def test_figures_that_differ_by_rounding_alone_are_drawn(browse, done):
    """Twenty equal replications: a spread of 2e-13 s around 177 s left the tab busy without an end, and no chart."""
    page = browse()

    def equal(route):
        answer = route.fetch()
        found = json.loads(answer.text())
        for place, item in enumerate(found["items"]):
            item["mean"] |= {"t_avg": 177.25, "t_comp_restored": 1e4, "t_comp": 1e4, "t_total": 0.0}
            item["deviation"] |= {"t_avg": 2e-13, "t_comp_restored": 4e-12 * place, "t_comp": 0.0, "t_total": 0.0}
        route.fulfill(response=answer, json=found)

    page.route("**/figures", equal)
    page.goto(f"{page.url.split('#')[0]}#/compare/{done.rsplit('/', 1)[-1]}")
    for scenario in page.locator(".tradeoff figure").all():
        expect(scenario.locator("svg .mark").first).to_be_visible()
        assert len(scenario.locator("svg .grid text").all()) < 30
    expect(page.locator(".tradeoff figure")).to_have_count(2)
    expect(page.locator('[data-metric="t_avg"] .bar')).to_have_count(4)
