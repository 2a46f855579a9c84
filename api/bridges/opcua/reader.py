"""Nodes of a server that is followed: every change of theirs in order, and what was missed while it was away."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import threading
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import asynccontextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, NamedTuple

from asyncua import Client, Node, ua
from cryptography.hazmat.primitives.serialization import Encoding

from api.bridges.opcua.endpoint import (
    POLICY,
    Certificate,
    Endpoint,
    OpcUaError,
    properties_of,
    read_certificate,
    wrong,
)
from api.bridges.opcua.readings import Quality, Reading, reading_of
from station import StationError

log = logging.getLogger(__name__)

ANSWER_S = 4.0
"""A server that has not answered for so long is away [s]."""

AGAIN_S = 1.0
"""Between attempts to reach a server that is away [s]."""

PUBLISHING_MS = 200
"""A server sends changes this often [ms]."""

QUEUE_MAX = 1000
"""Changes of a node that the server keeps between two publications."""

GATHER_S = 0.2
"""Changes are handed on this often [s]."""

LOOK_S = 1.0
"""A server that is silent is asked this often whether it is there [s]."""

SLICE_S = 600.0
"""What was missed is read so much at once [s]."""

_LATER = (
    ua.StatusCodes.BadNoCommunication,
    ua.StatusCodes.BadCommunicationError,
    ua.StatusCodes.BadTimeout,
    ua.StatusCodes.BadTooManyOperations,
    ua.StatusCodes.BadOutOfService,
)
"""What a server says that can read its history later; any other refusal says that it keeps none."""


class Peer(NamedTuple):
    """A server to be followed, and who follows it."""

    endpoint: Endpoint
    password: str | None = None
    certificate: Certificate | None = None  # ours; None: without security
    server_certificate: Path | None = None  # the one that the server must have

    @classmethod
    def of(
        cls, endpoint: Endpoint, *, password: str | None = None, certificate: Certificate | None = None,
        server_certificate: Path | None = None, plaintext: bool = False,
    ) -> Peer:  # fmt: skip
        """A server at an endpoint.

        Raises
        ------
        InputError
            if it is another machine's and neither certificates nor `plaintext` are given, or one certificate alone, or
            a password without a user.
        """
        if (certificate is None) != (server_certificate is None):
            missing = "--certificate" if certificate is None else "--server-certificate"
            raise wrong(missing, "must be given, too: each side knows the other by its certificate")
        if certificate is None and not plaintext and not endpoint.is_loopback:
            raise wrong("--certificate", "must be given for another machine's server, or --plaintext")
        if password is not None and endpoint.user is None:
            raise wrong("--from", "must name a user where HRS_OPCUA_PASSWORD is set")
        if server_certificate is not None:
            read_certificate("--server-certificate", server_certificate)
        return cls(endpoint, password, certificate, server_certificate)

    @asynccontextmanager
    async def connected(self) -> AsyncIterator[Client]:
        """A session at the server, closed at the end."""
        client = self._client()
        if self.endpoint.user is not None:
            client.set_user(self.endpoint.user)
            client.set_password(self.password or "")
        if self.certificate is not None and self.server_certificate is not None:
            client.application_uri = self.certificate.application_uri  # servers refuse another than the certificate's
            await client.set_security(
                POLICY, properties_of(self.certificate.certificate), properties_of(self.certificate.private_key),
                server_certificate=properties_of(self.server_certificate),
            )  # fmt: skip
        await client.connect()
        try:
            yield client
        finally:
            with contextlib.suppress(Exception):  # of a connection that is broken already
                await asyncio.wait_for(client.disconnect(), ANSWER_S)

    async def stranger(self) -> str:
        """A text that says so where a server is there and shows another certificate than it must have; else empty."""
        if self.server_certificate is None:
            return ""
        expected = read_certificate("--server-certificate", self.server_certificate).public_bytes(Encoding.DER)
        try:
            endpoints = await asyncio.wait_for(self._client().connect_and_get_server_endpoints(), ANSWER_S)
        except Exception:  # noqa: BLE001  # asyncua raises it itself; whoever is not there shows nothing
            return ""
        shown = [endpoint.ServerCertificate for endpoint in endpoints if endpoint.ServerCertificate]
        # A certificate may come with those that have signed it behind it.
        is_known = not shown or any(each.startswith(expected) for each in shown)
        return "" if is_known else "its certificate is not that of --server-certificate"

    def _client(self) -> Client:
        client = Client(self.endpoint.url, timeout=ANSWER_S, watchdog_intervall=ANSWER_S)
        client.name = "hrs-twin"
        return client


class NodeReader:
    """Hands on the values of nodes in the order of time, each once.

    When a connection was made, what the server's history has after the last value of a node comes first.

    Parameters
    ----------
    peer
        That has the nodes.
    nodes
        Their ids by tag: `ns=2;s=...`, or `nsu=URI;s=...` with the namespace's URI.
    deliver
        Takes readings; the next come when it has them.
    silent
        Called when the server has been away for `timeout_s`, once each time.
    timeout_s
        See `silent` [s].
    last
        Time of the last reading of tags that were read before [s].
    """

    def __init__(
        self, peer: Peer, nodes: Mapping[str, str], deliver: Callable[[list[Reading]], Awaitable[None]],
        silent: Callable[[], Awaitable[None]], timeout_s: float, last: Mapping[str, float] | None = None,
    ) -> None:  # fmt: skip
        self._peer, self._nodes, self._deliver, self._silent = peer, nodes, deliver, silent
        self._timeout_s = timeout_s
        self._last = {tag: Reading(tag, at, None, Quality.GOOD) for tag, at in (last or {}).items() if tag in nodes}
        self._heard: list[Reading] = []
        self._tags: dict[ua.NodeId, str] = {}
        self._refusal = ""  # why the server has ended the subscription
        self._without_history: set[str] = set()
        self._away_since: float | None = None  # [s, monotonic]
        self.connections = 0

    def datachange_notification(self, node: Node, _value: Any, data: Any) -> None:
        """Take a change; the subscription calls it."""
        tag = self._tags.get(node.nodeid)
        if tag is not None:
            self._heard.append(reading_of(tag, data.monitored_item.Value))

    def status_change_notification(self, status: ua.StatusChangeNotification) -> None:
        """Take the end of the subscription; the subscription calls it."""
        self._refusal = str(status.Status)

    async def run(self, ending: threading.Event) -> None:
        """Read until `ending` is set.

        Raises
        ------
        OpcUaError
            if the server cannot be reached at first, refuses, or has no such node.
        """
        is_told = False
        while not ending.is_set():
            try:
                async with self._peer.connected() as client:
                    await self._follow(client, ending)
            except StationError:
                raise
            except Exception as error:  # noqa: BLE001  # asyncua raises it itself where an answer does not come
                if self.connections == 0:
                    reason = await self._peer.stranger() or str(error) or type(error).__name__
                    raise OpcUaError(f"no server can be followed at {self._peer.endpoint.url} ({reason})") from None
                if self._away_since is None:
                    log.warning("the connection to %s broke (%r)", self._peer.endpoint.url, error)
                    self._away_since, is_told = time.monotonic(), False
            if self._away_since is None:  # `ending` is set
                return
            if not is_told and time.monotonic() - self._away_since >= self._timeout_s:
                await self._silent()
                is_told = True
            await asyncio.sleep(AGAIN_S)

    async def _follow(self, client: Client, ending: threading.Event) -> None:
        """Read what was missed, then what is told, until `ending` is set or the connection breaks."""
        self._heard, self._refusal = [], ""
        nodes = {tag: await _node(client, name) for tag, name in self._nodes.items()}
        self._tags = {node.nodeid: tag for tag, node in nodes.items()}
        await self._subscribe(client, nodes)
        self.connections += 1
        await self._catch_up(nodes)
        looked = time.monotonic()
        while not ending.is_set():
            await asyncio.sleep(GATHER_S)
            heard, self._heard = self._heard, []
            await self._hand_on(heard)
            if self._refusal:
                raise ConnectionError(self._refusal)
            if time.monotonic() - looked > LOOK_S:
                await asyncio.wait_for(client.nodes.server_state.read_value(), ANSWER_S)
                looked = time.monotonic()

    async def _subscribe(self, client: Client, nodes: Mapping[str, Node]) -> None:
        """Ask for every change of the nodes, of their time alone, too."""
        subscription = await client.create_subscription(PUBLISHING_MS, self)
        every = ua.DataChangeFilter(Trigger=ua.DataChangeTrigger.StatusValueTimestamp)
        requests = [
            ua.MonitoredItemCreateRequest(
                ItemToMonitor=ua.ReadValueId(NodeId=node.nodeid, AttributeId=ua.AttributeIds.Value),
                MonitoringMode=ua.MonitoringMode.Reporting,
                RequestedParameters=ua.MonitoringParameters(
                    ClientHandle=handle, SamplingInterval=0.0, Filter=every, QueueSize=QUEUE_MAX, DiscardOldest=True
                ),
            )
            for handle, node in enumerate(nodes.values(), 1)
        ]
        for tag, made in zip(nodes, await subscription.create_monitored_items(requests), strict=True):
            if isinstance(made, ua.StatusCode):
                message = f"{self._peer.endpoint.url} does not tell {self._nodes[tag]} of tag {tag} ({made.name})"
                raise OpcUaError(message) if self.connections == 0 else ConnectionError(message)

    async def _catch_up(self, nodes: Mapping[str, Node]) -> None:
        """Hand on what the server's history has after the last readings, as far as the values that it has now."""
        known = {tag: node for tag, node in nodes.items() if tag in self._last}
        if not known:
            return
        now = [reading_of(tag, await node.read_data_value(raise_on_bad_status=False)) for tag, node in known.items()]
        end = max(reading.time for reading in now)
        begin = min(self._last[tag].time for tag in known)
        while begin < end:
            until = min(begin + SLICE_S, end)
            missed = [reading for tag, node in known.items() for reading in await self._missed(tag, node, until)]
            await self._hand_on(missed)
            begin = until

    async def _missed(self, tag: str, node: Node, until: float) -> list[Reading]:
        """What the history has of a node after its last reading, up to a time [s]."""
        begin = datetime.fromtimestamp(self._last[tag].time, UTC) + timedelta(microseconds=1)
        end = datetime.fromtimestamp(until, UTC)
        if tag in self._without_history or begin > end:
            return []
        details = ua.ReadRawModifiedDetails(
            IsReadModified=False, StartTime=begin, EndTime=end, NumValuesPerNode=0, ReturnBounds=False
        )
        found: list[Reading] = []
        point: bytes | None = None
        while True:
            try:
                page = await node.history_read(details, point)
                page.StatusCode.check()
            except ua.UaStatusCodeError as error:
                if error.code in _LATER:
                    raise
                log.warning("%s keeps no history of %s: %s", self._peer.endpoint.url, self._nodes[tag], error)
                self._without_history.add(tag)
                return []
            values = getattr(page.HistoryData, "DataValues", None) or []
            found += [reading_of(tag, value) for value in values]
            if not page.ContinuationPoint or page.ContinuationPoint == point:
                return found
            point = page.ContinuationPoint

    async def _hand_on(self, readings: list[Reading]) -> None:
        """Hand on what is new, in the order of time."""
        fresh = []
        for reading in sorted(readings, key=lambda reading: reading.time):
            last = self._last.get(reading.tag)
            is_other = last is not None and reading.time == last.time and reading.quality != last.quality
            if last is None or reading.time > last.time or is_other:
                self._last[reading.tag] = reading
                fresh.append(reading)
        if fresh:
            self._away_since = None
            await self._deliver(fresh)


async def _node(client: Client, name: str) -> Node:
    """The node of that name."""
    if not name.startswith("nsu="):
        return client.get_node(name)
    uri, _, rest = name.removeprefix("nsu=").partition(";")
    try:
        index = await client.get_namespace_index(uri)
    except ValueError:
        raise OpcUaError(f"{client.server_url.geturl()} has no namespace {uri}") from None
    return client.get_node(f"ns={index};{rest}")
