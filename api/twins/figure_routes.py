"""/v1/twins/{twin_id}/figures and its report: any stretch of a twin's record in figures."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Query
from starlette.responses import HTMLResponse, Response

from api.http import pieces
from api.http.bodies import JsonRoute
from api.http.pagination import FAR
from api.http.timeseries import MEDIA, Format, FormatParameter, encoded
from api.twins.figure_schemas import UNITS, TwinFigures, WindowFigures
from api.twins.figures import figures, table_of
from api.twins.note_routes import NotesDep
from api.twins.routes import TwinId, TwinsDep
from api.twins.window_tally import WINDOW_UNITS
from api.twins.windows import HOUR_S, By, Shifts
from station.shifts import DAY_H

router = APIRouter(prefix="/v1/twins", tags=["twins"], route_class=JsonRoute)


def _second(about: str, example: int) -> Any:
    return Query(ge=0, le=FAR, description=about, json_schema_extra={"unit": "s"}, examples=[example])


FromSecond = Annotated[int | None, _second("First second counted; the first that is kept if left out", 0)]
ToSecond = Annotated[int | None, _second("End of the last second counted; of the newest if left out", 28_800)]
ShiftParameter = Annotated[
    int | None,
    Query(
        ge=1, le=DAY_H,
        description="Length of a shift, if not that of the station; 24 should be a multiple of it",
        json_schema_extra={"unit": "h"}, examples=[8],
    ),
]  # fmt: skip

_FILES: dict[int | str, dict[str, Any]] = {
    200: {
        "model": TwinFigures,
        "description": "The figures in the format asked for",
        "content": {
            "text/csv": {"schema": {"type": "string"}},
            MEDIA[Format.PARQUET]: {"schema": {"type": "string", "format": "binary"}},
        },
    }
}


@router.get("/{twin_id}/figures", responses=_FILES, response_model=TwinFigures)
def get_twin_figures(
    twin_id: TwinId, twins: TwinsDep, from_s: FromSecond = None, to_s: ToSecond = None,
    by: Annotated[By, Query(description="What the stretch is cut into", examples=["shift"])] = By.WINDOW,
    shift_h: ShiftParameter = None, form: FormatParameter = Format.JSON,
) -> Response:  # fmt: skip
    """Vehicles, waits, hydrogen, energy and cost of any stretch of a twin's record, as `days` has them of its days."""
    shifts = Shifts.of(twins.scenario(twin_id).station, shift_h)
    found = figures(twins, twin_id, from_s, to_s, by, shifts)
    if form is Format.JSON:
        items = [WindowFigures.model_validate(each) for each in found]
        answer = TwinFigures(twin=twin_id, by=by, shift_h=shifts.length // HOUR_S, units=UNITS, items=items)
        return Response(answer.model_dump_json(), media_type=MEDIA[form])
    content = encoded(table_of(found), WINDOW_UNITS, form)
    return pieces.answer(pieces.slices(memoryview(content)), MEDIA[form])


@router.get("/{twin_id}/report", response_class=HTMLResponse)
def get_twin_report(
    twin_id: TwinId, twins: TwinsDep, notes: NotesDep, from_s: FromSecond = None, to_s: ToSecond = None,
    by: Annotated[By, Query(description="By what its table of windows is cut", examples=["shift"])] = By.SHIFT,
    shift_h: ShiftParameter = None,
) -> HTMLResponse:  # fmt: skip
    """A stretch of a twin's record as one self-contained page to be printed: figures, alarms, notes, curves."""
    from api.pictures import REPORT_HEADERS
    from api.twins import report  # it draws: slow to import

    shifts = Shifts.of(twins.scenario(twin_id).station, shift_h)
    page = report.html(twins, notes, twin_id, from_s, to_s, by, shifts)
    return HTMLResponse(page, headers=REPORT_HEADERS)
