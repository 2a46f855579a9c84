"""Measurements from an OPC UA server, stored for a measured twin, without a hole where the server keeps history."""

from __future__ import annotations

import asyncio
import json
import threading
import time
from dataclasses import dataclass
from pathlib import Path

import orjson
from asyncua import ua

from api.bridges.measurements import ROWS_MAX, MeasurementSender
from api.bridges.opcua.endpoint import wrong
from api.bridges.opcua.reader import NodeReader, Peer
from api.bridges.opcua.readings import Holding, Quality, Reading
from api.client import Client
from api.files import write_whole
from station import InputError
from station.measurement import TagMap


@dataclass
class Counts:
    """Readings since the start."""

    stored: int = 0
    silences: int = 0  # how often the server was away for longer than the timeout


def nodes_of(tags: TagMap) -> dict[str, str]:
    """The nodes of the tags that have one, by tag.

    Raises
    ------
    InputError
        if none has one, one is no node's id, or two have the same.
    """
    found: dict[str, str] = {}
    for place, tag in enumerate(tags.tags):
        if tag.node is None:
            continue
        try:
            ua.NodeId.from_string(tag.node)
        except ua.UaError:
            message = f"must be the id of a node, as ns=2;s=PT-101 or nsu=URI;s=PT-101; given {tag.node!r:.100}"
            raise InputError("tags", [(f"tags[{place}].node", message)]) from None
        if tag.node in found.values():
            raise InputError("tags", [(f"tags[{place}].node", f"must be no other tag's; given {tag.node!r:.100}")])
        found[tag.tag] = tag.node
    if not found:
        raise wrong("--tags", "must give at least one tag a node")
    return found


class Follower:
    """Stores the values of a server's nodes as readings of a measured twin.

    Parameters
    ----------
    client
        Of the service.
    twin
        Id of the twin.
    peer
        The server.
    tags
        The twin's tags, of which those with a node are read.
    source
        Under which name the service counts batches.
    timeout_s
        After so long without the server its readings are bad [s].
    file
        Keeps up to where each tag is stored: the next start goes on there. Left out: a start begins with the values
        that the server has then.

    Raises
    ------
    StationError
        if there is no such measured twin, the service does not answer, or tags or file are wrong.
    """

    def __init__(
        self, client: Client, twin: str, peer: Peer, tags: TagMap, source: str, timeout_s: float,
        file: Path | None = None,
    ) -> None:  # fmt: skip
        nodes = nodes_of(tags)
        self._file = file
        self._times = _kept(file)
        self._sender = MeasurementSender(client, twin, source)
        self._tags = tuple(nodes)
        self._holding = Holding()
        self._reader = NodeReader(peer, nodes, self._deliver, self._silent, timeout_s, self._times)
        self.counts = Counts()

    @property
    def connections(self) -> int:
        """How often a connection to the server was made."""
        return self._reader.connections

    def run(self, ending: threading.Event) -> None:
        """Store what comes, until `ending` is set.

        Raises
        ------
        StationError
            if the service refuses, or the server does or cannot be reached at first.
        """
        with asyncio.Runner() as runner:
            runner.run(self._reader.run(ending))

    async def _deliver(self, readings: list[Reading]) -> None:
        await asyncio.to_thread(self._store, self._holding.push(readings))
        self._times |= {reading.tag: reading.time for reading in readings}
        self._keep()

    async def _silent(self) -> None:
        """Say that nothing is known of the station now."""
        now = time.time()
        self.counts.silences += 1
        await asyncio.to_thread(self._store, [Reading(tag, now, None, Quality.BAD) for tag in self._tags])

    def _store(self, readings: list[Reading]) -> None:
        for begin in range(0, len(readings), ROWS_MAX):
            rows = [reading.row() for reading in readings[begin : begin + ROWS_MAX]]
            self._sender.send(rows)
            self.counts.stored += len(rows)

    def _keep(self) -> None:
        if self._file is not None:
            write_whole(self._file, orjson.dumps(self._times))


def _kept(file: Path | None) -> dict[str, float]:
    """Up to where each tag was stored, as a file keeps it [s]; nothing where there is none.

    Raises
    ------
    InputError
        if the file cannot be read.
    """
    if file is None or not file.exists():
        return {}
    try:
        return {str(tag): float(at) for tag, at in json.loads(file.read_text(encoding="utf-8")).items()}
    except (ValueError, TypeError, AttributeError, OSError) as error:
        raise InputError(str(file), [("", f"cannot be read: {error!r}")]) from None
