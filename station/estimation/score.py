"""Events against the faults that were there: found, missed, false, and how late and how wrong."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field, ValidationError

from station.errors import InputError
from station.estimation.detection import untellable
from station.faults.kinds import Fault, Faults
from station.faults.sensors import ClockSkew, SensorAbsent, SensorDrift, SensorOffset
from station.files import parse_file
from station.measurement import TagMap
from station.quantities import Part
from station.sensor_names import BANK_SENSORS, DETECTABLE, VEHICLE_SENSORS

if TYPE_CHECKING:
    from pathlib import Path

    from station.estimation.detection import Event
    from station.parameters import Station

AFTERWARDS = 600.0
"""An event found so long after the end of its fault [s] still tells it."""


class _Truth(Part):
    faults: Annotated[Faults, Field(min_length=1)]


def load_truth(path: Path) -> list[Fault]:
    """The faults of a record (.parquet), or of a TOML or JSON file: of a scenario, or one of `faults` alone.

    Raises
    ------
    InputError
        naming each wrong field with its limit, or the file that cannot be read; none where a record has no faults.
    """
    if path.suffix == ".parquet":
        from station.record import Record

        try:
            return list(Record.from_parquet(path).scenario.faults)
        except (OSError, ValueError, KeyError) as error:
            raise InputError(str(path), [("", f"must be a record of a run: {error!s:.200}")]) from None
    given = parse_file(path, str(path))
    try:
        return list(_Truth.model_validate({"faults": given.get("faults", [])}).faults)
    except ValidationError as error:
        raise InputError.of(str(path), error) from None


def untold(fault: Fault, tags: TagMap, station: Station) -> str | None:
    """Why a twin of a station with these tags can tell nothing of a fault, whatever happens; None where it can."""
    on_change = {tag.sensor: tag.on_change for tag in tags.tags}
    sensor = getattr(fault, "sensor", None)
    if sensor is not None and sensor not in on_change:
        return f"no tag tells {sensor}"
    if isinstance(fault, SensorAbsent) and on_change[fault.sensor]:
        return f"{sensor} is told when it changes: nobody can tell whether it is silent"
    if isinstance(fault, ClockSkew):
        return None
    if fault.event not in DETECTABLE or (isinstance(fault, SensorOffset) and sensor in VEHICLE_SENSORS):
        return f"each vehicle brings a {sensor} of its own, and what one is off as it comes is all that is known of it"
    if isinstance(fault, SensorDrift) and sensor in BANK_SENSORS:
        if not station.calibrated:
            return f"drift of {sensor} is told where the station was calibrated"
        if sensor.partition("_")[2] in station.unknown_buffers:
            return "the calibration's day did not tell that buffer's volume"
    if fault.event in untellable(on_change):
        return "a bank whose pressure no tag tells may cause it"
    if fault.event in untellable(on_change, station.unknown_buffers):
        return f"the calibration's day did not tell the volume of {', '.join(station.unknown_buffers)}"
    return None


def score(events: list[Event], faults: list[Fault], tags: TagMap, station: Station) -> dict[str, Any]:
    """How events tell the faults that were there.

    Each fault takes the first event of its name that was found while it was there, or AFTERWARDS; later ones of that
    spell repeat it, and every other event is false. A clock is judged as a whole, without a delay.

    Returns
    -------
    dict
        `faults`, one entry a fault: `name`, `begin_s`, `found`, `delay_s`, `begin_error_s`, `size_error` and its `unit`
        (None where there is none), and `untold`, why it could not be found (None: it could); counts `found`, `missed`
        and `false`; `false_events`, their names.
    """
    judged, told = [], set()
    for fault in faults:
        matching = [k for k, event in enumerate(events) if _tells(event, fault)]
        told.update(matching)
        found = _judged(fault, events[matching[0]] if matching else None)
        judged.append({**found, "untold": None if matching else untold(fault, tags, station)})
    wrong = [event.name for k, event in enumerate(events) if k not in told]
    count = sum(each["found"] for each in judged)
    return {
        "faults": judged,
        "found": count,
        "missed": len(judged) - count,
        "false": len(wrong),
        "false_events": wrong,
    }


def _tells(event: Event, fault: Fault) -> bool:
    if event.name != fault.event:
        return False
    return isinstance(fault, ClockSkew) or fault.begin_s <= event.found_s <= fault.until + AFTERWARDS


def _judged(fault: Fault, event: Event | None) -> dict[str, Any]:
    size = fault.size
    timed = event is not None and not isinstance(fault, ClockSkew)
    return {
        "name": fault.event,
        "begin_s": fault.begin_s,
        "found": event is not None,
        "delay_s": event.found_s - fault.begin_s if event and timed else None,
        "begin_error_s": event.begin_s - fault.begin_s if event and timed else None,
        "size_error": event.size - size[0] if event and size else None,
        "unit": size[1] if size else None,
    }
