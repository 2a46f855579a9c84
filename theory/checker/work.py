"""The work of checking a document, estimated before it is begun, and its limits."""

import time
from collections.abc import Mapping
from typing import Any, NamedTuple

from .constraints import Refused

SECONDS_A_PRODUCT = 2e-7  # of two whole numbers of a machine word, in plain Python
SECONDS_A_BYTE = 2e-7  # of a document's text: written once more for its checksum, and read into tuples
SECONDS_AN_EXPONENTIAL = 5e-4  # for each cube of its size
ENCLOSED = 8  # times as long for enclosures, of two numbers each
BYTES_AN_EDGE = 180  # lists, tuples, and pieces of text while the checksum is computed
BYTES_AN_ENTRY = 160  # of a matrix, besides its digits


class OverLimit(Refused):  # it reads as what it is
    """Checking would exceed, or has exceeded, a limit of time or memory: nothing is said of the document."""


Work = NamedTuple("Work", [("seconds", float), ("memory_bytes", int)])  # noqa: UP014  # short


def estimate(document: Mapping[str, Any]) -> Work:
    """Seconds and bytes that checking a document takes at most, within a factor of some three, from its counts."""
    proof, modes = document["proof"], document["problem"]["modes"]
    matrices = [*proof.get("matrices", []), *proof.get("multipliers", [])]
    noises = len(modes[0]["E"][0]) if "E" in modes[0] else 0
    gains = document["problem"].get("gains", [])
    size = len(modes[0]["A"]) + max((len(entry.get("A", [])) for entry in gains), default=0)
    numbers = [text for mode in modes for rows in mode.values() for row in rows for text in row]
    given = 4 * max((len(str(text)) for text in numbers), default=1)
    bits = max((item.bit_length() for triangle in matrices for item in triangle if type(item) is int), default=1)
    edges = [*proof["edges"], *proof["jumps"]]
    inner, parameters = size + noises, len(document["problem"].get("parameters", []))
    width = inner if not parameters else inner + size + len(modes[0].get("C", []))
    words = 1 + (bits + 2 * given) / 60
    products = 2 * width**3 * words**1.6 + width**3 / 3 * (1 + width * words / 3) ** 1.6
    entries = sum(map(len, matrices))
    text = 24 * len(edges) + entries * (2 + bits // 3)
    distinct = min(len(edges), len(matrices) ** 2 * max(1, len(modes)))  # those that repeat are proved once
    proved = distinct + len(matrices) if not parameters else 6**parameters * len(edges) + 2**parameters * len(matrices)
    seconds = SECONDS_A_BYTE * text + SECONDS_A_PRODUCT * proved * products
    if "period" in document["problem"]:
        wide = size + noises + (len(modes[0]["B"][0]) if "B" in modes[0] else 0)
        seconds = seconds * ENCLOSED + SECONDS_AN_EXPONENTIAL * len(modes) * wide**3
    return Work(seconds, BYTES_AN_EDGE * len(edges) + entries * (BYTES_AN_ENTRY + bits // 2))


class Limits:
    """Limits of a check: refuses what is estimated to exceed them, and ends what does."""

    def __init__(self, seconds: float | None, memory_bytes: int | None) -> None:
        self._seconds, self._memory = seconds, memory_bytes
        self._end = None if seconds is None else time.monotonic() + seconds

    def foresee(self, document: Mapping[str, Any]) -> None:
        """Refuse a document whose estimate exceeds a limit."""
        if self._seconds is None and self._memory is None:
            return
        found = estimate(document)
        if self._memory is not None and found.memory_bytes > self._memory:
            raise OverLimit(f"not checked: an estimated {found.memory_bytes} bytes, the limit is {self._memory}")
        if self._seconds is not None and found.seconds > self._seconds:
            raise OverLimit(f"not checked: an estimated {found.seconds:.3g} s, the limit is {self._seconds:g} s")

    def tick(self) -> None:
        """Refuse to go on once the time is over."""
        if self._end is not None and time.monotonic() > self._end:
            raise OverLimit(f"not checked to its end: the limit of {self._seconds:g} s is over")
