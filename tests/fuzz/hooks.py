"""What schemathesis is told besides its configuration: a key of its own for each thing that it creates."""

import itertools
from typing import Any

import schemathesis

EXAMPLE = "8e03978e-40d5-43dd-bc93-6894a57f9324"
"""Of the document: as it stands, the second request with it would be refused."""

numbers = itertools.count()


@schemathesis.hook
def before_call(_context: Any, case: Any, _kwargs: Any) -> None:
    """Another key where the document's example stands."""
    if case.headers and case.headers.get("Idempotency-Key") == EXAMPLE:
        case.headers["Idempotency-Key"] = f"key-{next(numbers)}"
