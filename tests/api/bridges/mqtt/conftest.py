"""A real broker: mosquitto, started by the tests on a port of its own, killed and started again."""

from __future__ import annotations

import shutil
import socket
import subprocess
import threading
from pathlib import Path

import pytest
from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion

from tests.api.conftest import free_port
from tests.waiting import wait_until

MOSQUITTO = shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin:/usr/local/sbin")


class Mosquitto:
    """A broker that keeps its sessions in a folder."""

    def __init__(self, folder: Path, *lines: str) -> None:
        self.port = free_port()
        self.url = f"mqtt://127.0.0.1:{self.port}"
        self._config = folder / "mosquitto.conf"
        kept = ("persistence true", f"persistence_location {folder}/", "autosave_interval 1")
        allowed = () if any(line.startswith("allow_anonymous") for line in lines) else ("allow_anonymous true",)
        text = [f"listener {self.port} 127.0.0.1", *kept, *allowed, *lines, "max_queued_messages 100000", "user root"]
        self._config.write_text("\n".join(text) + "\n")
        self.start()

    def start(self) -> None:
        """Start it, and wait until it listens."""
        self.process = subprocess.Popen([MOSQUITTO, "-c", self._config], stderr=subprocess.DEVNULL)
        wait_until(self._listens)

    def _listens(self) -> bool:
        with socket.socket() as probe:
            return probe.connect_ex(("127.0.0.1", self.port)) == 0

    def kill(self) -> None:
        """As a power cut would."""
        self.process.kill()
        self.process.wait()

    def stop(self) -> None:
        """In order: what it holds is on the disk."""
        self.process.terminate()
        self.process.wait()


class Listener:
    """A client of the broker that keeps what it is sent; nothing of it is the product's."""

    def __init__(self, broker: Mosquitto, topic: str, name: str = "listener") -> None:
        self.heard: list[tuple[str, bytes, bool]] = []  # topic, payload, whether the broker says that it came before
        self._topic = topic
        self._subscribed = threading.Event()
        self.client = Client(CallbackAPIVersion.VERSION2, client_id=name, clean_session=False)
        self.client.on_connect = lambda client, *_: client.subscribe(topic, 1)
        self.client.on_subscribe = lambda *_: self._subscribed.set()
        self.client.on_message = lambda _client, _data, told: self.heard.append((told.topic, told.payload, told.dup))
        self.client.reconnect_delay_set(1, 1)
        self.client.connect("127.0.0.1", broker.port, 5)
        self.client.loop_start()
        assert self._subscribed.wait(10)

    def close(self) -> None:
        self.client.disconnect()
        self.client.loop_stop()
        if self.client.socket() is not None:
            self.client.socket().close()


@pytest.fixture
def broker(tmp_path):
    """A broker that lets everybody in."""
    if MOSQUITTO is None:
        pytest.skip("mosquitto is not installed")
    started = Mosquitto(tmp_path)
    yield started
    if started.process.poll() is None:
        started.stop()
