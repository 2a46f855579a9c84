"""Where a name or an option is not known, those that can have been meant are told: all there are, and no others."""

from __future__ import annotations

import pytest

from tests.api.test_half_characters import PLAIN
from tests.warm import run_hrs as hrs

WORKERS = 0


@pytest.fixture
def stored(http):
    """Scenarios of users: more than are told at once."""
    names = [f"day-{k}" for k in range(11)] + ["sy"]
    for name in names:
        assert http.put(f"/v1/scenarios/{name}", json={**PLAIN, "name": name}).status_code == 201
    yield names
    for name in names:
        http.delete(f"/v1/scenarios/{name}")


@pytest.mark.slow
def test_what_can_be_deleted_is_told(service, http):
    none = hrs("scenarios", "delete", "sx", "--url", service.url)
    assert none.returncode == 2
    assert "no stored scenario is called 'sx'; there are none" in none.stderr
    http.put("/v1/scenarios/day", json={**PLAIN, "name": "day"})
    one = hrs("scenarios", "delete", "sx", "--url", service.url)
    assert "no stored scenario is called 'sx'; there are day" in one.stderr
    read = hrs("scenarios", "get", "sx", "--url", service.url)
    assert "no scenario is called 'sx'; there are S1, S2, S3, S4, day" in read.stderr
    http.delete("/v1/scenarios/day")


def test_of_many_the_nearest_come_first(http, stored):
    told = http.delete("/v1/scenarios/sx").json()["detail"].partition("there are ")[2].split(", ")
    assert told[0] == "sy"
    assert (len(told), told[-1]) == (11, "2 more")
    assert set(told[:-1]) <= set(stored)


@pytest.mark.parametrize(
    ("arguments", "meant"),
    [
        (("compare", "--replication", "3"), "--replications"),
        (("compare", "S1", "--statoin", "x"), "--station"),
        (("serve", "--prt", "1"), "--port"),
        (("scenarios", "put", "--nw", "x", "y"), "--new"),
        (("keys", "create", "x", "--scop", "run"), "--scope"),
    ],
)
def test_one_option_is_named(arguments, meant):
    done = hrs(*arguments)
    assert done.returncode == 2
    assert f"No such option: {next(each for each in arguments if each.startswith('--'))}" in done.stderr
    assert done.stderr.count("--") == 3, done.stderr  # `--help`, the one given, the one meant
    assert meant in done.stderr
