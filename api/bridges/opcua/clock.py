"""The clock of a twin: which moment a second of it has as SourceTimestamp."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import Any, NamedTuple

UNIX_MIN = 1e9
"""A time of measurements below this is no Unix time [s]."""

_SECOND = timedelta(seconds=1)


class TwinClock(NamedTuple):
    """Moments of a twin's seconds: those of its measurements, or of a simulation that began when it was started.

    A second has one moment, whenever it is told or read again.
    """

    origin: datetime  # of second 0

    @classmethod
    def of(cls, created: str, values: dict[str, Any] | None) -> TwinClock:
        """The clock of a twin that was started at `created`, as one of its samples says where it says more."""
        source = (values or {}).get("source_time")
        if values is not None and source is not None and source > UNIX_MIN:
            return cls(datetime.fromtimestamp(source, UTC) - timedelta(seconds=values["time"]))
        return cls(datetime.fromisoformat(created).astimezone(UTC))

    def moment(self, second: float) -> datetime:
        """The moment of a second."""
        return self.origin + timedelta(seconds=second)

    def second(self, moment: datetime) -> float:
        """The second of a moment."""
        return (moment - self.origin) / _SECOND
