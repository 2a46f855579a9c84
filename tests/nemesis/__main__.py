"""`python -m tests.nemesis --store sqlite --faults 200 --seed 7`."""

from __future__ import annotations

import argparse
import signal
import sys
import tempfile
from pathlib import Path

from tests.nemesis.arena import POSTGRESQL, SQLITE
from tests.nemesis.faults import plan
from tests.nemesis.postgres import missing
from tests.nemesis.run import torment


def main() -> int:
    """Run, tell, judge; 1 where something is wrong."""
    parser = argparse.ArgumentParser(prog="python -m tests.nemesis", description=__doc__)
    parser.add_argument("--store", choices=[SQLITE, POSTGRESQL], default=SQLITE)
    parser.add_argument("--faults", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--folder", type=Path, help="where history, store and log go; default: a new one")
    asked = parser.parse_args()
    if asked.store == POSTGRESQL and (reason := missing()):
        parser.error(reason)
    folder = asked.folder or Path(tempfile.mkdtemp(prefix="hrs-nemesis-"))
    folder.mkdir(parents=True, exist_ok=True)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # and everything that was started ends, too
    faults = plan(asked.store, asked.faults, asked.seed)
    report = torment(asked.store, faults, asked.seed, folder, tell=lambda line: print(line, flush=True))
    print(report)
    print(f"history, store and log: {folder}")
    return 1 if report.wrong else 0


if __name__ == "__main__":
    sys.exit(main())
