"""The command `send`: a record goes to a measured twin, as its station would send it."""

from __future__ import annotations

import hashlib
import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any
from urllib.parse import quote

import typer

from api.cli.follow import RecordArgument, TagsOption
from api.cli.options import CaOption, UrlOption, UserOption, check_source

if TYPE_CHECKING:
    from station.batches import Batch
    from station.measurement import TagMap

BATCH_S = 600.0
"""Seconds of a batch that is sent as fast as it is taken [s]."""

BATCH_TIMED_S = 1.0
"""Seconds of a batch that is sent by the clock [s]."""

_CONFLICT = "the same --batch, --start, --tags and record go on with it; other ones need another --source"


@dataclass(frozen=True)
class _Way:
    """How batches reach the service."""

    sources: Callable[[], dict[str, int]]  # highest sequence of each
    send: Callable[[str, int, bytes], dict[str, Any]]  # source, sequence, content


def send(
    record: RecordArgument,
    tags: TagsOption,
    twin: Annotated[str, typer.Option(metavar="ID", help="a live measured twin")],
    start: Annotated[
        float | None, typer.Option(metavar="SECONDS", help="leave out what is earlier, in the record's time")
    ] = None,
    speed: Annotated[
        float | None,
        typer.Option(metavar="X", help="seconds of the record a second; default as fast as the twin takes them"),
    ] = None,
    batch: Annotated[
        float | None,
        typer.Option(metavar="SECONDS", help="of the record in a batch; default 600, with --speed 1"),
    ] = None,
    source: Annotated[
        str | None, typer.Option(metavar="NAME", help="who sends; default record- and a digest of the record")
    ] = None,
    url: UrlOption = None,
    endpoint: Annotated[
        str | None,
        typer.Option("--endpoint", metavar="ENDPOINT", help="zenoh router, e.g. tcp/127.0.0.1:7447; default over REST"),
    ] = None,
    user: UserOption = None,
    ca: CaOption = None,
) -> None:
    """Send a record to a live measured twin; sent again it goes on where it was interrupted, and nothing counts twice.

    A key is read from HRS_API_KEY, a zenoh user's password from HRS_ZENOH_PASSWORD.
    """
    from api.cli.console import progress_bar
    from station.batches import batches_of
    from station.measurement import load_tags, read_table

    _check({"--start": start}, -math.inf)
    _check({"--speed": speed, "--batch": batch}, 0.0)
    if url is not None and endpoint is not None:
        _refuse("--endpoint", "must be left out where --url is given")
    if source is not None:
        check_source("send", source)
    given = load_tags(tags)
    each_s = batch or (BATCH_S if speed is None else BATCH_TIMED_S)
    sent = batches_of(read_table(record), given, each_s, start, str(record))
    name = source or f"record-{hashlib.sha256(record.read_bytes()).hexdigest()[:12]}"
    with _way(twin, url, endpoint, user, ca) as way, progress_bar("batches") as progress:
        first = _first(way, name, len(sent))
        found = [*_sent(way, name, sent, given, first, speed, progress)]
    taken = sum(each["samples"] for each in found if not each["repeated"])
    told = f"twin {twin} has {len(sent)} batches of source {name}, now {taken} samples more"
    skipped = first + sum(each["repeated"] for each in found)
    typer.echo(told + (f"; {skipped} batches were there already" if skipped else ""))


def _first(way: _Way, name: str, count: int) -> int:
    """The batch to begin with: the last that the twin has, which must be the same, or 0."""
    highest = way.sources().get(name, 0)
    if highest >= count:
        _refuse("--source", f"{name!r} has sent sequence {highest}, and this is {count} batches: {_CONFLICT}")
    return highest


def _sent(
    way: _Way, name: str, batches: list[Batch], tags: TagMap, first: int, speed: float | None,
    progress: Callable[[int, int], None],
) -> Iterator[dict[str, Any]]:  # fmt: skip
    """What the service says of each batch, as it is sent."""
    from api.client import ServiceError
    from api.measurements.written import parquet_of

    began, origin = time.monotonic(), batches[first].time[0]
    for sequence in range(first, len(batches)):
        progress(sequence, len(batches))
        due = began if speed is None else began + (batches[sequence].time[-1] - origin) / speed
        time.sleep(max(0.0, due - time.monotonic()))
        try:
            yield way.send(name, sequence, parquet_of(batches[sequence], tags))
        except ServiceError as error:
            if "other content" not in str(error):
                raise
            raise ServiceError(f"{error}: {_CONFLICT}") from None


@contextmanager
def _way(twin: str, url: str | None, endpoint: str | None, user: str | None, ca: Path | None) -> Iterator[_Way]:
    """The service over REST, or over zenoh where an endpoint is given."""
    from api.http.timeseries import MEDIA, Format
    from api.settings import load_settings

    media = MEDIA[Format.PARQUET]
    if endpoint is not None:
        from api.telemetry.send import ZenohSender
        from api.telemetry.session import connect

        with connect(endpoint, load_settings(zenoh_user=user, zenoh_ca=ca)) as session:
            zenoh = ZenohSender(session, twin)
            yield _Way(zenoh.sources, lambda name, sequence, content: zenoh.send(name, sequence, content, media))
        return
    from api.client import Client

    path = f"/v1/twins/{quote(twin, safe='')}/measurements"
    with Client(load_settings(url=url)) as client:
        yield _Way(
            lambda: {each["source"]: each["sequence"] for each in client.get(path)["sources"]},
            lambda name, sequence, content: client.send(path, content, media, source=name, sequence=sequence),
        )


def _check(given: dict[str, float | None], low: float) -> None:
    for name, value in given.items():
        if value is not None and not low < value < math.inf:
            _refuse(name, f"must be a number{'' if low < 0 else ' above 0'}; given {value:g}")


def _refuse(name: str, message: str) -> None:
    from station import InputError

    raise InputError("send", [(name, message)])


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(send)
