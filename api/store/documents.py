"""JSON documents as the store hands them out."""

from __future__ import annotations

import json
import re
from typing import Any

_SURROGATE = re.compile(rb"\\u[dD][89a-fA-F]")


def read_json(stored: str | bytes) -> Any:
    """A stored document in which every text can be written: half a character, which older versions took, is a `?`."""
    document = json.loads(stored)
    if _SURROGATE.search(stored if isinstance(stored, bytes) else stored.encode()) is None:
        return document
    return json.loads(json.dumps(document, ensure_ascii=False).encode("utf-8", "replace"))
