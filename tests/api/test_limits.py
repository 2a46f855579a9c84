"""Rate limits: a bucket for each key, none on loopback; memory bounded."""

from __future__ import annotations

import re

import httpx
import pytest

from api.http import rate_limits
from api.http.problems import ProblemError
from api.http.rate_limits import RateLimiter, TokenBuckets
from api.settings import Settings
from tests.api.conftest import RunningService
from tests.api.here import hrs


class Clock:
    now = 100.0

    def __call__(self):
        return self.now


def test_a_bucket_empties_and_fills():
    clock = Clock()
    buckets = TokenBuckets(2.0, 3, clock)
    assert [buckets.take("a").left for _ in range(3)] == [2, 1, 0]
    empty = buckets.take("a")
    assert (empty.granted, empty.next_s, empty.full_s) == (False, 0.5, 1.5)
    assert buckets.take("b").granted
    clock.now += 0.25
    assert not buckets.take("a").granted
    clock.now += 0.25
    assert buckets.take("a").granted
    assert not buckets.take("a").granted
    clock.now += 3600
    assert [buckets.take("a").granted for _ in range(4)] == [True, True, True, False]


def test_over_a_long_time_the_rate_is_kept():
    clock = Clock()
    buckets = TokenBuckets(5.0, 10, clock)
    granted = 0
    for _ in range(4000):
        clock.now += 1 / 64
        granted += buckets.take("a").granted
    assert granted in {9 + 5 * 4000 // 64, 10 + 5 * 4000 // 64}


def test_memory_is_bounded(monkeypatch):
    monkeypatch.setattr(rate_limits, "BUCKETS_MAX", 100)
    clock = Clock()
    buckets = TokenBuckets(1.0, 2, clock)
    buckets.take("kept")
    for number in range(1000):
        clock.now += 1e-6
        buckets.take(f"{number}")
        buckets.take("kept")
    assert len(buckets) == 100
    assert not buckets.take("kept").granted


def test_loopback_is_unlimited_unless_it_is_said():
    scope = {"client": ("127.0.0.1", 5)}
    assert RateLimiter(Settings(rate_limit_burst=1)).take("", scope) is None
    said = RateLimiter(Settings(rate_limit_burst=1, rate_limit_loopback=True))
    assert said.take("", scope).granted
    with pytest.raises(ProblemError):
        said.take("", scope)
    other = RateLimiter(Settings(rate_limit_burst=1, host="0.0.0.0"))  # noqa: S104  # nothing listens
    assert other.take("", {"client": ("10.0.0.1", 5)}).granted
    assert other.take("ann", {"client": ("10.0.0.1", 5)}).granted
    assert other.take("", {"client": None}).granted


@pytest.mark.slow
def test_a_key_has_a_bucket_and_so_have_those_without(tmp_path):
    ann = hrs("keys", "create", "ann", "--data", tmp_path).stdout.strip()
    bob = hrs("keys", "create", "bob", "--data", tmp_path).stdout.strip()
    slow = {"HRS_RATE_LIMIT_PER_S": "0.001", "HRS_RATE_LIMIT_BURST": "3"}
    service = RunningService(tmp_path, "--workers", "0", "--host", "0.0.0.0", **slow)  # noqa: S104  # needs keys

    def ask(key, path="/v1/stations"):
        return httpx.get(service.url + path, headers={"authorization": f"Bearer {key}"}, timeout=30, trust_env=False)

    try:
        for left in (2, 1, 0):
            answer = ask(ann)
            assert answer.status_code == 200
            assert answer.headers["ratelimit-policy"] == '"default";q=3;w=3000'
            assert re.fullmatch(rf'"default";r={left};t=\d+', answer.headers["ratelimit"])
        refused = ask(ann)
        assert refused.status_code == 429
        assert refused.json()["type"] == "urn:hrs-twin:problem:rate"
        assert 900 <= int(refused.headers["retry-after"]) <= 1000
        assert refused.headers["ratelimit"].startswith('"default";r=0;t=')
        assert "x-request-id" in refused.headers
        assert ask(bob).status_code == 200
        assert [ask(f"hrs_{number}").status_code for number in range(4)] == [401, 401, 401, 429]
        assert ask(bob).status_code == 200  # whoever tries keys from the same address
        for path in ("/", "/livez", "/readyz", "/static/app.js"):
            assert ask("no", path).status_code in (200, 503)
    finally:
        service.stop()


def test_nobody_is_limited_on_loopback(http):
    assert "ratelimit" not in http.get("/v1/stations").headers
