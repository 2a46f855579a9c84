"""/v1/twins/{twin_id}/notes: what people have to say about a time of a station."""

from __future__ import annotations

import secrets
import time
from http import HTTPStatus
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Path, Query, Request
from starlette.responses import Response

from api.http.authorization import requires
from api.http.bodies import JsonRoute
from api.http.dependencies import provided
from api.http.idempotency import IdempotentRequest, Keep
from api.http.problems import not_found
from api.scopes import Scope
from api.store.notes import NoteRepository
from api.store.records import StoredNote, Superseded
from api.twins.alarm_routes import LOCAL
from api.twins.note_schemas import TIME_MAX, Note, NoteRequest, TwinNotes
from api.twins.routes import TwinId, TwinsDep
from api.twins.service import Twins

router = APIRouter(prefix="/v1/twins", tags=["twins"], route_class=JsonRoute)

NotesDep = Annotated[NoteRepository, Depends(provided(NoteRepository))]
NoteId = Annotated[str, Path(max_length=32, description="Id of a note", examples=["note-8f14e45f"])]


def _bound(about: str, example: int) -> Any:
    unit = {"unit": "s"}
    return Query(
        ge=0, le=TIME_MAX, allow_inf_nan=False, description=about, json_schema_extra=unit, examples=[example]
    )  # fmt: skip


@router.get("/{twin_id}/notes")
def get_notes(
    twin_id: TwinId, twins: TwinsDep, notes: NotesDep,
    from_s: Annotated[float | None, _bound("Those that are not over before", 0)] = None,
    to_s: Annotated[float | None, _bound("Those that do not begin later", 86_400)] = None,
) -> TwinNotes:  # fmt: skip
    """The notes on a twin, or those on a stretch of its time, in the order of their times."""
    _check(twins, twin_id)
    return TwinNotes(twin=twin_id, items=[Note.of(note) for note in notes.within(twin_id, from_s, to_s)])


@router.post("/{twin_id}/notes", status_code=201, response_model=Note)
@requires(Scope.OPERATE)
def add_note(
    twin_id: TwinId, order: NoteRequest, twins: TwinsDep, notes: NotesDep, idempotent: IdempotentRequest,
    request: Request,
) -> Response:  # fmt: skip
    """Write a note on a time of a twin, live or ended; the name of the key says who did."""
    _check(twins, twin_id)

    def add(keep: Keep[Note] | None) -> Note:
        author = request.scope.get("hrs_owner") or LOCAL
        name = f"note-{secrets.token_hex(4)}"
        stored = StoredNote(name, order.time_s, order.to_s, order.text, author, time.time())
        note = Note.of(stored)
        try:
            notes.add(twin_id, stored, None if keep is None else keep(note))
        except Superseded:
            raise not_found("twin", twin_id) from None
        return note

    return idempotent.answer(HTTPStatus.CREATED, add, lambda note: (f"/v1/twins/{twin_id}/notes/{note.id}", note))


@router.delete("/{twin_id}/notes/{note_id}", status_code=204)
@requires(Scope.OPERATE)
def delete_note(twin_id: TwinId, note_id: NoteId, twins: TwinsDep, notes: NotesDep) -> None:
    """Forget a note."""
    _check(twins, twin_id)
    if not notes.remove(twin_id, note_id):
        raise not_found("note", note_id)


def _check(twins: Twins, twin_id: str) -> None:
    if not twins.known(twin_id):
        raise not_found("twin", twin_id)
