"""Figures keep their units, and who cannot see a picture is told of nothing in it that has no name."""

from __future__ import annotations

import pytest
from playwright.sync_api import expect

from tests.api.page.comparing import compared
from tests.api.page.living import start

BROKEN = """() => [...document.querySelectorAll('.days dd, .days td.number')].filter((figure) => {
    const range = document.createRange();
    range.selectNodeContents(figure);
    const lines = new Set([...range.getClientRects()].map(({ top }) => Math.round(top)));
    return lines.size > 1 || figure.scrollWidth > figure.clientWidth;
}).map((figure) => figure.textContent)"""


@pytest.fixture(scope="module")
def served(http):
    """A twin that has filled vehicles."""
    start(http, "served", until=3000)
    yield "served"
    http.post("/v1/twins/served/stop")


def _unnamed(page):
    """Pictures in the accessibility tree that have no name."""
    session = page.context.new_cdp_session(page)
    nodes = session.send("Accessibility.getFullAXTree")["nodes"]
    session.detach()
    pictures = [node for node in nodes if not node["ignored"] and node["role"]["value"] in {"img", "image", "SvgRoot"}]
    return pictures, [node for node in pictures if not node.get("name", {}).get("value")]


@pytest.mark.parametrize("width", [390, 800, 1000, 1280, 1360, 1920])
def test_no_figure_of_a_day_breaks(browse, served, width):
    page = browse(f"#/live/{served}", size={"width": width, "height": 900})
    expect(page.locator(".days dd").first).to_be_visible()
    expect(page.locator(".days dl")).to_contain_text("kWh/kg")
    longest = "123\N{NARROW NO-BREAK SPACE}456.05\N{NARROW NO-BREAK SPACE}kWh"
    for text in (None, "11.05\N{NARROW NO-BREAK SPACE}kWh/kg", longest):
        if text:
            page.locator(".days dd").evaluate_all(
                "(found, text) => found.forEach((each) => (each.textContent = text))", text
            )
        assert page.evaluate(BROKEN) == []


@pytest.mark.slow
def test_every_picture_has_a_name(browse, http, served):
    path = compared(http, scenarios=["S1"], controllers=["logic", "switched"])
    job = path.rsplit("/", 1)[-1]
    for place, ready in (
        (f"#/live/{served}", ".schematic .valve"),
        ("#/live", ".twin-card"),
        ("#/scenarios/S1", "figure svg"),
        (f"#/compare/{job}", ".tradeoff svg .mark"),
        ("#/certificates", "h1"),
    ):
        page = browse(place)
        expect(page.locator(ready).first).to_be_visible()
        pictures, unnamed = _unnamed(page)
        assert unnamed == [], place
        if "served" in place:
            assert len(pictures) >= 6, "each valve says what it is"
        page.context.close()
