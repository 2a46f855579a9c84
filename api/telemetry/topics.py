"""The key expressions of telemetry, in one place. docs/telemetry.md explains them."""

from __future__ import annotations

ROOT = "hrs/v1"


def key(twin: str, *parts: str) -> str:
    """`hrs/v1/{twin}/...`."""
    return "/".join((ROOT, twin, *parts))


SAMPLE, SIGNAL, EVENT, ALARMS, ALIVE, HISTORY, COMMAND, MEASUREMENT, DECIDE = (
    "sample", "signal", "event", "alarms", "alive", "history", "command", "measurement", "decide",
)  # fmt: skip
