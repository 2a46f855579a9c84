"""What the tests of the compare view share: a comparison that is done, the form, and what is drawn."""

from __future__ import annotations

from playwright.sync_api import expect

from tests.api.conftest import ended

TWO = {"scenarios": ["S1", "S2"], "controllers": ["logic", "minlp1"]}
BY = "\N{MULTIPLICATION SIGN}"
VALVES = [f"{side}_{buffer}" for side in ("outlet", "inlet") for buffer in ("high", "medium", "low")]


def compared(http, **asked) -> str:
    """Path of a comparison that is done."""
    path = http.post("/v1/comparisons", json={**TWO, **asked}).headers["location"]
    assert ended(http, path)["state"] == "succeeded"
    return path


def place(path: str) -> str:
    return f"#/compare/{path.rsplit('/', maxsplit=1)[-1]}"


def opened(browse, path, **how):
    page = browse(place(path), **how)
    expect(page.locator(".schedule h2")).to_be_visible()
    return page


def only(page, **chosen) -> None:
    """Choose these scenarios and controllers in the form, and no others."""
    expect(page.locator("form.new")).to_be_visible()
    for name, wanted in chosen.items():
        for box in page.locator(f"input[name={name}]").all():
            box.set_checked(box.get_attribute("value") in wanted)


def data(page, selector, *names) -> list[tuple]:
    """Attributes data-* of the elements a selector finds, numbers as such."""
    found = page.locator(selector).evaluate_all("all => all.map(each => ({...each.dataset}))")
    return [tuple(_read(item.get(name)) for name in names) for item in found]


def _read(text):
    try:
        return float(text)
    except (TypeError, ValueError):
        return text


def counted(http) -> int:
    return len(http.get("/v1/comparisons", params={"limit": 200}).json()["items"])
