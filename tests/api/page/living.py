"""What the tests of the live view share: twins that stand where they should, and what the page shows of them."""

from __future__ import annotations

from tests.waiting import wait_until

SERIES = "document.querySelector('.series').series"


def start(http, twin, *, until=0, **more):
    """Start a twin and let it stand still behind that many samples."""
    asked = {"id": twin, "scenario": "S1", "controller": "logic", "speed": "max" if until else 1, "at_end": "idle"}
    answer = http.post("/v1/twins", json={**asked, "paused": not until, **more})
    assert answer.status_code == 201, answer.text
    if until:
        wait_until(lambda: http.get(f"/v1/twins/{twin}").json()["samples"] >= until)
        http.patch(f"/v1/twins/{twin}", json={"paused": True, "speed": 1})
    return http.get(f"/v1/twins/{twin}").json()


def figure(page, name):
    """The text of a figure of the station's picture, with plain spaces."""
    return page.locator(f'.schematic [data-value="{name}"]').text_content().replace("\u202f", " ")


def until_series(page, expression):
    """Wait until something is true of the series, `s`."""
    series = "document.querySelector('.series')?.series"
    wait_until(lambda: page.evaluate(f"() => {{ const s = {series}; return Boolean(s && ({expression})); }}"))


def clock(seconds):
    return f"{int(seconds) // 3600}:{int(seconds) // 60 % 60:02}:{int(seconds) % 60:02}"


def rows_shown(page):
    """The rows of the series within the window: times, and the columns by name."""
    return page.evaluate(f"""async () => {{
        const {{ SHOWN }} = await import('/static/live/names.js');
        const {{ table, span }} = {SERIES};
        const within = table[0].map((time) => time >= span.from && time <= span.to);
        const part = (place) => table[place].filter((_, row) => within[row]);
        return Object.fromEntries(['time', ...SHOWN].map((name, place) => [name, part(place)]));
    }}""")


def point(page, share):
    """Put the cursor of the series at a share of the window's width, as a mouse does."""
    over = page.locator(".panels .u-over").first
    over.scroll_into_view_if_needed()
    box = over.bounding_box()
    page.mouse.move(box["x"] + share * box["width"] + 5, box["y"] + 30)
    page.mouse.move(box["x"] + share * box["width"], box["y"] + 30)
    until_series(page, "document.querySelector('.shown').textContent.includes('cursor')")
