"""The key expressions of telemetry, in one place. docs/telemetry.md explains them."""

from __future__ import annotations

ROOT = "hrs/v1"


def key(twin: str, *parts: str) -> str:
    """`hrs/v1/{twin}/...`."""
    return "/".join((ROOT, twin, *parts))


SAMPLE, SIGNAL, EVENT, ALIVE, HISTORY, COMMAND, DECIDE = (
    "sample", "signal", "event", "alive", "history", "command", "decide",
)  # fmt: skip
