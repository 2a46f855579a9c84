"""Notes on the time axis of twins, as people write them and answers show them."""

from __future__ import annotations

from typing import Annotated, Any, Self

from pydantic import BaseModel, Field, model_validator

from api.http.strict import Body
from api.moments import written
from api.store.records import StoredNote

TEXT_MAX = 500
"""Longest text of a note [characters]."""

TIME_MAX = 1e12
"""Latest time of a note [s]."""


def _time(about: str, example: Any) -> Any:
    return Field(
        ge=0, le=TIME_MAX, allow_inf_nan=False, description=about, json_schema_extra={"unit": "s"}, examples=[example]
    )


TimeS = Annotated[float, _time("When it was, in seconds since the twin's start", 50_700)]
ToS = Annotated[float | None, _time("When that was over; null for a moment", 52_500)]
Text = Annotated[
    str,
    Field(
        min_length=1, max_length=TEXT_MAX, pattern=r"^[^\x00-\x1f\x7f]*[^\x00-\x20\x7f][^\x00-\x1f\x7f]*$",
        description="What there is to know, in one line", examples=["Compressor serviced"],
    ),
]  # fmt: skip


class NoteRequest(Body):
    """A note to be written."""

    time_s: TimeS
    to_s: ToS = None
    text: Text

    @model_validator(mode="after")
    def _lasts(self) -> Self:
        if self.to_s is not None and self.to_s < self.time_s:
            raise ValueError(f"to_s must not lie before time_s = {self.time_s:g} s; given {self.to_s:g}")
        return self


class Note(BaseModel):
    """A note on the time axis of a twin."""

    id: Annotated[str, Field(description="Its name in the path", examples=["note-8f14e45f"])]
    time_s: TimeS
    to_s: ToS
    text: Text
    by: Annotated[str, Field(description="Who wrote it: the name of a key, or `local`", examples=["operator"])]
    created: Annotated[str, Field(description="When it was written, UTC", examples=["2026-11-21T09:20:00Z"])]

    @classmethod
    def of(cls, stored: StoredNote) -> Note:
        """The note that is stored."""
        return cls(
            id=stored.id, time_s=stored.time_s, to_s=stored.to_s, text=stored.text, by=stored.author,
            created=written(stored.created, "seconds"),
        )  # fmt: skip


class TwinNotes(BaseModel):
    """Notes on a twin, in the order of their times."""

    twin: Annotated[str, Field(description="Id of the twin", examples=["demo"])]
    items: Annotated[list[Note], Field(description="All of the stretch asked for", examples=[[]])]
