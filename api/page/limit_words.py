"""The limits as a module of the page, made of the registry: what each is called, its equation and what it says."""

from __future__ import annotations

import hashlib
import json
from functools import cache

from starlette.responses import Response

from station.limits import LIMITS, thesis_equation

PLACE = "live/limit_words.js"
"""Where it stands among the page's files."""


@cache
def limit_words() -> bytes:
    """The module: `LIMITS` has each limit at its code, `null` where none has it."""
    words: list[dict[str, str | None] | None] = [None] * (1 + max(limit.limit for limit in LIMITS))
    for limit in LIMITS:
        words[limit.limit] = {
            "name": limit.limit.name.lower(),
            "title": limit.title,
            "equation": thesis_equation(limit),
            "says": limit.says,
        }
    return f"export const LIMITS = {json.dumps(words, ensure_ascii=False)};\n".encode()


def limit_words_response() -> Response:
    """The module as it is served: a browser asks each time whether the one it has still holds."""
    content = limit_words()
    tag = hashlib.sha256(content).hexdigest()[:32]
    return Response(content, media_type="text/javascript", headers={"ETag": f'"{tag}"', "Cache-Control": "no-cache"})
