"""Measurements that no station sends: wrong types, order, times, qualities, units, sizes and bytes.

Each is refused and named, or counted for what became of it; the filter goes on, and its estimates stay numbers.
"""

from __future__ import annotations

import copy
import io
import json
import math
from collections.abc import Callable
from typing import Any

import httpx
import pyarrow as pa
from hypothesis import strategies as st
from pyarrow import csv, parquet

from api.http.problems import MEDIA_TYPE
from api.measurements.formats import MEDIA_TYPES, NDJSON
from station.batches import BATCH_MAX
from tests.api.measured import BEGIN, NAMES, ORDER
from tests.fuzz.documents import as_json, broken, mutated, values
from tests.fuzz.properties import Property
from tests.waiting import wait_until

TWIN = "/v1/twins/followed"
GOOD = {"pressure": 300.0, "temperature": 20.0, "flow": 10.0, "vehicle": -1.0}
"""Readings by the kind of the sensor; of a valve 0."""

YEAR_S = 365 * 86_400.0
LOOKED_AT = 40
"""So many cases, then it is looked whether the twin follows what is good as before."""

SECONDS, FIRST_SECONDS = 3, 90
"""Of good readings, each time, and at first: a filter that begins tells nothing for a minute."""

KNOWN = {"good", "uncertain", "bad"}
PARQUET = "application/vnd.apache.parquet"

Row = dict[str, Any]

_kinds = {
    "pressure": (0.0, 1e4, -1.0, 30e6, 3000.0), "temperature": (-273.15, -1e3, 293.15, 1e6),
    "flow": (1e4, -1e4, 0.01), "vehicle": (0.0, 1e10, -7.0, 2.5), "inlet": (1.0, 2.0, -1.0), "outlet": (1.0, 0.5),
}  # fmt: skip
_steps = st.sampled_from((0.0, 0.01, 0.5, 1.0, 5.0, 100.0, -1.0, -600.0, YEAR_S, -YEAR_S, 1e-9, 7200.0))
_qualities = st.sampled_from(
    ("good", "GOOD", " bad ", "uncertain", "", 0, 63, 64, 127, 192, 255, 256, -1, 128, 0x40000000, 0x80000000, 2**32,
     "192", "fine", None, True, 1.5, 192.0, [], "9" * 40)
)  # fmt: skip


def _rows(begin: float, seconds: int = 1) -> list[Row]:
    """Good rows of seconds from a time on."""
    return [
        {"tag": f"T.{name}", "time": begin + second + 0.1, "value": GOOD.get(name.partition("_")[0], 0.0)}
        for second in range(seconds)
        for name in NAMES
    ]


@st.composite
def _changed(draw: Callable[[Any], Any]) -> list[Row]:
    """Rows of a second whose times count from that of the twin, some in other units, order, number or quality."""
    rows = copy.deepcopy(_rows(0.0))
    for _ in range(draw(st.integers(1, 4))):
        row = draw(st.sampled_from(rows))
        what = draw(st.sampled_from(("unit", "time", "quality", "twice", "order", "less", "every time")))
        if what == "unit":
            row["value"] = draw(st.sampled_from(_kinds[row["tag"][2:].partition("_")[0]]) | st.floats())
        elif what == "time" and isinstance(row["time"], float):
            row["time"] += draw(_steps)
        elif what == "quality":
            row["quality"] = draw(_qualities)
        elif what == "twice":
            rows.append({**row, "value": 0.5})
        elif what == "order":
            rows = draw(st.permutations(rows))
        elif what == "less" and len(rows) > 1:
            rows.remove(row)
        elif what == "every time":
            step = draw(_steps)
            for each in rows:
                each["time"] += step
    return rows


def _columns(rows: list[Row]) -> pa.Table:
    names = [name for name in ("tag", "time", "value", "quality") if any(name in row for row in rows)]
    texts = {name: ["" if row.get(name) is None else str(row.get(name)) for row in rows] for name in names}
    return pa.table({name: pa.array(cells, pa.string()) for name, cells in texts.items()})


def _written(rows: list[Row], media: str) -> bytes:
    """Rows as a media type carries them; as texts where it has columns."""
    stream = io.BytesIO()
    if media == NDJSON:
        return b"\n".join(as_json(row) for row in rows)
    if media == "text/csv":
        csv.write_csv(_columns(rows), stream)
    elif media == "application/json":
        return as_json(rows)
    else:
        parquet.write_table(_columns(rows), stream)
    return stream.getvalue()


@st.composite
def cases(draw: Callable[[Any], Any]) -> tuple[Any, str, bytes | None, int]:
    """Rows, or any document; media type; bytes in their place where they are broken; number of a source."""
    rows = draw(_changed())
    media = draw(st.sampled_from(sorted(MEDIA_TYPES)))
    kind = draw(st.sampled_from(("rows", "rows", "mutated", "anything", "broken", "large", "other media")))
    source = draw(st.integers(0, 3))
    if kind == "mutated":
        return draw(mutated(rows)), "application/json", None, source
    if kind == "anything":
        return draw(values), "application/json", None, source
    if kind == "broken":
        return None, media, draw(broken(_written(rows, media))), source
    if kind == "large":
        count = draw(st.sampled_from((BATCH_MAX, BATCH_MAX + 1, 0)))
        return (rows * (count // len(rows) + 1))[:count], "application/json", None, source
    if kind == "other media":
        media = draw(st.sampled_from((*MEDIA_TYPES, "text/plain", "", "application/octet-stream", "a/b; c=\x7f")))
    return rows, media, None, source


def _must_be_refused(rows: Any) -> bool:
    """Whether a list of rows as JSON has what no sample may: an independent look at the plainest of the rules."""
    if not isinstance(rows, list) or not 1 <= len(rows) <= BATCH_MAX:
        return not (isinstance(rows, dict) and set(rows) == {"samples"})
    return any(not isinstance(row, dict) or _is_wrong(row) for row in rows)


def _is_wrong(row: Row) -> bool:
    if not row.keys() <= {"tag", "time", "value", "quality"}:
        return True
    tag, time, value, quality = (row.get(name) for name in ("tag", "time", "value", "quality"))
    if not isinstance(tag, str) or tag not in {f"T.{name}" for name in NAMES}:
        return True
    if isinstance(time, bool) or not isinstance(time, int | float | str):
        return True
    if isinstance(time, int | float) and not _is_finite(time):
        return True
    wrong_word = isinstance(quality, str) and quality.strip().isalpha() and quality.strip().lower() not in KNOWN
    return isinstance(value, list | dict) or isinstance(quality, list | dict | bool) or wrong_word


def _is_finite(number: float) -> bool:
    """Whether a number is one to a float: integers of JSON may be larger than any."""
    try:
        return math.isfinite(number)
    except OverflowError:
        return False


class Followed:
    """A measured twin that is sent what is drawn, and what became of it."""

    def __init__(self, client: httpx.Client) -> None:
        self._client = client
        client.post("/v1/twins", json={**ORDER, "id": "followed"}).raise_for_status()
        self._sequence = self._accepted = self._number = 0
        self._now = BEGIN
        self._cases = 0
        self._follow_good(FIRST_SECONDS)

    def check(self, case: tuple[Any, str, bytes | None, int]) -> None:
        """Send it: refused in words, or counted."""
        document, media, body, source = case
        if body is None:
            document = self._moved(document)
            known = (
                media in MEDIA_TYPES and isinstance(document, list) and all(isinstance(row, dict) for row in document)
            )
            body = _written(document, media) if known and document else as_json(document)
        answer = self._send(body, media, f"fuzz{source}")
        if case[2] is None and media == "application/json" and _must_be_refused(json.loads(body)):
            assert answer.status_code == 422, (answer.status_code, body[:2000])
        self._cases += 1
        if self._cases % LOOKED_AT == 0:
            self._follow_good()

    def _moved(self, document: Any) -> Any:
        """Its times as they are from the twin's on; what is no number stays what it is."""
        if not isinstance(document, list):
            return document
        return [
            {**row, "time": row["time"] + self._now}
            if isinstance(row, dict) and isinstance(row.get("time"), float) and abs(row["time"]) < 2 * YEAR_S
            else row
            for row in document
        ]

    def _send(self, body: bytes, media: str, source: str) -> httpx.Response:
        """Send a body, again as long as the twin is behind; a refusal is a problem document."""
        self._sequence += 1
        answers: list[httpx.Response] = []

        def taken() -> bool:
            answers.append(
                self._client.post(
                    f"{TWIN}/measurements", params={"source": source, "sequence": self._sequence}, content=body,
                    headers=[(b"content-type", media.encode())],
                )
            )  # fmt: skip
            return answers[-1].status_code != 503 or "retry-after" not in answers[-1].headers

        wait_until(taken)
        answer = answers[-1]
        assert answer.status_code < 500, (answer.status_code, answer.text)
        if answer.status_code >= 400:
            assert answer.headers["content-type"] == MEDIA_TYPE
            assert answer.json()["status"] == answer.status_code
            assert answer.json()["detail"]
        else:
            told = answer.json()
            assert (answer.status_code, told["repeated"]) == (202, False)
            self._number = told["number"]
            self._accepted += told["samples"]
        return answer

    def _follow_good(self, seconds: int = SECONDS) -> None:
        """Good seconds are followed as before; every sample that was accepted is accounted for."""
        body = as_json(_rows(self._now + 1.0, seconds))
        assert self._send(body, "application/json", "good").status_code == 202
        wait_until(lambda: self._estimate().get("number", 0) == self._number)
        found = self._estimate()
        counts = sum(found["samples"][name] for name in ("taken", "late", "empty", "ahead"))
        assert counts + self._refused() == self._accepted, (found["samples"], self._refused(), self._accepted)
        assert self._client.get(TWIN).json()["state"] == "running"
        for name, quantity in found["quantities"].items():
            told = quantity["value"], quantity["deviation"]
            assert all(each is None or math.isfinite(each) for each in told), (name, told)
        self._now = max(self._now + seconds, found["source_time"] + 2.0)

    def _estimate(self) -> dict[str, Any]:
        answer = self._client.get(f"{TWIN}/estimate")
        return answer.json() if answer.status_code == 200 else {}

    def _refused(self) -> int:
        """Samples of batches that were refused whole, as its events say."""
        refused, path = 0, f"{TWIN}/events?limit=1000"
        while path:
            page = self._client.get(path).json()
            refused += sum(
                event["details"]["samples"] for event in page["items"] if event["kind"] == "measurements_refused"
            )
            path = f"{TWIN}/events?limit=1000&cursor={page['next']}" if page.get("next") else ""
        return refused


def properties(client: httpx.Client) -> list[Property]:
    """Of a measured twin `followed` of the service that `client` asks."""
    return [Property("measurements", cases(), Followed(client).check)]
