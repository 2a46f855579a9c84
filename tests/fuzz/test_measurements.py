"""Measurements that no station sends, to a twin that must go on following those that one does."""

from __future__ import annotations

import pytest

from tests.fuzz import measurements
from tests.fuzz.service import asking, fuzzed


@pytest.fixture(scope="module")
def service(tmp_path_factory):
    """A service with a measured twin `followed`."""
    with fuzzed(tmp_path_factory.mktemp("measurements")) as running, asking(running) as client:
        running.properties = measurements.properties(client)
        yield running
        assert running.complaints() == []


@pytest.mark.parametrize(("cases", "seed"), [(80, None), pytest.param(10_000, 1, marks=pytest.mark.full)])
def test_whatever_is_measured_is_refused_or_counted(service, cases, seed):
    assert service.properties[0].run(cases, seed) >= cases
