"""A subscriber in a process of its own, which notes samples and the gaps it sees: `... ENDPOINT FILE`.

It knows nothing of the service but docs/telemetry.md, and goes on over restarts of router and service.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from api.telemetry.session import connect
from tests.nemesis.history import History


class Ear:
    """Notes what is published, and what must have been missed."""

    def __init__(self, history: History) -> None:
        self._history = history
        self._last: dict[str, tuple[int, int]] = {}  # epoch and number of each twin's newest sample

    def hear(self, sample: dict) -> None:
        """One sample."""
        twin, epoch, seq = sample["twin"], sample["epoch"], sample["seq"]
        before = self._last.get(twin)
        if before is not None and epoch == before[0] and seq > before[1] + 1:
            self._history.note("gap", twin=twin, epoch=epoch, first=before[1] + 1, last=seq - 1)
        self._last[twin] = (epoch, seq)
        self._history.note("sample", twin=twin, epoch=epoch, seq=seq, values=sample["values"])


def main() -> None:
    """Listen until the input ends, then write down what was heard."""
    endpoint, path = sys.argv[1], Path(sys.argv[2])
    history = History()
    ear = Ear(history)
    with connect(endpoint) as session:
        subscriber = session.declare_subscriber(
            "hrs/v1/*/sample", lambda sample: ear.hear(json.loads(sample.payload.to_bytes()))
        )
        print("ready", flush=True)
        sys.stdin.read()
        subscriber.undeclare()
    history.write(path)


if __name__ == "__main__":
    main()
