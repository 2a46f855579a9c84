"""A broker: its address, who is asked for there, and the connection to it, made again whenever it breaks."""

from __future__ import annotations

import ssl
from pathlib import Path
from typing import NamedTuple
from urllib.parse import urlsplit

from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion, MQTTProtocolVersion

from api.settings import is_loopback
from station import InputError, StationError

PORTS = {"mqtt": 1883, "mqtts": 8883}
"""Schemes of a broker's address, without and with TLS, and the port of each."""

KEEPALIVE_S = 10
"""A connection on which nothing was heard for one and a half times as long is broken [s]."""

AGAIN_MAX_S = 5
"""A broker that is away is asked for again at least this often [s]."""

CONNECT_S = 10.0
"""A broker that has not answered for so long is given up, at first, or for now [s]."""

IN_FLIGHT_MAX = 1000
"""Messages sent and not yet acknowledged."""


class BrokerError(StationError):
    """A broker refuses the connection, or cannot be reached at first."""


class Broker(NamedTuple):
    """The address of a broker."""

    host: str
    port: int
    tls: bool
    user: str | None = None
    password: str | None = None
    ca: Path | None = None  # PEM authority that signed its certificate; None: the public ones

    @classmethod
    def parse(
        cls, url: str, *, password: str | None = None, ca: Path | None = None, plaintext: bool = False
    ) -> Broker:  # fmt: skip
        """The broker at `mqtt://[user@]host[:port]`, or `mqtts://...` with TLS.

        Raises
        ------
        InputError
            if the address has another form, holds a password, or is another machine's without TLS and without
            `plaintext`.
        """
        parts = urlsplit(url)
        if parts.password is not None:
            raise _wrong("must hold no password: others of this machine can see it; set HRS_MQTT_PASSWORD")
        try:
            port = parts.port
        except ValueError:
            port = -1
        if parts.scheme not in PORTS or not parts.hostname or parts.path.strip("/") or port == -1:
            raise _wrong(f"must be mqtt://[user@]host[:port] or mqtts://[user@]host[:port]; given {url!r:.100}")
        tls = parts.scheme == "mqtts"
        if not tls and not plaintext and not is_loopback(parts.hostname):
            raise _wrong(f"must be mqtts:// to another machine, or --plaintext be given; given {url!r:.100}")
        if password is not None and parts.username is None:
            raise _wrong("must name a user where HRS_MQTT_PASSWORD is set")
        return cls(parts.hostname, port or PORTS[parts.scheme], tls, parts.username, password, ca)


def _wrong(message: str) -> InputError:
    return InputError("broker", [("URL", message)])


def client_of(
    broker: Broker, name: str, *, manual_ack: bool = False, keeps_session: bool = True, reconnects: bool = True
) -> Client:  # fmt: skip
    """A client called `name` of a broker, not connected yet.

    A session that is kept stays at the broker while the client is away: what is in flight is sent again, flagged as a
    duplicate, and what was subscribed to waits for it, as long as the broker keeps sessions.
    """
    client = Client(
        CallbackAPIVersion.VERSION2, client_id=name, clean_session=not keeps_session,
        protocol=MQTTProtocolVersion.MQTTv311, manual_ack=manual_ack, reconnect_on_failure=reconnects,
    )  # fmt: skip
    client.max_inflight_messages_set(IN_FLIGHT_MAX)
    client.max_queued_messages_set(0)  # who sends keeps count
    client.reconnect_delay_set(1, AGAIN_MAX_S)
    if broker.user is not None:
        client.username_pw_set(broker.user, broker.password)
    if broker.tls:
        client.tls_set_context(ssl.create_default_context(cafile=None if broker.ca is None else str(broker.ca)))
    return client


def connect(client: Client, broker: Broker) -> None:
    """Connect for the first time, and let a thread of its own keep the connection from then on.

    Raises
    ------
    BrokerError
        if nobody answers there, or not as a broker with such a certificate.
    """
    try:
        client.connect(broker.host, broker.port, KEEPALIVE_S)
    except (OSError, ssl.SSLError) as error:
        raise BrokerError(f"no broker answers at {broker.host}:{broker.port} ({error})") from None
    client.loop_start()


def disconnect(client: Client) -> None:
    """Leave in order, end the client's thread, and close what a broken or refused connection has left open."""
    client.disconnect()
    client.loop_stop()
    left = client.socket()
    if left is not None:
        left.close()
