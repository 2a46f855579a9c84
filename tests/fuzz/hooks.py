"""What schemathesis is told besides its configuration: a key of its own for each thing that it creates."""

import itertools
import re
import secrets
from typing import Any

import schemathesis

VALID = re.compile(r"[\x21-\x7e]{1,230}")
"""Keys that are accepted. One that is drawn twice gets the first answer again, of something that may be gone."""

numbers = itertools.count()

RUN = secrets.token_hex(4)
"""A service outlives a run, and so do its keys: those of another run are others."""


@schemathesis.hook
def before_call(_context: Any, case: Any, _kwargs: Any) -> None:
    """Another key for each request with a valid one."""
    key = (case.headers or {}).get("Idempotency-Key")
    if isinstance(key, str) and VALID.fullmatch(key):
        case.headers["Idempotency-Key"] = f"{key}-{RUN}-{next(numbers)}"
