"""A real Chromium for the tests of the page: console errors fail a test, axe-core reads every view."""

from __future__ import annotations

import contextlib
import shutil
from http import HTTPStatus

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Error, expect, sync_playwright

from tests.api.page.comparing import compared

WIDE, NARROW = {"width": 1280, "height": 900}, {"width": 390, "height": 844}

expect.set_options(timeout=20_000)


@pytest.fixture(scope="session")
def chromium():
    """The system's Chromium, else the one Playwright brought."""
    found = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    with sync_playwright() as playwright:
        try:
            browser = playwright.chromium.launch(executable_path=found, args=["--no-sandbox", "--disable-gpu"])
        except Error as problem:
            pytest.skip(f"no Chromium starts here: {str(problem).splitlines()[0]}")
        yield browser
        browser.close()


@pytest.fixture
def browse(chromium, service):
    """Open a place of the page: browse("#/live", dark=True, size=NARROW); no console error may stand at the end,
    and no failure of the service, of which its log is told.

    `expected` are parts of messages that a test provokes (a browser reports a refused request as an error).
    """
    with contextlib.ExitStack() as stack:
        said = []

        def opened(place="", *, dark=False, size=WIDE, expected=()):
            context = chromium.new_context(color_scheme="dark" if dark else "light", viewport=size)
            stack.callback(context.close)
            page = context.new_page()
            page.set_default_timeout(20_000)

            def note(message):
                if message.type == "error" and not any(part in message.text for part in expected):
                    said.append(message.text)

            page.on("console", note)

            def failed(answer):
                if answer.status >= HTTPStatus.INTERNAL_SERVER_ERROR:
                    said.extend((answer.url, *service.said))

            page.on("response", failed)
            page.on("pageerror", lambda error: said.append(str(error)))
            page.on(
                "request", lambda r: None if r.url.startswith((service.url, "blob:", "data:")) else said.append(r.url)
            )
            page.goto(f"{service.url}/{place}")
            return page

        yield opened
        assert said == []


@pytest.fixture(scope="module")
def done(http):
    """Path of a comparison with two replications that is done, for the tests of a file."""
    return compared(http, replications=2, seed=3)


def violations(page) -> list[str]:
    """What axe-core finds wrong on a page."""
    found = Axe().run(page).response["violations"]
    return [f"{item['id']}: {node['target']} {node['failureSummary']}" for item in found for node in item["nodes"]]


def overflows(page) -> bool:
    """Whether a page is wider than its window."""
    return page.evaluate("document.documentElement.scrollWidth > window.innerWidth")


@pytest.fixture
def blank(browse):
    """The page, for the functions of its modules."""
    return browse("#/certificates")
