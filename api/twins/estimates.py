"""What a measured twin estimates: its newest sample, taken apart."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from api.http.pagination import FAR
from api.http.problems import conflict
from api.http.timeseries import Selection
from api.twins.health import health_of, unknown_in
from api.twins.measured import MeasuredTwin
from api.twins.measurement_schemas import DetectedEvent, Estimate, EstimatedQuantity, SampleCounts, SensorReading
from api.twins.messages import EventKind, Sample, is_measured
from api.twins.queries import TwinQueries
from api.twins.schemas import of_faults
from station import Scenario
from station.estimation.ailments import ailments
from station.estimation.detection import Event
from station.estimation.filter import ROBUST, STATES, Followed, model_of
from station.estimation.verdict import coarse_sensors, judged, most_ail
from station.faults.kinds import PlantFault
from station.measurement import Tag
from station.run import PERIOD
from station.sensor_names import ANALOG

JUDGED_S = 3600.0
"""The model is judged by so many of the newest seconds [s]."""

JUDGED_FROM_S = 2700.0
"""And from so many on: an event at the beginning then leaves more than half of them. Before, most sensors must seem to
fail at once [s]."""

EVENTS_MAX = 1000
"""Detected events looked at, the last ones."""


def estimate_of(twins: TwinQueries, twin_id: str) -> Estimate:
    """The newest estimate of a twin.

    Raises
    ------
    ProblemError
        404 where there is no such twin; 409 where it is simulated, or has followed no second yet.
    """
    sample, live = twins.current(twin_id), twins.live(twin_id)
    if sample is None or not is_measured(sample.layout):
        why = "has followed no second yet" if twins.measures(twin_id) else "is simulated: nothing is estimated"
        raise conflict(f"twin {twin_id!r} {why}")
    figures = {name: None if math.isnan(each) else each for name, each in zip(sample.columns, sample.row, strict=True)}
    units = sample.columns
    measured = live if isinstance(live, MeasuredTwin) else None
    quantities = {
        name: EstimatedQuantity(
            value=figures[f"estimate_{name}"], deviation=figures[f"deviation_{name}"], unit=units[f"estimate_{name}"]
        )
        for name in _names(units, "estimate_")
    }
    events = detected(twins, twin_id)
    first = twins.station_seq(twin_id)  # what was estimated of another station says nothing of this one
    refused = _refused(twins, twin_id, sample, events, () if measured is None else measured.active, first)
    followed, station = sample.seq - first, twins.scenario(twin_id).station
    unsure, scale, hidden = bool(refused), model_of(station).scale_of(station), station.unknown_buffers
    return Estimate(
        twin=twin_id,
        epoch=sample.epoch,
        seq=sample.seq,
        source_time=sample.row[1],
        quantities=quantities,
        refused=refused,
        health=health_of(quantities, followed, refused=unsure, scale=scale, unknown_buffers=hidden),
        unknown=unknown_in(quantities, followed, refused=unsure, scale=scale, unknown_buffers=hidden),
        sensors={
            name: SensorReading(
                value=figures[f"measured_{name}"],
                innovation=figures.get(f"innovation_{name}"),
                error=figures.get(f"error_{name}"),
                unit=units[f"measured_{name}"],
            )
            for name in _names(units, "measured_")
        },
        events=events,
        lasting=None if measured is None else list(measured.active),
        number=None if measured is None else measured.taken,
        samples=None if measured is None else SampleCounts(**measured.counts._asdict()),
    )


def _names(columns: dict[str, str], head: str) -> list[str]:
    return [name.removeprefix(head) for name in columns if name.startswith(head)]


def _refused(
    twins: TwinQueries, twin_id: str, sample: Sample, events: list[DetectedEvent], lasting: tuple[str, ...], first: int
) -> list[str]:
    """Why the model is refused by the last JUDGED_S seconds, as `hrs follow` would; no line where it is not."""
    columns, readings = ([f"{kind}_{name}" for name in ANALOG] for kind in ("innovation", "measured"))
    states = [f"estimate_{name}" for name in STATES]
    begin = max(float(first), sample.row[0] - JUDGED_S)
    found = twins.columns(twin_id, Selection(("source_time", *states, *columns, *readings), start=begin))
    innovations = np.column_stack([found[name] for name in columns])
    if not len(innovations):
        return []
    nothing = np.zeros((len(innovations), 0))
    followed = Followed(np.column_stack([found[name] for name in states]), nothing, innovations, nothing, ROBUST.gate)
    start = float(found["source_time"][0])
    told = [_event(each) for each in events if each.found_s >= start or each.name in lasting]
    earlier = [_event(each) for each in events if each.found_s < start and each.name not in lasting]
    noise = {tag.sensor: tag.deviation for tag in _tags(twins, twin_id)}
    coarse = coarse_sensors(
        np.column_stack([found[name] for name in readings]), np.array([noise.get(name, np.inf) for name in ANALOG])
    )
    fits, why = judged(followed, start, told, coarse, earlier)
    return why if len(innovations) >= JUDGED_FROM_S or most_ail(told, fits) else []


def _tags(twins: TwinQueries, twin_id: str) -> list[Tag]:
    """The tags of a measured twin, or of the one that a replay plays; none where that is no more."""
    request = twins.request_of(twin_id)
    if request.tags is None and request.of is not None:
        return _tags(twins, request.of) if twins.known(request.of) else []
    return [] if request.tags is None else request.tags.tags


class Ailing(NamedTuple):
    """A station with the faults that were found and last."""

    scenario: Scenario
    doubt: str = ""  # why none was taken over although something was found; "" where there is no doubt


def ailing(twins: TwinQueries, twin_id: str) -> Ailing:
    """The scenario of a twin that follows measurements, with the faults that were found and last.

    They take the place of those that the scenario has, which nobody knows of. Where the model is refused there are
    none: what it takes for a fault may be none. Nor where the scenario has a disturbance, which goes with no fault.

    Raises
    ------
    ProblemError
        as `estimate_of`.
    """
    scenario, estimate, sample = twins.scenario(twin_id), estimate_of(twins, twin_id), twins.current(twin_id)
    if not estimate.lasting or sample is None:
        return Ailing(of_faults(scenario, []) if scenario.faults else scenario)
    found = _ailments_of(estimate, sample)
    if found and estimate.refused:
        return Ailing(of_faults(scenario, []), "the model is refused: what it takes for faults may be none")
    if found and scenario.disturbance is not None:
        return Ailing(of_faults(scenario, []), "a scenario with a disturbance has no faults")
    return Ailing(of_faults(scenario.model_copy(update={"idle_period_s": int(PERIOD)}), found))


def _ailments_of(estimate: Estimate, sample: Sample) -> list[PlantFault]:
    """Faults of the plant that last, in the twin's time."""
    estimates = {name: each.value for name, each in estimate.quantities.items() if each.value is not None}
    told = [_event(each) for each in estimate.events if each.size is not None]
    return ailments(told, estimate.lasting or (), estimates, sample.row[1] - sample.row[0])


def _event(told: DetectedEvent) -> Event:
    return Event(
        told.name, told.begin_s, told.found_s, told.size or 0.0, told.unit, size_deviation=told.size_deviation
    )  # fmt: skip


def detected(twins: TwinQueries, twin_id: str) -> list[DetectedEvent]:
    """The events detected so far, each as it was told last."""
    found: dict[tuple[str, float], dict[str, Any]] = {}
    for event in twins.last_events(twin_id, FAR, EVENTS_MAX, (EventKind.DETECTED,)):
        found[event["details"]["name"], event["details"]["found_s"]] = event["details"]
    return [DetectedEvent.model_validate(each) for each in found.values()]
