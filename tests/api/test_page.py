"""The page: nothing from elsewhere, and a real browser shows what the service says."""

from __future__ import annotations

import re
import shutil
import subprocess
import time
from html.parser import HTMLParser
from pathlib import Path

import pytest

FILES = Path(__file__).parents[2] / "api" / "page" / "static"


def test_nothing_is_loaded_from_elsewhere(http):
    page = http.get("/")
    assert page.headers["content-security-policy"].startswith("default-src 'self'")
    for address in re.findall(r'(?:src|href)="([^"]+)"', page.text):
        assert address.startswith("/"), address
        assert http.get(address).status_code == 200
    assert not re.search(r"<script(?![^>]*src=)|<style|\sstyle=|\son\w+=", page.text)
    for file in FILES.glob("*.*"):
        assert not re.search(r"https?://(?!www\.w3\.org/2000/svg)", file.read_text()), file


def test_the_documentation_is_served_from_here(http):
    page = http.get("/docs").text
    for address in re.findall(r'(?:src|href)="([^"]+)"', page):
        assert address.startswith("/static/")
        assert http.get(address).status_code == 200


class Rows(HTMLParser):
    """Texts of a page's table rows."""

    def __init__(self):
        super().__init__()
        self.rows, self.inside = [], False

    def handle_starttag(self, tag, attrs):
        if tag == "tr":
            self.rows.append([])
        self.inside = tag in ("td", "th")

    def handle_endtag(self, tag):
        self.inside = False

    def handle_data(self, data):
        if self.inside and self.rows:
            self.rows[-1].append(data)


def test_a_browser_shows_the_twin_and_the_jobs(service, http):
    browser = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if browser is None:
        pytest.skip("no Chromium is installed")
    http.post("/v1/twins", json={"id": "shown", "scenario": "S1", "speed": 100, "at_end": "repeat"})
    job = http.post("/v1/comparisons", json={"scenarios": ["S1"], "controllers": ["logic"]}).headers["location"]
    while http.get(job).json()["finished"] is None:
        time.sleep(0.05)
    while http.get("/v1/twins/shown").json()["samples"] < 100:
        time.sleep(0.05)
    http.patch("/v1/twins/shown", json={"paused": True})
    values = http.get("/v1/twins/shown").json()["values"]
    rows, tries = {}, 0
    while "high" not in rows and tries < 4:  # a browser on a busy machine may be asked before it has heard anything
        tries += 1
        budget = f"--virtual-time-budget={4000 * tries}"
        command = [browser, "--headless", "--no-sandbox", "--disable-gpu", budget, "--timeout=20000", "--dump-dom"]
        done = subprocess.run([*command, service.url], capture_output=True, text=True, timeout=90, check=False)
        found = Rows()
        found.feed(done.stdout)
        rows = {row[0]: row for row in found.rows if row}
    for tank in ("high", "medium", "low"):
        assert rows[tank][1] == f"{values[f'pressure_{tank}']:.1f}", done.stdout[-3000:]
    assert ["succeeded", "1 of 1", "S1", "logic"] in [row[1:5] for row in found.rows]
    assert "<polyline" in done.stdout
    assert "<li>" in done.stdout
    http.post("/v1/twins/shown/stop")
