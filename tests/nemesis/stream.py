"""A browser on a twin's event stream."""

from __future__ import annotations

import json
import threading

import httpx

from tests.nemesis.arena import PATIENCE_S
from tests.nemesis.history import History


class Stream:
    """Listens to a twin, and comes again with Last-Event-ID whenever it is cut off."""

    def __init__(self, url: str, twin: str, history: History) -> None:
        self.twin = twin
        self._url, self._history = url, history
        self._ending = threading.Event()
        self._last = ""
        self.seen = -1  # number of the last event
        self._thread = threading.Thread(target=self._run, name=f"stream of {twin}", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def stop(self) -> None:
        """Hear no more."""
        self._ending.set()
        self._thread.join(PATIENCE_S)

    def _run(self) -> None:
        while not self._ending.is_set():
            headers = {"last-event-id": self._last} if self._last else {}
            path = f"{self._url}/v1/twins/{self.twin}/stream"
            try:
                with httpx.stream("GET", path, headers=headers, timeout=5, trust_env=False) as answer:
                    if answer.is_success:
                        self._history.note("connected", twin=self.twin, after=self._last)
                        self._listen(answer)
            except httpx.HTTPError:
                pass
            self._ending.wait(0.1)

    def _listen(self, answer: httpx.Response) -> None:
        fields: dict[str, str] = {}
        for line in answer.iter_lines():
            if self._ending.is_set():
                return
            if line:
                name, _, value = line.partition(": ")
                fields[name] = value
                continue
            if "data" in fields:
                self._history.note(f"streamed {fields.get('event', '')}", document=json.loads(fields["data"]))
                self._last = fields["id"]
                if fields["event"] == "event":
                    self.seen = json.loads(fields["data"])["seq"]
            fields = {}
