"""/v1/twins: start live twins, operate them, read where they stand, what they told and what they tell now."""

from __future__ import annotations

from http import HTTPStatus
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Header, Path, Query
from starlette.responses import Response, StreamingResponse

from api.conditional import CachedGet, ExpectedState
from api.figures import Format, Selection, asked, response
from api.idempotency import Asked
from api.paging import FAR, PagedEvents, PagedTwins
from api.runs.routes import SERIES_RESPONSES, Form
from api.services import Opened
from api.twins.feed import COLUMNS
from api.twins.schemas import EventPage, TwinChange, TwinPage, TwinRequest, TwinState, VehicleRequest
from api.twins.stream import Place, begin, stream
from station import Scenario

router = APIRouter(prefix="/v1/twins", tags=["twins"])

STREAM = "text/event-stream"

STREAM_RESPONSES: dict[int | str, dict[str, Any]] = {200: {"content": {STREAM: {"schema": {"type": "string"}}}}}

TwinId = Annotated[str, Path(max_length=32, description="Id of a twin", examples=["demo"])]


@router.post("", status_code=201, response_model=TwinState)
def start_twin(request: TwinRequest, opened: Opened, asked_once: Asked) -> Response:
    """Start a live twin; its place is in `Location`, its telemetry under `hrs/v1/{id}` on zenoh."""
    return asked_once.answer(HTTPStatus.CREATED, lambda keep: opened.twins.start(request, keep), _placed)


@router.get("")
def list_twins(opened: Opened, page: PagedTwins) -> TwinPage:
    """Twins, the oldest first."""
    items, cursor = opened.twins.page(page)
    return TwinPage(items=list(items), next=cursor)


@router.get("/{twin_id}")
def get_twin(twin_id: TwinId, opened: Opened, cached: CachedGet) -> TwinState:
    """A twin and where it stands."""
    state = opened.twins.state(twin_id)
    cached.twin(state)
    return state


@router.get("/{twin_id}/scenario")
def get_twin_scenario(twin_id: TwinId, opened: Opened) -> Scenario:
    """The scenario a twin runs, with every parameter of its station."""
    return opened.twins.scenario(twin_id)


@router.patch("/{twin_id}")
def change_twin(twin_id: TwinId, change: TwinChange, opened: Opened, expected: ExpectedState) -> TwinState:
    """Pause, go on, run at another speed, let another controller decide; all of it or nothing."""
    return expected.now(opened.twins.change(twin_id, change, expected.check))


@router.post("/{twin_id}/vehicles", status_code=201, response_model=TwinState)
def add_vehicle(twin_id: TwinId, vehicle: VehicleRequest, opened: Opened, asked_once: Asked) -> Response:
    """Let a vehicle arrive with the next second; answered when it is stored."""
    return asked_once.answer(HTTPStatus.CREATED, lambda keep: opened.twins.add_vehicle(twin_id, vehicle, keep), _placed)


def _placed(state: TwinState) -> tuple[str, TwinState]:
    return f"/v1/twins/{state.id}", state


@router.post("/{twin_id}/stop")
def stop_twin(twin_id: TwinId, opened: Opened, expected: ExpectedState) -> TwinState:
    """End a twin for good; what it told stays."""
    return expected.now(opened.twins.stop(twin_id, expected.check))


@router.delete("/{twin_id}", status_code=204)
def delete_twin(twin_id: TwinId, opened: Opened, expected: ExpectedState) -> None:
    """Forget a twin that has ended, with all it told."""
    opened.twins.remove(twin_id, expected.check)


@router.get("/{twin_id}/history", responses=SERIES_RESPONSES)
def get_history(
    twin_id: TwinId, opened: Opened, chosen: Annotated[Selection, Depends(asked)], form: Form = Format.JSON
) -> Response:
    """What a twin has told: every column each second, or what the query selects."""
    return response(opened.twins.columns(twin_id, chosen), COLUMNS, form)


@router.get("/{twin_id}/events")
def get_events(
    twin_id: TwinId,
    opened: Opened,
    page: PagedEvents,
    after: Annotated[int, Query(ge=-1, le=FAR, description="Go on behind this number", examples=[7])] = -1,
) -> EventPage:
    """What has happened to a twin, in order; `cursor` goes before `after`."""
    (begin,) = page.behind(int) or (after,)
    found, cursor = page.turn(opened.twins.events(twin_id, begin, page.limit + 1), lambda event: (event["seq"],))
    return EventPage.model_validate({"items": found, "after": found[-1]["seq"] if found else begin, "next": cursor})


def _place(
    twin_id: TwinId, opened: Opened,
    last_event_id: Annotated[
        str | None, Header(description="Id of your last message: what is behind it follows", examples=["9.1.40.7"])
    ] = None,
) -> Place:  # fmt: skip
    """Where a stream begins: one that has begun can tell no problem any more."""
    return begin(opened.twins, twin_id, Place.parse(last_event_id))


@router.get("/{twin_id}/stream", response_class=StreamingResponse, responses=STREAM_RESPONSES)
async def get_stream(twin_id: TwinId, opened: Opened, place: Annotated[Place, Depends(_place)]) -> StreamingResponse:
    """Samples and events as they are told, for browsers: at most ten samples a second, and every event."""
    news = stream(opened.twins, twin_id, place, opened.broadcast, opened.ending)
    return StreamingResponse(news, media_type=STREAM, headers={"Cache-Control": "no-store"})
