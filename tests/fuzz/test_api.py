"""Schemathesis over the whole API: no 5xx, no answer outside its schema, no method, header or status undocumented."""

from __future__ import annotations

import httpx
import pytest

from tests.fuzz.schema import ALL, fuzz
from tests.fuzz.service import Fuzzed, fuzzed

CREATING = ("/v1/runs", "/v1/comparisons", "/v1/certificates", "/v1/twins", "/v1/keys")
LISTS = ("/v1/runs", "/v1/comparisons", "/v1/certificates", "/v1/twins")


@pytest.fixture(params=["sqlite", pytest.param("postgresql", marks=pytest.mark.slow)])
def database(request):
    """URL of an empty database, or None for the embedded one."""
    return request.getfixturevalue("postgres_url") if request.param == "postgresql" else None


def _nothing_found(service: Fuzzed, report) -> None:
    assert report.findings == (), report.text
    assert service.complaints() == []


def test_what_the_document_allows_is_answered_as_it_says(tmp_path, database):
    """Each operation alone on one database, sequences along links on the other: a minute has room for no more."""
    with fuzzed(tmp_path, database) as service:
        drawn = ("stateful", 20) if database else ("fuzzing", 1)
        report = fuzz(service.url, tmp_path, examples=drawn[1], seed=1, phases=("examples", drawn[0]))
        _nothing_found(service, report)
    assert report.operations > 40
    assert report.cases > 100
    assert all(report.accepted.get(f"POST {path}") for path in CREATING), report.accepted


@pytest.mark.slow
def test_every_limit_of_every_field_and_much_at_random(tmp_path, database):
    with fuzzed(tmp_path, database) as service:
        for phases, examples in ((ALL[:-1], 20), (ALL[-1:], 100)):
            report = fuzz(service.url, tmp_path, examples=examples, seed=2, phases=phases)
            _nothing_found(service, report)
            assert report.cases > 300


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
