"""Schemathesis over the whole API: no 5xx, no answer outside its schema, no method, header or status undocumented."""

from __future__ import annotations

import httpx
import pytest

from tests.fuzz.schema import ALL, fuzz
from tests.fuzz.service import Fuzzed, fuzzed

CREATING = ("/v1/runs", "/v1/comparisons", "/v1/certificates", "/v1/twins", "/v1/keys")
LISTS = ("/v1/runs", "/v1/comparisons", "/v1/certificates", "/v1/twins")


@pytest.fixture(params=["sqlite", pytest.param("postgresql", marks=pytest.mark.full)])
def database(request):
    """URL of an empty database, or None for the embedded one."""
    return request.getfixturevalue("postgres_url") if request.param == "postgresql" else None


def _nothing_found(service: Fuzzed, report) -> None:
    assert report.findings == (), report.text
    assert service.complaints() == []


@pytest.mark.slow
def test_what_the_document_allows_is_answered_as_it_says(tmp_path, database):
    """Each operation alone on one database, sequences along links on the other: a minute has room for no more."""
    with fuzzed(tmp_path, database) as service:
        phases = ("examples", "stateful") if database else ("examples",)
        report = fuzz(service.url, tmp_path, examples=20, seed=1, phases=phases)
        _nothing_found(service, report)
    assert report.operations > 40
    assert report.cases > 100
    assert all(report.accepted.get(f"POST {path}") for path in CREATING), report.accepted


@pytest.mark.full
def test_every_limit_of_every_field_and_much_at_random(tmp_path, database):
    with fuzzed(tmp_path, database) as service:
        report = fuzz(service.url, tmp_path, examples=6, seed=2, phases=ALL[:-1])
        _nothing_found(service, report)
        assert report.cases > 300


@pytest.mark.slow
def test_sequences_along_links(tmp_path, database):
    """Hypothesis ends a seed's sequences where one is answered otherwise the second time (a name that is taken)."""
    tried, operations = 0, 0
    with fuzzed(tmp_path, database) as service:
        for seed in range(2, 6):
            report = fuzz(service.url, tmp_path, examples=100, seed=seed, phases=ALL[-1:])
            _nothing_found(service, report)
            tried, operations = tried + report.cases, max(operations, report.operations)
    assert tried > 500
    assert operations > 30, "links lead to so many"


@pytest.mark.slow
def test_a_key_is_asked_for_and_one_that_reads_changes_nothing(tmp_path):
    """Schemathesis asks without the key, too, which must be refused."""
    with fuzzed(tmp_path, guarded=True) as service:
        report = fuzz(service.url, tmp_path, examples=1, seed=3, phases=("examples",), key=service.keys["read"])
        _nothing_found(service, report)
        assert not any(report.accepted.get(f"POST {path}") for path in CREATING)
        assert [_count(service, path, key) for path in LISTS for key in service.keys.values()] == [0] * 2 * len(LISTS)


def _count(service: Fuzzed, path: str, key: str) -> int:
    answer = httpx.get(service.url + path, headers={"authorization": f"Bearer {key}"}, timeout=30, trust_env=False)
    return len(answer.json()["items"])
