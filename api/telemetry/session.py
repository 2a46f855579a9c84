"""The service's one zenoh session: an embedded router, or a client of a router that is there."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import zenoh

from api.settings import Settings
from api.telemetry.access import Login, access_control, dictionary
from station import InputError


def open_session(settings: Settings, admitted: Sequence[Login] = ()) -> zenoh.Session:
    """Open the session; `with` closes it. Where keys are asked for, those of `admitted` are let in.

    Raises
    ------
    InputError
        if the endpoint cannot be listened on, or no router answers there.
    """
    zenoh.init_log_from_env_or("error")
    if settings.zenoh_connect is not None:
        return connect(settings.zenoh_connect, settings, "zenoh_connect")
    for name in ("zenoh_certificate", "zenoh_private_key"):
        _check_readable(name, getattr(settings, name))
    parts: dict[str, Any] = {"mode": "router", "listen": {"endpoints": [settings.zenoh_listen]}}
    tls = {"listen_certificate": settings.zenoh_certificate, "listen_private_key": settings.zenoh_private_key}
    try:
        if not settings.zenoh_keys_required:
            return zenoh.open(_config(**parts, tls=tls))
        # zenoh reads the file of users while it opens, and never again.
        with tempfile.NamedTemporaryFile("w", prefix="hrs-zenoh-") as users:  # 0600
            users.write(dictionary(admitted))
            users.flush()
            auth = {"usrpwd": {"dictionary_file": users.name}}
            return zenoh.open(_config(**parts, tls=tls, auth=auth, access_control=access_control(admitted)))
    except zenoh.ZError as error:
        message = f"{settings.zenoh_listen} cannot be listened on ({_short(error)}); choose another endpoint"
        raise InputError("settings", [("zenoh_listen", message)]) from None


def _check_readable(name: str, file: Path | None) -> None:
    try:
        if file is not None:
            file.read_bytes()
    except OSError as error:
        raise InputError("settings", [(name, f"{file} cannot be read: {error.strerror}")]) from None


def connected(session: zenoh.Session, settings: Settings) -> bool:
    """Whether the session is open and, where it is a client, its router is there."""
    return not session.is_closed() and (settings.zenoh_connect is None or bool(session.info.routers_zid()))


def connect(endpoint: str, settings: Settings | None = None, field: str = "endpoint") -> zenoh.Session:
    """A session that is a client of the router at `endpoint`, with the user and the authority that settings name.

    Raises
    ------
    InputError
        if none answers, or it refuses.
    """
    more: dict[str, Any] = {}
    if settings is not None:
        _check_readable("zenoh_ca", settings.zenoh_ca)
        more["tls"] = {"root_ca_certificate": settings.zenoh_ca}
        if settings.zenoh_user is not None:
            more["auth"] = {"usrpwd": {"user": settings.zenoh_user, "password": settings.zenoh_password or ""}}
    try:
        return zenoh.open(_config(mode="client", connect={"endpoints": [endpoint], "timeout_ms": 3000}, **more))
    except zenoh.ZError as error:
        why = "; a router that asks for keys may have refused this user, or this machine its certificate"
        asked = why if more else ""
        raise InputError("zenoh", [(field, f"no router answers at {endpoint} ({_short(error)}){asked}")]) from None


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


def _config(
    *, tls: dict[str, Path | None] | None = None, auth: dict[str, Any] | None = None, **parts: Any
) -> zenoh.Config:
    """Nothing is found by multicast or gossip; a subscriber that stands still costs a twin next to nothing."""
    queue = {
        "size": {"interactive_high": BATCHES},
        "congestion_control": {"drop": {"wait_before_drop": WAIT_US}, "block": {"wait_before_close": CLOSE_US}},
    }
    parts |= {
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "transport": {
            "link": {
                "tx": {"queue": queue},
                "tls": {name: str(file) for name, file in (tls or {}).items() if file is not None},
            },
            "auth": auth or {},
        },
    }
    return zenoh.Config.from_json5(json.dumps(parts))


def _short(error: Exception) -> str:
    return str(error).partition(" at ")[0][:200]
