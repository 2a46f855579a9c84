"""A stranger on zenoh asks, orders, puts and decides what nobody meant; the service and its twins go on."""

from __future__ import annotations

import httpx
import pytest

from tests.fuzz.payloads import properties
from tests.fuzz.rounds import rounds
from tests.fuzz.service import fuzzed


@pytest.fixture(scope="module")
def service(tmp_path_factory):
    """A service with a twin that is fuzzed and one that asks the stranger."""
    with fuzzed(tmp_path_factory.mktemp("payloads")) as running, properties(running.url, running.zenoh) as found:
        running.properties = found
        yield running
        assert running.complaints() == []


@pytest.mark.slow
@rounds(40, 500)
@pytest.mark.parametrize("place", range(4))
def test_whatever_is_sent_the_service_goes_on(service, place, cases, seed):
    assert service.properties[place].run(cases, seed) >= cases


def test_nonsense_is_told_as_a_missed_deadline(service):
    service.properties[3].check((b"nonsense", "once"))
    events = httpx.get(f"{service.url}/v1/twins/asking/events?limit=1000", timeout=60, trust_env=False).json()["items"]
    assert "deadline_missed" in {event["kind"] for event in events}
