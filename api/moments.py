"""Moments as every face writes them: ISO 8601 in UTC, ending in Z."""

from __future__ import annotations

from datetime import UTC, datetime


def moment(seconds: float | None) -> datetime | None:
    """A Unix time [s] as a moment in UTC."""
    return None if seconds is None else datetime.fromtimestamp(seconds, UTC)


def written(seconds: float, timespec: str = "auto") -> str:
    """A Unix time [s] as text; `timespec` as of `datetime.isoformat`."""
    return datetime.fromtimestamp(seconds, UTC).isoformat(timespec=timespec).removesuffix("+00:00") + "Z"
