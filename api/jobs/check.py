"""A process that makes or checks one certificate within limits and ends with its server; `Checks` starts it.

`python -m api.jobs.check FAMILY` imports what the family needs, reads a line of JSON, the order, and behind it a
document of as many bytes as that says. It writes the answer as JSON. Its input stays open: it ends where that does.
"""

from __future__ import annotations

import json
import os
import resource
import signal
import sys
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any

MATRICES, SERVICE = "matrices", "service"
"""Families: certificates about switched systems, which need the standard library, and about service."""

SERVICE_FORMAT = "hrs-service-certificate"
"""As `controllers.certified.service.FORMAT`, which takes half a second to import."""

OUT_OF_MEMORY = 77
"""Status of a process that has met its limit of memory."""

_NICENESS = 10
"""Live twins and requests go first."""

Answer = dict[str, Any]

Work = Callable[[Mapping[str, Any], bytes], Answer]


def main(family: str) -> None:
    """Do what is ordered."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)  # both may reach the whole group; the server ends its checks
    works = _matrices() if family == MATRICES else _services()
    line = sys.stdin.buffer.readline()
    if not line:
        return
    order = json.loads(line)
    document = sys.stdin.buffer.read(order["bytes"])
    threading.Thread(target=_end_with_the_server, daemon=True).start()
    _limit(order["cpu_s"], order["memory_bytes"])
    try:
        answer = json.dumps(works[order["work"]](order, document))
    except MemoryError:
        os._exit(OUT_OF_MEMORY)
    sys.stdout.write(answer)
    sys.stdout.flush()
    os._exit(0)


def _end_with_the_server() -> None:
    sys.stdin.buffer.read(1)
    os._exit(1)


def _limit(cpu_s: float, memory_bytes: int) -> None:
    """From now on so many seconds of CPU and so many bytes of address space more; imports do not count."""
    os.nice(_NICENESS)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    used = resource.getrusage(resource.RUSAGE_SELF)
    seconds = int(used.ru_utime + used.ru_stime + cpu_s) + 1
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))
    with suppress(OSError), open("/proc/self/statm", encoding="ascii") as status:  # noqa: PTH123  # pathlib is slow here
        held = int(status.read().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (held + memory_bytes, held + memory_bytes))


def _matrices() -> dict[str, Work]:
    from theory.checker import Refused, verify

    def check(_order: Mapping[str, Any], document: bytes) -> Answer:
        try:
            found = verify(json.loads(document))
        except Refused as error:
            return {"verified": False, "claim": str(error)}
        except (ValueError, RecursionError) as error:
            return {"verified": False, "claim": f"malformed document: {type(error).__name__}: {error}"}
        return {"verified": True, "claim": found.claim, "inequalities": found.inequalities}

    return {"check": check}


def _services() -> dict[str, Work]:
    from controllers.certified.service import RefusedError, certify, check_belongs, verify
    from station import InputError, Station

    def make(order: Mapping[str, Any], _document: bytes) -> Answer:
        try:
            return {"document": certify(order["controller"], Station.model_validate(order["station"]))}
        except InputError as error:
            return {"problems": error.problems}

    def check(_order: Mapping[str, Any], document: bytes) -> Answer:
        try:
            found = verify(json.loads(document))
        except RefusedError as error:
            return {"verified": False, "claim": str(error)}
        return {"verified": True, "claim": f"{found['verdict']}: {found['claim']}"}

    def belongs(order: Mapping[str, Any], document: bytes) -> Answer:
        try:
            check_belongs(json.loads(document), order["controller"], Station.model_validate(order["station"]))
        except RefusedError as error:
            return {"refused": [error.field, error.reason]}
        return {"refused": None}

    return {"make": make, "check": check, "belongs": belongs}


if __name__ == "__main__":
    main(sys.argv[1])
