"""What happened: every request, answer, fault and sample, in the order in which it was seen."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

Entry = dict[str, Any]
"""One thing that happened: `at` [s, monotonic], `what`, and what belongs to it."""


class History:
    """Entries from many threads."""

    def __init__(self, entries: Iterable[Entry] = ()) -> None:
        self._entries = list(entries)
        self._lock = threading.Lock()
        self._began = time.monotonic()

    def note(self, what: str, **about: Any) -> None:
        """One more entry."""
        with self._lock:
            self._entries.append({"at": round(time.monotonic() - self._began, 3), "what": what, **about})

    def of(self, *whats: str) -> list[Entry]:
        """The entries of these kinds, in order."""
        with self._lock:
            return [entry for entry in self._entries if entry["what"] in whats]

    def write(self, path: Path) -> None:
        """One JSON object a line."""
        with self._lock, path.open("w") as lines:
            lines.writelines(json.dumps(entry) + "\n" for entry in self._entries)


def read(path: Path) -> History:
    """What `write` wrote; a last line cut short by a kill is dropped."""
    entries = []
    for line in path.read_text().splitlines():
        try:
            entries.append(json.loads(line))
        except json.JSONDecodeError:
            break
    return History(entries)
