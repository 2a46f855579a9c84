"""The ETag of a twin, of two parts: what can be changed about it, and all it shows.

If-None-Match compares both, to the last sample; If-Match compares the first, since a twin that runs has another sample
every second, which is no change of anybody's.
"""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends
from starlette.responses import Response

from api.http.etags import IfMatch, changed_since, digest, tags_of
from api.twins.state_schemas import TwinState


def twin_tag(state: TwinState) -> str:
    """The ETag of a twin: digests of what can be changed about it, and of all it shows."""
    changeable = digest(
        state.created, state.state, state.controller, str(state.speed), state.service, state.calibration or ""
    )
    return f"{changeable[:16]}-{digest(state.model_dump_json())[:16]}"


class TwinPrecondition:
    """A request that changes a twin, perhaps only as its asker knows it."""

    def __init__(self, response: Response, held: str | None) -> None:
        self._response = response
        self._held = held

    def check(self, state: TwinState) -> None:
        """Raise a problem if the asker knows another."""
        if self._held is None:
            return
        changeable = twin_tag(state).partition("-")[0]
        if not any(held == "*" or held.partition("-")[0] == changeable for held in tags_of(self._held, strong=True)):
            raise changed_since(f"twin {state.id!r}")

    def now(self, state: TwinState) -> TwinState:
        """The twin as it is now, with its tag."""
        self._response.headers["ETag"] = f'"{twin_tag(state)}"'
        return state


async def twin_precondition(response: Response, if_match: IfMatch = None) -> TwinPrecondition:
    """A request as one that changes a twin."""
    return TwinPrecondition(response, if_match)


TwinPreconditionDep = Annotated[TwinPrecondition, Depends(twin_precondition)]
