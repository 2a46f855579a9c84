"""Those who operate twins: one sends vehicles, one steers a twin, one starts, stops and deletes guests.

Each twin has one operator, who notes what was acknowledged (`obeyed`, and what it wants of the twin: None that it be
gone) and what it sees (`looked`) before it asks for more.
"""

from __future__ import annotations

import random
import threading
from typing import Any

from tests.nemesis.arena import until
from tests.nemesis.client import Client, Request
from tests.nemesis.requests import CONTROLLERS, few

STEERED = "steered"

SPEEDS = {"calm": 8, "hasty": 40, STEERED: 20}
"""Simulated seconds a second: the first is seen whole on the event stream, the second is not."""

TWINS = tuple(SPEEDS)
"""Those that live from the first fault to the last."""

GUESTS = tuple(f"guest-{number}" for number in range(6))
"""Those that come and go."""

PACE_S = 0.5
"""An operator thinks so long between two requests on the average [s]."""


def a_twin(name: str) -> Request:
    """A twin that never comes to an end by itself."""
    controller, speed = ("minlp1", SPEEDS[name]) if name in SPEEDS else ("logic", 10)
    return {"id": name, "scenario": few(3, 0), "controller": controller, "speed": speed, "at_end": "repeat"}


def start(client: Client, name: str, key: str) -> None:
    """Start a twin, under a key."""
    request = a_twin(name)
    client.post(key, "/v1/twins", request)
    client.history.note("obeyed", twin=name, wants=_settings(request))


def _settings(request: Request) -> dict[str, Any]:
    return {"state": "running", "controller": request["controller"], "speed": request["speed"]}


def send(client: Client, chance: random.Random, ending: threading.Event) -> None:
    """Let vehicles arrive at two twins; without a key, they are sent again or not as it happens."""
    number = 0
    while not ending.is_set():
        path = f"/v1/twins/{chance.choice(('calm', 'hasty'))}/vehicles"
        vehicle = {"start_pressure_bar": 100 + number / 64}  # by which its event is known
        if chance.random() < 0.5:
            client.post(f"vehicle-{number}", path, vehicle)
        else:
            _send_without_key(client, chance, path, vehicle)
        number += 1
        ending.wait(chance.expovariate(1 / PACE_S))


def _send_without_key(client: Client, chance: random.Random, path: str, vehicle: Request) -> None:
    again = True
    while again:
        client.history.note("sent", path=path, request=vehicle)
        arrived = client.try_once(lambda: client.http.post(path, json=vehicle))
        if arrived:
            client.history.note("arrived", path=path, request=vehicle)
        again = not arrived and chance.random() < 0.5


def steer(client: Client, chance: random.Random, ending: threading.Event) -> None:
    """Change a twin's speed and controller, let it stand and go on; never twice the same."""
    number, seated, paused = 0, a_twin(STEERED)["controller"], False
    while not ending.is_set():
        client.look(STEERED)
        kind = chance.choice(("paused", "paused", "speed", "controller"))
        if kind == "paused":
            paused = not paused
            change: Request = {"paused": paused}
        elif kind == "speed":
            change = {"speed": chance.choice((10, 20, 30)) + number / 64}  # by which its event is known
        else:
            seated = chance.choice([controller for controller in CONTROLLERS if controller != seated])
            change = {"controller": seated}
        _change(client, change)
        number += 1
        ending.wait(chance.expovariate(1 / PACE_S))
    until(lambda: client.look(STEERED), "nobody says where the steered twin stands")


def _change(client: Client, change: Request) -> None:
    wants = {"state": "paused" if change["paused"] else "running"} if "paused" in change else change
    client.until("obeyed", lambda: client.http.patch(f"/v1/twins/{STEERED}", json=change), twin=STEERED, wants=wants)


def stop(client: Client, twin: str) -> None:
    """End a twin."""
    client.until("obeyed", lambda: client.http.post(f"/v1/twins/{twin}/stop"), twin=twin, wants={"state": "stopped"})


def host(client: Client, chance: random.Random, ending: threading.Event) -> None:
    """Start a guest that is not there, stop one that is, delete one that has been stopped."""
    stands = dict.fromkeys(GUESTS, "gone")
    number = 0
    while not ending.is_set():
        guest = chance.choice(GUESTS)
        client.look(guest)
        if stands[guest] == "gone":
            start(client, guest, f"{guest}-{number}")
            stands[guest] = "running"
        elif stands[guest] == "running":
            stop(client, guest)
            stands[guest] = "stopped"
        else:
            path = f"/v1/twins/{guest}"
            client.until("obeyed", lambda path=path: client.http.delete(path), gone=True, twin=guest, wants=None)
            stands[guest] = "gone"
        number += 1
        ending.wait(chance.expovariate(1 / PACE_S))
