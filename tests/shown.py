"""Output that a document shows against output that a program gave."""

from __future__ import annotations

import re
from collections.abc import Sequence

ELLIPSIS = "[...]"


def pattern(shown: Sequence[str], varies: Sequence[str] = ()) -> re.Pattern[str]:
    """What output must match to be as shown.

    `[...]` on a line of its own stands for any lines, within a line for any text; each of `varies` (a time, an id)
    for any text without spaces. Blank lines and the width of gaps count for nothing.
    """
    each = "|".join(re.escape(" ".join(text.split())) for text in sorted(varies, key=len, reverse=True))
    known = re.compile(rf"(?<![\w.])(?:{each})(?![\w])") if each else None
    parts = []
    for line in shown:
        words = " ".join(line.split())
        if not words:
            continue
        if words == ELLIPSIS:
            parts.append(r"(?:.*\n)*?")
            continue
        pieces = known.split(words) if known else [words]
        parts.append(r"\S+".join(re.escape(piece).replace(re.escape(ELLIPSIS), ".*") for piece in pieces) + r"\n")
    return re.compile("".join(parts))


def agree(shown: Sequence[str], output: str, varies: Sequence[str] = ()) -> None:
    """Fail unless the output is as shown."""
    lines = [" ".join(line.split()) for line in output.splitlines()]
    given = "".join(f"{line}\n" for line in lines if line)
    assert pattern(shown, varies).fullmatch(given), f"shown:\n{chr(10).join(shown)}\n\ngiven:\n{output}"
