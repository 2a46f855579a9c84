"""What is not there: a twin that is deleted while it is shown, and addresses that nothing has."""

from __future__ import annotations

import pytest
from playwright.sync_api import expect

from tests.api.page.living import start
from tests.api.page.test_age import STALE_S

WITHIN_MS = 1000 * STALE_S


def _deleted(http, twin):
    http.post(f"/v1/twins/{twin}/stop")
    assert http.delete(f"/v1/twins/{twin}").status_code == 204


@pytest.mark.slow
@pytest.mark.parametrize("ended", [False, True])
def test_a_twin_that_is_deleted_while_it_is_shown_says_so(browse, http, ended):
    start(http, "brief", until=30)
    start(http, "other")
    if ended:
        http.post("/v1/twins/brief/stop")
    page = browse("#/live/brief", expected=("404",))
    expect(page.locator("h1")).to_have_text("brief")
    watching = browse("#/live/other", expected=("404",))
    expect(watching.get_by_label("Twin", exact=True).locator("option", has_text="brief")).to_have_count(1)
    listing = browse("#/live", expected=("404",))
    expect(listing.get_by_role("link", name="brief", exact=True)).to_be_visible()
    _deleted(http, "brief")
    expect(page.locator("h1")).to_have_text("brief was deleted", timeout=WITHIN_MS)
    expect(page.locator(".schematic")).to_have_count(0)
    expect(page.get_by_role("link", name="All twins")).to_be_visible()
    expect(watching.get_by_label("Twin", exact=True).locator("option", has_text="brief")).to_have_count(
        0, timeout=WITHIN_MS
    )
    expect(listing.get_by_role("link", name="brief", exact=True)).to_have_count(0, timeout=WITHIN_MS)
    expect(watching.locator("h1")).to_have_text("other")
    _deleted(http, "other")


def test_one_that_takes_its_name_is_shown_instead(browse, http):
    start(http, "again", until=30)
    http.post("/v1/twins/again/stop")
    # figures of a window that the new one has not told; and it shall not ask while there is neither
    page = browse("#/live/again", expected=("404", "422", "ERR_INTERNET_DISCONNECTED"))
    expect(page.locator(".facts")).to_contain_text("controller logic")
    page.context.set_offline(True)
    _deleted(http, "again")
    start(http, "again", controller="switched")
    page.context.set_offline(False)
    expect(page.locator(".facts")).to_contain_text("controller switched", timeout=WITHIN_MS)
    _deleted(http, "again")


@pytest.mark.slow
@pytest.mark.parametrize("place", ["%E0%A4%A", "%", "%zz", "%2", "%00"])
def test_an_address_that_is_no_escape_names_nothing(browse, place):
    for view, says in (
        ("live", "No such twin"),
        ("compare", "There is no such comparison"),
        ("certificates", "no certificate is called"),
        ("certificates/service", "no controller is called"),
        ("scenarios", "no scenario is called"),
    ):
        page = browse(f"#/{view}/{place}", expected=("404", "422"))
        expect(page.locator("#view")).to_contain_text(says)
        page.context.close()
