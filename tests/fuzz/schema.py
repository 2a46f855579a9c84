"""Schemathesis over the whole OpenAPI document of a running service, as its command line does it."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
CONFIG = Path(__file__).with_name("schemathesis.toml")

ALL = ("examples", "coverage", "fuzzing", "stateful")
"""Examples of the document; each limit of each field, by itself; random ones; and sequences along links."""


@dataclass(frozen=True)
class Report:
    """What a run found."""

    cases: int
    operations: int
    accepted: dict[str, int]  # requests that were answered 2xx, by operation
    findings: tuple[str, ...]
    text: str  # what schemathesis printed: how to do each again


def fuzz(
    url: str, folder: Path, *, examples: int, seed: int, phases: Sequence[str] = ALL, key: str = "",
    options: Sequence[str] = (),
) -> Report:  # fmt: skip
    """Ask everything that the document of the service at `url` allows, and much that it does not.

    `examples` of each operation in the phases that draw at random, with `key` where it asks for one.
    """
    path = folder / f"report-{seed}.json"
    command = [
        sys.executable, "-m", "schemathesis.cli", "--config-file", CONFIG, "run", f"{url}/openapi.json", "--no-color",
        "--phases", ",".join(phases), "--max-examples", str(examples), "--seed", str(seed), "--report", "json",
        "--report-json-path", path, *(("--header", f"Authorization: Bearer {key}") if key else ()), *options,
    ]  # fmt: skip
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    if not path.exists():
        raise AssertionError(done.stdout + done.stderr)
    told = json.loads(path.read_text())
    findings = [f"{found['title']}: {', '.join(found['operations'])}" for found in told["failures"]]
    findings += [f"error: {error}" for error in told["errors"]]
    if not told["complete"]:
        findings.append(f"stopped: {told['stop_reason']}")
    accepted = {name: sum(each["accepted"] for each in phases.values()) for name, phases in told["valid_rates"].items()}
    cases, operations = told["test_cases"]["generated"], told["operations"]["tested"]
    return Report(cases, operations, accepted, tuple(findings), done.stdout)
