"""Lists in pages: every item once, whatever comes and goes meanwhile."""

from __future__ import annotations

import re

import httpx
import pytest

from tests.api.conftest import RunningService
from tests.api.test_idempotency import CREATING


@pytest.fixture(scope="module")
def queued(tmp_path_factory):
    """HTTP to a service without workers."""
    running = RunningService(tmp_path_factory.mktemp("queued"), "--workers", "0")
    with httpx.Client(base_url=running.url, timeout=30, trust_env=False) as client:
        yield client
    running.stop()


def _pages(http, path, meanwhile=lambda: None):
    """Every page by the links of the one before."""
    while path:
        answer = http.get(path)
        assert answer.status_code == 200, answer.text
        link = answer.headers.get("link")
        assert (link is None) == (answer.json()["next"] is None)
        yield answer.json()["items"]
        meanwhile()
        path = link and re.fullmatch(r'<(/v1/[^>]+)>; rel="next"', link)[1]
        assert not path or path.endswith(f"cursor={answer.json()['next']}")


@pytest.mark.parametrize("path", CREATING)
def test_every_item_comes_once_while_others_come_and_go(queued, path):
    there = [queued.post(path, json=CREATING[path]).json()["id"] for _ in range(7)]
    order = there if path == "/v1/twins" else there[::-1]
    assert [[item["id"] for item in page] for page in _pages(queued, f"{path}?limit=3")] == [
        order[:3],
        order[3:6],
        order[6:],
    ]
    assert [len(page) for page in _pages(queued, f"{path}?limit=7")] == [7]
    assert [len(page) for page in _pages(queued, path)] == [7]

    gone = iter([order[2], None, None])

    def meanwhile():
        """One more, and the last of the first page is gone."""
        queued.post(path, json=CREATING[path])
        if (one := next(gone, None)) is not None:
            queued.post(f"{path}/{one}/{'stop' if path == '/v1/twins' else 'cancel'}")
            assert queued.delete(f"{path}/{one}").status_code == 204

    seen = [item["id"] for page in _pages(queued, f"{path}?limit=3", meanwhile) for item in page]
    assert len(seen) == len(set(seen))
    assert [one for one in seen if one in there] == order


def test_a_filter_goes_on_with_the_link(queued):
    ids = [queued.post("/v1/runs", json={"scenario": "S1"}).json()["id"] for _ in range(5)]
    for one in ids[::2]:
        queued.post(f"/v1/runs/{one}/cancel")
    found = [item["id"] for page in _pages(queued, "/v1/runs?state=cancelled&limit=1") for item in page]
    assert [one for one in found if one in ids] == ids[::-2]


def test_events_are_paged_by_cursor_and_by_number(queued):
    queued.post("/v1/twins", json={"id": "telling", "scenario": "S1", "speed": "max", "at_end": "stop"})
    while queued.get("/v1/twins/telling").json()["state"] != "finished":
        pass
    told = queued.get("/v1/twins/telling").json()["events"]
    paged = [event["seq"] for page in _pages(queued, "/v1/twins/telling/events?limit=300&after=2") for event in page]
    assert paged == list(range(3, told))
    last = queued.get("/v1/twins/telling/events", params={"after": told - 3}).json()
    assert ([event["seq"] for event in last["items"]], last["after"], last["next"]) == (
        [told - 2, told - 1],
        told - 1,
        None,
    )
    assert queued.get("/v1/twins/telling/events", params={"after": told - 1}).json()["items"] == []


@pytest.mark.parametrize("path", [*CREATING, "/v1/twins/telling/events"])
@pytest.mark.parametrize(
    "query",
    [
        {"cursor": "nonsense"},
        {"cursor": "WzFd" * 60},
        {"cursor": "e30"},
        {"cursor": "W251bGwsMV0"},
        {"limit": 0},
        {"limit": 1001},
    ],
)
def test_a_wrong_page_names_its_field(queued, path, query):
    answer = queued.get(path, params=query)
    assert answer.status_code == 422, answer.text
    assert [error["field"] for error in answer.json()["errors"]] == list(query)
