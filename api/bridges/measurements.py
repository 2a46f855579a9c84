"""Readings on their way to a measured twin: numbered batches of one source, each stored once."""

from __future__ import annotations

from typing import Any
from urllib.parse import quote

import orjson

from api.client import Client

ROWS_MAX = 2000
"""Rows that are stored together."""


class MeasurementSender:
    """Sends rows of readings to a measured twin, as batches with numbers that go on where the source has come to.

    A batch whose answer is lost is sent again under its number, so that the service stores it once.

    Parameters
    ----------
    client
        Of the service.
    twin
        Id of the twin.
    source
        Under which name the service counts batches.

    Raises
    ------
    StationError
        if there is no such measured twin, or the service does not answer.
    """

    def __init__(self, client: Client, twin: str, source: str) -> None:
        self._client, self._source = client, source
        self._path = f"/v1/twins/{quote(twin, safe='')}/measurements"
        sources = client.get(self._path)["sources"]
        self._sequence = max((each["sequence"] + 1 for each in sources if each["source"] == source), default=0)

    def send(self, rows: list[dict[str, Any]]) -> None:
        """Store rows as the next batch; they have the fields of `POST /v1/twins/{id}/measurements`.

        Raises
        ------
        InputError
            if a row is no reading of the twin; nothing of the batch is stored then.
        ServiceError
            if the service has not taken it for minutes.
        """
        content = orjson.dumps(rows)
        self._client.send(self._path, content, "application/json", source=self._source, sequence=self._sequence)
        self._sequence += 1
