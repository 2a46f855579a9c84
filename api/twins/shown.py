"""A twin as it is shown: what is stored of it, and what it has told since where it lives here."""

from __future__ import annotations

from typing import Any

from api.moments import written
from api.store.records import StoredTwin
from api.twins.days import document
from api.twins.live import LiveTwin
from api.twins.messages import CERTIFIED, UNCERTIFIED, Sample, measured_layout
from api.twins.schemas import ALIVE, CHANGEABLE, Source, TwinStateName
from api.twins.state_schemas import AlarmCounts, TwinState, TwinToday
from station.plants.thesis import THESIS


def state_of(stored: StoredTwin, live: LiveTwin | None, current: Sample | None) -> TwinState:
    """A twin as it stands, with its last sample where that is given."""
    settings = settings_now(stored, live)
    return TwinState(
        id=stored.id,
        state=live.state if live else TwinStateName(stored.state),
        scenario=settings["scenario"]["name"],
        station=(settings.get("station") or settings["scenario"]["station"])["name"],
        calibration=settings.get("calibration"),
        **{name: settings.get(name) for name in ("of", "at_s", "from_s", "to_s")},
        layout=layout_of(stored),
        source=Source(settings.get("source", Source.SIMULATED)),
        service=CERTIFIED if settings.get("certificate") else UNCERTIFIED,
        **{name: settings[name] for name in ("controller", "speed", "at_end", "replication", "seed")},
        epoch=live.epoch if live else stored.epoch,
        samples=max(stored.samples, current.seq + 1 if current else 0),
        events=max(stored.events, live.journal.events if live else 0),
        alarms=_counts(live),
        today=_today(live),
        newest_sent=live.current.sent if live and live.current else None,
        created=written(stored.created),
        values=current.document()["values"] if current else None,
        ticks_late=live.ticks_late if live else 0,
        lateness_max_s=live.lateness_max_s if live else 0.0,
    )


def settings_now(stored: StoredTwin, live: LiveTwin | None) -> dict[str, Any]:
    """The settings of a twin as they are now."""
    if live is None:
        return stored.settings
    return {**stored.settings, **live.request.model_dump(mode="json", include=CHANGEABLE)}


def layout_of(stored: StoredTwin) -> str:
    """Layout of a twin's samples."""
    if stored.settings.get("plays") is not None:
        return str(stored.settings["plays"])
    plant = str(stored.settings["scenario"]["station"].get("plant", THESIS.name))
    return measured_layout(plant) if stored.settings.get("source") == Source.MEASURED else plant


def _counts(live: LiveTwin | None) -> AlarmCounts | None:
    """How many alarms of a twin are shown; None where it has none of its own."""
    if live is None or live.alarms is None or live.state not in ALIVE:
        return None
    shown = live.alarms.announced
    unacknowledged = sum(alarm.pending for alarm in shown)
    highest = shown[0].rule.priority if shown else None
    return AlarmCounts(announced=len(shown), unacknowledged=unacknowledged, highest=highest)


def _today(live: LiveTwin | None) -> TwinToday | None:
    """Figures of the running day of a simulated twin; None of another, and before its first second."""
    if live is None or live.state not in ALIVE or live.request.source is not Source.SIMULATED:
        return None
    figures = live.days.running()
    if figures is None:
        return None
    plain = document(figures)
    return TwinToday.model_validate({name: plain[name] for name in TwinToday.model_fields})
