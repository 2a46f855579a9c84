"""A subscriber in a process of its own: `python -m benchmarks.subscriber ENDPOINT TWIN [DELAY_S]`.

Says `ready`, waits for a line on stdin, then prints number and lateness [s] of every sample it has heard. With a delay
it takes samples through a ring of one, as docs/telemetry.md advises who is slower than the twin.
"""

from __future__ import annotations

import json
import sys
import threading
import time

import zenoh

from api.telemetry.session import connect


class Ear:
    """What was heard."""

    def __init__(self) -> None:
        self.heard: list[tuple[int, float]] = []
        self.ending = threading.Event()

    def hear(self, sample: zenoh.Sample) -> None:
        """Note a sample."""
        document = json.loads(sample.payload.to_bytes())
        self.heard.append((document["seq"], time.time() - document["sent"]))

    def hear_slowly(self, ring: zenoh.Subscriber[zenoh.handlers.Handler[zenoh.Sample]], delay: float) -> None:
        """Look at the newest sample again and again."""
        while not self.ending.wait(delay):
            sample = ring.try_recv()
            if sample is not None:
                self.hear(sample)


def main() -> None:
    """Listen until told to stop."""
    endpoint, twin = sys.argv[1], sys.argv[2]
    delay = float(sys.argv[3]) if len(sys.argv) > 3 else 0.0
    ear = Ear()
    with connect(endpoint) as session:
        name = f"hrs/v1/{twin}/sample"
        if delay:
            ring = session.declare_subscriber(name, zenoh.handlers.RingChannel(1))
            threading.Thread(target=ear.hear_slowly, args=(ring, delay), daemon=True).start()
        else:
            session.declare_subscriber(name, ear.hear)
        sys.stdout.write("ready\n")
        sys.stdout.flush()
        sys.stdin.readline()
        ear.ending.set()
    json.dump(ear.heard, sys.stdout)


if __name__ == "__main__":
    main()
