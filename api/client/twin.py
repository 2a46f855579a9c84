"""A live twin of a service: operate it, read what it told, follow what it tells."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple
from urllib.parse import quote

from api.client.jobs import Forecast
from api.client.series import Series, selection
from api.client.transport import AGAIN_S, PATIENCE_S, BrokenConnectionError, Client

SILENCE_S = 10.0
"""A stream whose heartbeat, one a second, was not heard for so long is asked for again [s]."""

_ALIVE = ("running", "paused")


class Message(NamedTuple):
    """A message of a twin's stream."""

    kind: str  # sample, event, or gap: the numbers of samples that are left out; see `Twin.messages` for two more
    document: dict[str, Any]


class Sample(NamedTuple):
    """One second of a live twin."""

    epoch: int  # counts the twin's starts; a later epoch's sample replaces an earlier one's of the same number
    seq: int  # row of the record, from 0
    missed: int  # samples just before it that were told and not shown: who is late, or a fast twin, skips some
    time: float  # simulated [s]
    values: dict[str, float | None]  # by column, in the units of `Twin.history(...).units`; None: there is none


class Twin:
    """A live twin.

    Parameters
    ----------
    name
        Its id.
    client
        Of the service; left out: one by HRS_URL and HRS_API_KEY.
    """

    def __init__(self, name: str, client: Client | None = None) -> None:
        self.id = name
        self.client = Client() if client is None else client
        self.path = f"/v1/twins/{quote(name, safe='')}"

    def state(self) -> dict[str, Any]:
        """Where it stands: state, newest sample, controller, how punctual it is.

        Raises
        ------
        ServiceError
            if there is none of that id, or the service does not answer.
        """
        found: dict[str, Any] = self.client.get(self.path)
        return found

    def change(self, **changes: Any) -> dict[str, Any]:
        """Change `speed` (1 to 1000, or "max"), `controller` or `paused`, all of it or nothing; its state."""
        found: dict[str, Any] = self.client.patch(self.path, changes)
        return found

    def add_vehicle(self, start_pressure_bar: float, **vehicle: float) -> dict[str, Any]:
        """Let a vehicle arrive: with start_temperature_c, volume_m3, finish_pressure_bar, or the usual; its state."""
        found: dict[str, Any] = self.client.post(
            f"{self.path}/vehicles", {"start_pressure_bar": start_pressure_bar, **vehicle}
        )
        return found

    def stop(self) -> dict[str, Any]:
        """End it for good; what it told stays."""
        found: dict[str, Any] = self.client.post(f"{self.path}/stop")
        return found

    def delete(self) -> None:
        """Have it forgotten with all it told; it must have ended."""
        self.client.delete(self.path)

    def history(
        self, columns: Sequence[str] = (), *, from_s: float | None = None, to_s: float | None = None,
        step_s: float | None = None, extremes: bool = False, last_s: int | None = None,
    ) -> Series:  # fmt: skip
        """What it has told, or the columns, span [s] and step [s] of it that are asked for; see `Run.series`.

        With `last_s` in place of a span the newest seconds alone.
        """
        query = selection(list(columns), from_s, to_s, step_s, extremes=extremes)
        return Series(self.client.read(f"{self.path}/history", **query, last_s=last_s))

    def events(self, after: int = -1) -> Iterator[dict[str, Any]]:
        """Its events behind a number, in order."""
        return self.client.pages(f"{self.path}/events", after=after)

    def days(self) -> list[dict[str, Any]]:
        """Figures of the running day and of those before, the oldest first."""
        found: list[dict[str, Any]] = self.client.get(f"{self.path}/days")["items"]
        return found

    def figures(
        self, *, from_s: int | None = None, to_s: int | None = None, by: str = "window", shift_h: int | None = None
    ) -> list[dict[str, Any]]:  # fmt: skip
        """Figures of a stretch of its record [s], whole or cut `by` hour, shift or day: a dict a window, in order.

        `shift_h` is the length of a shift [h], if not the station's.
        """
        query = {"from_s": from_s, "to_s": to_s, "by": by, "shift_h": shift_h}
        found: list[dict[str, Any]] = self.client.get(f"{self.path}/figures", **query)["items"]
        return found

    def report(
        self, *, from_s: int | None = None, to_s: int | None = None, by: str = "shift", shift_h: int | None = None
    ) -> str:  # fmt: skip
        """A stretch of its record [s] as a self-contained HTML page that prints on A4; `shift_h` as for `figures`."""
        query = {"from_s": from_s, "to_s": to_s, "by": by, "shift_h": shift_h}
        return self.client.read(f"{self.path}/report", **query).decode()

    def notes(self, *, from_s: float | None = None, to_s: float | None = None) -> list[dict[str, Any]]:
        """The notes on it, or those on a stretch of its time [s], in the order of their times."""
        found: list[dict[str, Any]] = self.client.get(f"{self.path}/notes", from_s=from_s, to_s=to_s)["items"]
        return found

    def note(self, text: str, time_s: float, to_s: float | None = None) -> dict[str, Any]:
        """Write a note on a time, or a stretch of time [s]; the note."""
        document = {"text": text, "time_s": time_s, "to_s": to_s}
        found: dict[str, Any] = self.client.post(f"{self.path}/notes", document)
        return found

    def delete_note(self, name: str) -> None:
        """Have the note of that id forgotten."""
        self.client.delete(f"{self.path}/notes/{quote(name, safe='')}")

    def alarms(self, *, every: bool = False) -> dict[str, Any]:
        """Its alarms, the most urgent first, and how often they come; `every`: those that are normal, too."""
        found: dict[str, Any] = self.client.get(f"{self.path}/alarms", all="true" if every else "false")
        return found

    def act_on_alarm(self, name: str, action: str, **more: Any) -> dict[str, Any]:
        """Do something with an alarm: acknowledge (raised_s), shelve (for_s, reason), ...; the alarm then."""
        document = {"action": action, **more}
        found: dict[str, Any] = self.client.post(f"{self.path}/alarms/{quote(name, safe='')}", document)
        return found

    def drills(self, followed_by: str | None = None) -> dict[str, Any]:
        """The faults of its station; with `followed_by`, how that twin has found them."""
        query = {} if followed_by is None else {"followed_by": followed_by}
        found: dict[str, Any] = self.client.get(f"{self.path}/drills", **query)
        return found

    def drill(self, **fault: Any) -> dict[str, Any]:
        """Put a fault into its station: kind, begin_s, end_s and what the kind needs; its drills then."""
        found: dict[str, Any] = self.client.post(f"{self.path}/drills", fault)
        return found

    def forecast(self, controllers: Sequence[str], **request: Any) -> Forecast:
        """Fork it into futures; `request` has the other fields of `POST /v1/twins/{id}/forecasts`."""
        asked = {"controllers": list(controllers), **request}
        return Forecast(self.client, self.client.post(f"{self.path}/forecasts", asked))

    def shadow(self, stretches: int = 24) -> dict[str, Any]:
        """What its shadows would have made of its days, and of at most so many stretches."""
        found: dict[str, Any] = self.client.get(f"{self.path}/shadow", limit=stretches)
        return found

    def set_shadow(self, controllers: Sequence[str], **request: Any) -> dict[str, Any]:
        """Hold controllers against the one that acts; `request` has every_s, horizon_s, prices. What is known."""
        found: dict[str, Any] = self.client.put(f"{self.path}/shadow", {"controllers": list(controllers), **request})
        return found

    def end_shadow(self) -> None:
        """Hold nobody against the one that acts any more; what was found stays."""
        self.client.delete(f"{self.path}/shadow")

    def samples(self) -> Iterator[Sample]:
        """Its seconds as they are told, from the newest on, until it ends; at most ten a second.

        A connection that breaks is made again, and goes on behind what was shown. See `messages` for errors.
        """
        missed = 0
        for kind, document in self.messages():
            if kind == "gap":
                missed += document["last"] - document["first"] + 1
            elif kind == "sample":
                values = document["values"]
                yield Sample(document["epoch"], document["seq"], missed, values["time"], values)
                missed = 0

    def messages(self, *, heartbeats: bool = False) -> Iterator[Message]:
        """Its samples, events and gaps as they are told, until it ends.

        With `heartbeats` also a `heartbeat` a second, which has its `state`, and `broken` whenever the stream has ended
        or its connection broke: what was told before is then not known to be the newest.

        Raises
        ------
        ServiceError
            if there is no such twin, or the service has not answered for PATIENCE_S.
        """
        last, until = "", time.monotonic() + PATIENCE_S
        while True:
            try:
                headers = {"Last-Event-ID": last} if last else {}
                with self.client.stream(f"{self.path}/stream", headers, SILENCE_S) as lines:
                    for message, place in _told(lines):
                        last, until = place, time.monotonic() + PATIENCE_S
                        if heartbeats or message.kind != "heartbeat":
                            yield message
            except BrokenConnectionError as error:
                if time.monotonic() + AGAIN_S > until:
                    raise
                if heartbeats:
                    yield Message("broken", {"detail": str(error)})
                time.sleep(AGAIN_S)
                continue
            if heartbeats:
                yield Message("broken", {"detail": "the stream has ended"})
            if self.state()["state"] not in _ALIVE:
                return
            time.sleep(AGAIN_S)

    def __repr__(self) -> str:
        return f"Twin({self.id!r})"


def _told(lines: Iterator[str]) -> Iterator[tuple[Message, str]]:
    """Messages of server-sent events, each with its id, as the service writes them: one line a field."""
    fields: dict[str, str] = {}
    for line in lines:
        if line:
            name, _, value = line.partition(": ")
            fields[name] = value
        elif "data" in fields:
            yield Message(fields["event"], json.loads(fields["data"])), fields.get("id", "")
            fields = {}
