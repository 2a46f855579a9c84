"""Event streams, which do not end and which schemathesis therefore leaves out: whatever a browser says it had last."""

from __future__ import annotations

import httpx
from hypothesis import strategies as st

from tests.fuzz.bodies import headers
from tests.fuzz.properties import Property

TWINS = ("fuzzed", "nobody", "%00", "x" * 33, "fuzzed%2F..")


def properties(client: httpx.Client) -> list[Property]:
    """Of the service that `client` asks, which has a twin `fuzzed` that runs."""

    def check(drawn: tuple[str, dict[str, bytes]]) -> None:
        twin, told = drawn
        sent = [(name.encode(), given) for name, given in told.items()]
        with client.stream("GET", f"/v1/twins/{twin}/stream", headers=sent) as answer:
            if twin != "fuzzed":
                assert 400 <= answer.status_code < 500
                return
            assert answer.status_code == 200
            assert answer.headers["content-type"].startswith("text/event-stream")
            assert next(answer.iter_lines()).startswith(("event:", "id:", "data:", ":"))

    return [Property("event streams", st.tuples(st.sampled_from(TWINS) | st.just("fuzzed"), headers), check)]
