"""Measurements that no station sends, to a twin that must go on following those that one does."""

from __future__ import annotations

import pytest

from tests.fuzz import measurements
from tests.fuzz.rounds import rounds
from tests.fuzz.service import asking, fuzzed


@pytest.fixture(scope="module")
def service(tmp_path_factory):
    """A service with a measured twin `followed`."""
    with fuzzed(tmp_path_factory.mktemp("measurements")) as running, asking(running) as client:
        running.properties = measurements.properties(client)
        yield running
        assert running.complaints() == []


@rounds(80, 10_000)
def test_whatever_is_measured_is_refused_or_counted(service, cases, seed):
    assert service.properties[0].run(cases, seed) >= cases
