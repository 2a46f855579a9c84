"""The service's one zenoh session: an embedded router on loopback, or a client of a router that is there."""

from __future__ import annotations

import json
from typing import Any

import zenoh

from api.settings import Settings
from station import InputError


def open_session(settings: Settings) -> zenoh.Session:
    """Open the session; `with` closes it.

    Raises
    ------
    InputError
        if the endpoint cannot be listened on, or no router answers there.
    """
    zenoh.init_log_from_env_or("error")
    if settings.zenoh_connect is not None:
        return connect(settings.zenoh_connect, "zenoh_connect")
    config = _config(mode="router", listen={"endpoints": [settings.zenoh_listen]})
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        message = f"{settings.zenoh_listen} cannot be listened on ({_short(error)}); choose another endpoint"
        raise InputError("settings", [("zenoh_listen", message)]) from None


def connected(session: zenoh.Session, settings: Settings) -> bool:
    """Whether the session is open and, where it is a client, its router is there."""
    return not session.is_closed() and (settings.zenoh_connect is None or bool(session.info.routers_zid()))


def connect(endpoint: str, field: str = "endpoint") -> zenoh.Session:
    """A session that is a client of the router at `endpoint`; InputError if none answers."""
    try:
        return zenoh.open(_config(mode="client", connect={"endpoints": [endpoint], "timeout_ms": 3000}))
    except zenoh.ZError as error:
        raise InputError("zenoh", [(field, f"no router answers at {endpoint} ({_short(error)})")]) from None


WAIT_US = 500
"""A sample waits so long for a full queue before it is dropped [us]: a twin at 100x has 10 000 us for each."""

CLOSE_US = 1_000_000
"""An answer waits so long for a client that takes nothing before the link is closed [us]; others' queries wait with it.

The client connects again when it goes on.
"""

PRIORITY = zenoh.Priority.INTERACTIVE_HIGH
"""Of what twins tell and of what they ask `decide`; answers have their asker's, DATA unless it says otherwise.

zenoh locks one queue for each link and priority, and an answer, which is never dropped, keeps it locked while it waits
for a client that stands still. In the same queue every sample would wait with it.
"""

BATCHES = 16
"""Batches in the queue to each subscriber, the most zenoh allows: a busy machine drops nothing before some 160 ms."""


def _config(**parts: Any) -> zenoh.Config:
    """Nothing is found by multicast or gossip; a subscriber that stands still costs a twin next to nothing."""
    queue = {
        "size": {"interactive_high": BATCHES},
        "congestion_control": {"drop": {"wait_before_drop": WAIT_US}, "block": {"wait_before_close": CLOSE_US}},
    }
    parts |= {
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "transport": {"link": {"tx": {"queue": queue}}},
    }
    return zenoh.Config.from_json5(json.dumps(parts))


def _short(error: Exception) -> str:
    return str(error).partition(" at ")[0][:200]
