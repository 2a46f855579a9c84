"""A zenoh router in a process of its own: `python -m tests.nemesis.router ENDPOINT`, until its input ends."""

from __future__ import annotations

import json
import sys

import zenoh


def main() -> None:
    """Open it, say so, wait."""
    config = {
        "mode": "router",
        "listen": {"endpoints": [sys.argv[1]]},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
    }
    with zenoh.open(zenoh.Config.from_json5(json.dumps(config))):
        print("ready", flush=True)
        sys.stdin.read()


if __name__ == "__main__":
    main()
