"""`python -m tests.fuzz --cases 10000 --seed 1`: all that is fuzzed, on SQLite and PostgreSQL; 1 for a finding."""

from __future__ import annotations

import argparse
import sys
import tempfile
import traceback
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

from controllers.certified.service import certify
from controllers.registry import compile_all
from tests.api.conftest import SERVER, _answers, _empty_database
from tests.fuzz import bodies, certificates, measurements, payloads, scenarios, streams, traces
from tests.fuzz.properties import Property
from tests.fuzz.schema import ALL, fuzz
from tests.fuzz.service import Fuzzed, asking, fuzzed
from tests.generous import generous

SHARES = {
    "request bodies": 0.05, "queries and headers": 0.04, "event streams": 0.01, "zenoh questions": 0.02,
    "zenoh commands": 0.02, "zenoh puts": 0.01, "zenoh decisions": 0.02, "scenario files": 0.10, "station files": 0.03,
    "trace files": 0.05, "trace texts": 0.03, "certificates": 0.06, "no certificates": 0.01,
    "certificates of service": 0.002, "measurements": 0.05,
}  # fmt: skip
"""Of all cases, by property; what is in ON_BOTH counts twice. Schemathesis has what is left."""

ON_BOTH = ("request bodies", "queries and headers", "measurements")
"""What is fuzzed on both databases."""

Row = tuple[str, int, list[str]]


def main() -> int:
    """Fuzz, print what was tried and found."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--cases", type=int, default=10_000, help="at least so many in all (default 10 000)")
    parser.add_argument("--seed", type=int, default=1, help="the same cases again for the same seed (default 1)")
    given = parser.parse_args()
    for name in compile_all():  # a service that still compiles answers 503, which is no finding
        print(f"{name} is compiled", flush=True)
    rows = []
    for name, cases, findings in _tried(given.cases, given.seed):
        rows.append((name, cases, findings))
        print(f"{name:<42} {cases:>7}  {len(findings)} findings", flush=True)
        for finding in findings:
            print(finding, flush=True)
    total, found = sum(cases for _, cases, _ in rows), sum(len(findings) for *_, findings in rows)
    print(f"{'all':<42} {total:>7}  {found} findings; seed {given.seed}")
    return 1 if found else 0


def _tried(cases: int, seed: int) -> Iterator[Row]:
    alone = [*scenarios.PROPERTIES, *traces.PROPERTIES, *certificates.PROPERTIES]
    for each in [*alone, *certificates.service_properties(certify("reserve", generous()))]:
        yield _run(each, cases, seed)
    rest = (
        1
        - sum(SHARES.values())
        - sum(SHARES[name] for name in ("request bodies", "queries and headers", "measurements"))
    )
    with tempfile.TemporaryDirectory() as folder:
        yield from _served(Path(folder), "SQLite", None, cases, int(rest * cases / 2), seed)
    if not _answers(SERVER):
        yield "PostgreSQL", 0, [f"no server answers at HRS_TEST_POSTGRES ({SERVER})"]
        return
    with tempfile.TemporaryDirectory() as folder, _empty_database(SERVER) as url:
        yield from _served(Path(folder), "PostgreSQL", url, cases, int(rest * cases / 2), seed)


def _served(folder: Path, where: str, database: str | None, cases: int, wanted: int, seed: int) -> Iterator[Row]:
    """What is asked of a service on one database; `wanted` of schemathesis's."""
    with ExitStack() as stack:
        service: Fuzzed = stack.enter_context(fuzzed(folder, database))
        tried = 0
        while tried < wanted:  # a round tries each limit of each field, and some of each operation at random
            for what, phases, examples in (("alone", ALL[:-1], 5), ("in sequences", ALL[-1:], 60)):
                report = fuzz(service.url, folder, examples=examples, seed=seed, phases=phases)
                findings = [*report.findings, *([report.text] if report.findings else [])]
                yield f"operations {what} on {where}, seed {seed}", report.cases, findings
                tried += report.cases
            seed += 1
        service.stop_twins()
        client = stack.enter_context(asking(service))
        found = bodies.properties(client) + streams.properties(client) + measurements.properties(client)
        if database is None:
            found += stack.enter_context(payloads.properties(service.url, service.zenoh))
        for each in found:
            name, count, findings = _run(each, cases, seed)
            yield f"{name} on {where}", count, findings
        yield f"what the service on {where} says", 0, service.complaints()


def _run(each: Property, cases: int, seed: int) -> Row:
    """At least a case a finding could hide in."""
    try:
        return each.name, each.run(max(1, round(SHARES[each.name] * cases)), seed), []
    except Exception:  # noqa: BLE001  # whatever it is, it is what was looked for
        return each.name, 0, [traceback.format_exc()]


if __name__ == "__main__":
    sys.exit(main())
