"""/v1/twins: start live twins, operate them, read where they stand, what they told and what they tell now."""

from __future__ import annotations

from functools import partial
from http import HTTPStatus
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Header, Path, Query
from starlette.responses import Response, StreamingResponse

from api.http.authorization import requires
from api.http.bodies import JsonRoute
from api.http.dependencies import SettingsDep, ShutdownDep, ThreadsDep, provided
from api.http.disconnection import Disconnected
from api.http.etags import ConditionalGetDep
from api.http.idempotency import IdempotentRequest, Keep
from api.http.pagination import FAR, PagedEvents, PagedTwins
from api.http.timeseries import SERIES_RESPONSES, Format, FormatParameter, Selection, SelectionDep, response
from api.jobs.endpoints import ChecksDep
from api.scenarios.service import ScenariosDep
from api.scopes import Scope
from api.twins.broadcast import Broadcast
from api.twins.day_schemas import TwinDay, TwinDays
from api.twins.days import DAY_S
from api.twins.etag import TwinPreconditionDep, twin_tag
from api.twins.event_schemas import EventPage
from api.twins.replay import replay_request
from api.twins.schemas import Source, TwinChange, TwinOrder, VehicleRequest
from api.twins.service import Twins
from api.twins.state_schemas import TwinPage, TwinState
from api.twins.stream import StreamCursor, begin, stream
from api.twins.what_if import what_if
from station import Scenario

router = APIRouter(prefix="/v1/twins", tags=["twins"], route_class=JsonRoute)

STREAM = "text/event-stream"

STREAM_RESPONSES: dict[int | str, dict[str, Any]] = {200: {"content": {STREAM: {"schema": {"type": "string"}}}}}

TwinsDep = Annotated[Twins, Depends(provided(Twins))]
BroadcastDep = Annotated[Broadcast, Depends(provided(Broadcast))]

LastSeconds = Annotated[
    int | None,
    Query(
        ge=1, le=FAR, description="Only so many of the newest seconds; in place of from_s and to_s",
        json_schema_extra={"unit": "s"}, examples=[3600],
    ),
]  # fmt: skip

TwinId = Annotated[str, Path(max_length=32, description="Id of a twin", examples=["demo"])]


@router.post("", status_code=201, response_model=TwinState)
@requires(Scope.OPERATE)
def start_twin(
    order: TwinOrder,
    twins: TwinsDep,
    scenarios: ScenariosDep,
    checks: ChecksDep,
    settings: SettingsDep,
    idempotent: IdempotentRequest,
    client: Disconnected,
) -> Response:
    """Start a live twin; its place is in `Location`, its telemetry under `hrs/v1/{id}` on zenoh."""

    def start(keep: Keep[TwinState] | None) -> TwinState:
        snapshot = None
        if order.scenario is not None:
            request = order.at(scenarios.resolve(order.scenario))
        elif order.source is Source.REPLAY:
            request = replay_request(twins, order)
        else:
            request, snapshot = what_if(twins, order, settings)
        return twins.start(request, keep, partial(checks.belongs, client=client), snapshot)

    return idempotent.answer(HTTPStatus.CREATED, start, _placed)


@router.get("")
def list_twins(twins: TwinsDep, page: PagedTwins) -> TwinPage:
    """Twins, the oldest first; while the database does not answer those in memory, as `complete` says."""
    return twins.page(page)


@router.get("/{twin_id}")
async def get_twin(twin_id: TwinId, twins: TwinsDep, threads: ThreadsDep, conditional: ConditionalGetDep) -> TwinState:
    """A twin and where it stands."""
    state = await threads.run(twins.remembers(twin_id), twins.state, twin_id)
    conditional.tag(twin_tag(state))
    return state


@router.get("/{twin_id}/scenario")
def get_twin_scenario(twin_id: TwinId, twins: TwinsDep) -> Scenario:
    """The scenario a twin runs, with every parameter of its station."""
    return twins.scenario(twin_id)


@router.patch("/{twin_id}")
@requires(Scope.OPERATE)
def change_twin(twin_id: TwinId, change: TwinChange, twins: TwinsDep, expected: TwinPreconditionDep) -> TwinState:
    """Pause, go on, run at another speed, let another controller decide; all of it or nothing."""
    return expected.now(twins.change(twin_id, change, expected.check))


@router.post("/{twin_id}/vehicles", status_code=201, response_model=TwinState)
@requires(Scope.OPERATE)
def add_vehicle(twin_id: TwinId, vehicle: VehicleRequest, twins: TwinsDep, idempotent: IdempotentRequest) -> Response:
    """Let a vehicle arrive with the next second; answered when it is stored."""
    return idempotent.answer(HTTPStatus.CREATED, lambda keep: twins.add_vehicle(twin_id, vehicle, keep), _placed)


def _placed(state: TwinState) -> tuple[str, TwinState]:
    return f"/v1/twins/{state.id}", state


@router.post("/{twin_id}/stop")
@requires(Scope.OPERATE)
def stop_twin(twin_id: TwinId, twins: TwinsDep, expected: TwinPreconditionDep) -> TwinState:
    """End a twin for good; what it told stays."""
    return expected.now(twins.stop(twin_id, expected.check))


@router.delete("/{twin_id}", status_code=204)
@requires(Scope.OPERATE)
def delete_twin(twin_id: TwinId, twins: TwinsDep, expected: TwinPreconditionDep) -> None:
    """Forget a twin that has ended, with all it told."""
    twins.remove(twin_id, expected.check)


@router.get("/{twin_id}/history", responses=SERIES_RESPONSES)
async def get_history(
    twin_id: TwinId, twins: TwinsDep, threads: ThreadsDep, chosen: SelectionDep, last_s: LastSeconds = None,
    form: FormatParameter = Format.JSON,
) -> Response:  # fmt: skip
    """The history of a twin: every column each second, or what the query selects."""
    if last_s is not None:
        samples = await threads.run(twins.remembers(twin_id), twins.samples, twin_id)
        chosen = chosen.newest(last_s, samples)
    remembered = twins.remembers_from(twin_id, int(chosen.start))
    return await threads.run(remembered, _history, twin_id, twins, chosen, form)


def _history(twin_id: str, twins: Twins, chosen: Selection, form: Format) -> Response:
    return response(twins.columns(twin_id, chosen), twins.units(twin_id), form)


@router.get("/{twin_id}/days")
async def get_days(twin_id: TwinId, twins: TwinsDep, threads: ThreadsDep) -> TwinDays:
    """Figures of the running day and of those before, the oldest first; a day is 86 400 s from the twin's start."""
    days = await threads.run(twins.remembers(twin_id), twins.days, twin_id)
    return TwinDays(day_s=DAY_S, items=[TwinDay.model_validate(day) for day in days])


@router.get("/{twin_id}/events")
def get_events(
    twin_id: TwinId,
    twins: TwinsDep,
    page: PagedEvents,
    after: Annotated[int, Query(ge=-1, le=FAR, description="Go on behind this number", examples=[7])] = -1,
    before: Annotated[
        int | None, Query(ge=0, le=FAR, description="The last ones below this number, without `next`", examples=[7])
    ] = None,
) -> EventPage:
    """The events of a twin, in order; `cursor` goes before `after`. Numbers of old events may be missing."""
    (begin,) = page.behind(int) or (after,)
    if before is not None:
        last = [event for event in twins.last_events(twin_id, before, page.limit) if event["seq"] > begin]
        return EventPage.model_validate({"items": last, "after": last[-1]["seq"] if last else begin, "next": None})
    found, cursor = page.turn(twins.events(twin_id, begin, page.limit + 1), lambda event: (event["seq"],))
    return EventPage.model_validate({"items": found, "after": found[-1]["seq"] if found else begin, "next": cursor})


async def _place(
    twin_id: TwinId, twins: TwinsDep, threads: ThreadsDep,
    last_event_id: Annotated[
        str | None, Header(description="Id of your last message: what is behind it follows", examples=["9.1.40.7"])
    ] = None,
) -> StreamCursor:  # fmt: skip
    """The cursor of a stream, found before it begins: afterwards no problem can be answered."""
    last = StreamCursor.parse(last_event_id)
    return await threads.run(twins.remembers(twin_id), begin, twins, twin_id, last)


@router.get("/{twin_id}/stream", response_class=StreamingResponse, responses=STREAM_RESPONSES)
async def get_stream(
    twin_id: TwinId, twins: TwinsDep, broadcast: BroadcastDep, shutdown: ShutdownDep,
    place: Annotated[StreamCursor, Depends(_place)],
) -> StreamingResponse:  # fmt: skip
    """Samples and events as they are told, for browsers: at most ten samples a second, and every event."""
    news = stream(twins, twin_id, place, broadcast, shutdown)
    return StreamingResponse(news, media_type=STREAM, headers={"Cache-Control": "no-store"})
