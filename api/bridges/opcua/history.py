"""HistoryRead answered from the history that the service keeps: raw values of variables, page after page."""

from __future__ import annotations

import asyncio
import math
import re
from concurrent.futures import ThreadPoolExecutor
from datetime import datetime
from typing import Any, NamedTuple, Protocol

from asyncua import ua
from asyncua.server.history import HistoryManager
from asyncua.server.internal_server import InternalServer

from api.bridges.opcua.clock import TwinClock
from api.bridges.opcua.variables import Variable
from api.client import Twin
from api.client.series import Series
from station import StationError

PAGE_MAX = 10_000
"""Values of a variable in one answer."""

WINDOW_S = 2000
"""Seconds that are read at once, at least: older ones may be kept a row a minute, or not at all [s]."""

READERS = 4
"""Reads of the service at once; more wait."""

_POINT = re.compile(rb"[0-9]{1,10}")

_UNSUPPORTED = ua.StatusCodes.BadHistoryOperationUnsupported


class Past(Protocol):
    """A twin whose past can be read."""

    twin: Twin
    clock: TwinClock
    newest: int  # its newest second

    @property
    def is_reachable(self) -> bool:
        """Whether the service tells of it at present."""


class Stretch(NamedTuple):
    """What is asked for: seconds of a twin, both included, and in which order."""

    first: int
    last: int
    backwards: bool
    most: int  # values

    @classmethod
    def of(cls, past: Past, details: ua.ReadRawModifiedDetails) -> Stretch:
        """The stretch that a request names: two of its begin, its end and its number of values are needed.

        Raises
        ------
        ValueError
            if there are fewer.
        """
        begin, end = _given(details.StartTime), _given(details.EndTime)
        if begin is None and (end is None or not details.NumValuesPerNode):
            raise ValueError("two of begin, end and number are needed")
        backwards = begin is None or (end is not None and begin > end)
        low, high = (end if begin is not None else None, begin or end) if backwards else (begin, end)
        first = 0 if low is None else max(0, math.ceil(past.clock.second(low)))
        last = past.newest if high is None else min(past.newest, math.floor(past.clock.second(high)))
        return cls(first, last, backwards, min(details.NumValuesPerNode or PAGE_MAX, PAGE_MAX))

    def after(self, point: bytes) -> Stretch:
        """What is left of it from the second of a continuation point on.

        Raises
        ------
        ValueError
            if that is none of ours.
        """
        if not _POINT.fullmatch(point):
            raise ValueError("no continuation point of this server")
        second = int(point)
        return self._replace(last=second) if self.backwards else self._replace(first=second)


def prepare() -> None:
    """Load the libraries that read a history, before anybody is connected.

    Loaded by the first request they would stop every client for more than a second, and clients that look each second
    whether the server is there would leave.
    """
    import pyarrow as pa
    from pyarrow import parquet

    written = pa.BufferOutputStream()
    parquet.write_table(pa.table({"time": [0.0]}), written)
    Series(written.getvalue().to_pybytes()).numpy()


class ServiceHistory(HistoryManager):  # type: ignore[misc]  # asyncua is Any here
    """Answers HistoryRead for the variables that are given to it."""

    def __init__(self, server: InternalServer) -> None:
        super().__init__(server)
        self._pool = ThreadPoolExecutor(READERS, thread_name_prefix="history")
        self._variables: dict[ua.NodeId, tuple[Past, Variable]] = {}

    def add(self, past: Past, variables: dict[ua.NodeId, Variable]) -> None:
        """Answer for the variables of a twin."""
        self._variables.update({node_id: (past, variable) for node_id, variable in variables.items()})

    async def stop(self) -> None:
        """Answer nothing more."""
        self._pool.shutdown(wait=False, cancel_futures=True)
        await super().stop()

    async def read_history(self, params: ua.HistoryReadParameters) -> list[ua.HistoryReadResult]:
        """The answer to a request: a result for each of its nodes."""
        if params.ReleaseContinuationPoints:  # there is nothing to release: they name a second
            return [ua.HistoryReadResult() for _ in params.NodesToRead]
        details = params.HistoryReadDetails
        return [await self._read(node, details) for node in params.NodesToRead]

    async def _read(self, node: ua.HistoryReadValueId, details: Any) -> ua.HistoryReadResult:
        found = self._variables.get(node.NodeId)
        if found is None or not isinstance(details, ua.ReadRawModifiedDetails) or details.IsReadModified:
            return _refused(_UNSUPPORTED)
        past, variable = found
        try:
            stretch = Stretch.of(past, details)
        except ValueError:
            return _refused(ua.StatusCodes.BadHistoryOperationInvalid)
        try:
            stretch = stretch.after(node.ContinuationPoint) if node.ContinuationPoint else stretch
        except ValueError:
            return _refused(ua.StatusCodes.BadContinuationPointInvalid)
        if not past.is_reachable:
            return _refused(ua.StatusCodes.BadNoCommunication)
        loop = asyncio.get_running_loop()
        try:
            values, rest = await loop.run_in_executor(self._pool, read, past, variable, stretch)
        except StationError:
            return _refused(ua.StatusCodes.BadNoCommunication)
        result = ua.HistoryReadResult(HistoryData=ua.HistoryData(values))
        if rest is not None:
            result.ContinuationPoint = str(rest).encode()
        return result


def read(past: Past, variable: Variable, stretch: Stretch) -> tuple[list[ua.DataValue], int | None]:
    """Values of a stretch of a twin's history, and the second from which on it has more."""
    found: list[tuple[float, float]] = []
    at, step = (stretch.last, -1) if stretch.backwards else (stretch.first, 1)
    while stretch.first <= at <= stretch.last and len(found) <= stretch.most:
        to = at + step * (max(WINDOW_S, stretch.most - len(found)) - 1)
        low, high = max(min(at, to), stretch.first), min(max(at, to), stretch.last)
        series = past.twin.history([variable.name], from_s=low, to_s=high)
        rows = list(zip(series["time"].tolist(), series[variable.name].tolist(), strict=True))
        found += rows[::step]
        at = to + step
    rest = int(found[stretch.most][0]) if len(found) > stretch.most else None
    moments = [(past.clock.moment(second), figure) for second, figure in found[: stretch.most]]
    return [variable.value(figure, moment, moment) for moment, figure in moments], rest


def _given(moment: datetime | None) -> datetime | None:
    """A moment of a request; None where it names none, which is the beginning of OPC UA's time."""
    return None if moment is None or moment == ua.get_win_epoch() else moment


def _refused(code: int) -> ua.HistoryReadResult:
    return ua.HistoryReadResult(StatusCode=ua.StatusCode(code))
