"""The filter of `station.estimation.filter` over seconds as they come: the same bytes, however they are split."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from station.archives import arrays_under, pack, refuse_other_shapes, unpack
from station.errors import InputError
from station.estimation.belief import Belief
from station.estimation.drift_watch import DriftWatch
from station.estimation.filter import FIRST_SECONDS, ROBUST, Drifts, Followed, Tuning, looks_for_drift, model_of
from station.estimation.power import with_flow_of_power
from station.estimation.valves.memory import STUCK, none_found
from station.estimation.valves.watch import ValveWatch
from station.frames import RAW, Frames, as_kept_now, kept_frames
from station.parameters import Station

__all__ = ["OnlineFilter"]


class OnlineFilter:
    """Follow a record whose seconds come a few at a time, and go on later from a snapshot.

    The first minute is held back, since the first second is estimated from it; after that the newest second is, since
    what the next one tells of the vehicle counts for it. Estimates are those of one `follow` over all the seconds.

    Parameters
    ----------
    station : Station
        The station as it is known.
    tuning : Tuning
        How soft the model is.

    Raises
    ------
    InputError
        if the station's plant is not followed.
    """

    def __init__(self, station: Station, tuning: Tuning = ROBUST) -> None:
        self._model = model_of(station)
        self._station, self._tuning, self._constants = station, tuning, self._model.constants_of(station)
        self._scratch: Any = None
        self._watch = DriftWatch(station, self._model, self._constants) if looks_for_drift(station, tuning) else None
        self._valves = ValveWatch(station, self._model, compares=tuning == ROBUST) if tuning.leak > 0.0 else None
        self._curve = self._model.power_of(station)
        self._held: Frames | None = None
        self._ready: Frames | None = None  # the same as the filter reads them: flows of powers, valves that stick
        self._stuck = none_found(0)  # of the seconds held

    @property
    def next_second(self) -> float | None:
        """Time of the second that must come next [s]; None where any may, before the first."""
        return None if self._held is None else self._held.start + len(self._held)

    @property
    def held(self) -> Frames | None:
        """The seconds held back, as they were taken; None before the first."""
        return self._held

    def joined(self, frames: Frames) -> Frames:
        """The seconds held back and these.

        Raises
        ------
        InputError
            if the seconds do not follow, or a sensor's relative noise or time constant is another.
        """
        held = self._held
        if held is None:
            return frames
        if frames.start != self.next_second:
            raise InputError("seconds", [("start", f"must be {self.next_second} s; given {frames.start}")])
        for name in ("relative", "time_constants"):
            if not np.array_equal(getattr(frames, name), getattr(held, name)):
                raise InputError("seconds", [(name, "must be that of the seconds before")])
        return held.followed_by(frames)

    def push(self, frames: Frames) -> Followed:
        """Take the seconds that follow those taken so far, and give the estimates that no later second can change.

        Raises
        ------
        InputError
            if the seconds do not follow, or a flow meter's relative noise is another; nothing is taken then.
        """
        held = self.joined(frames)
        ready = with_flow_of_power(frames, self._curve)
        if self._valves is not None:
            ready, stuck = self._valves.advance(ready)
            self._stuck = np.concatenate([self._stuck, stuck])
        self._held, self._ready = held, ready if self._ready is None else self._ready.followed_by(ready)
        early = self._scratch is None and len(held) < FIRST_SECONDS
        return self._advance(0 if early else max(len(held) - 1, 0))

    def close(self) -> Followed:
        """The estimates of the seconds held back, there being no later ones."""
        if self._held is None:
            raise InputError("record", [("", "must hold at least one second")])
        return self._advance(len(self._held))

    def belief(self) -> Belief | None:
        """The belief before the next second; None while the first minute is held back."""
        if self._scratch is None:
            return None
        return self._model.belief_of(self._scratch, self._station, self._constants)

    def snapshot(self) -> bytes:
        """Everything the filter needs to go on, as an archive of arrays of less than 150 kB."""
        arrays: dict[str, np.ndarray] = {}
        if self._scratch is not None:
            arrays |= {f"scratch_{name}": each for name, each in self._scratch._asdict().items()}
        if self._held is not None:
            arrays |= self._held.arrays()
        if self._ready is not None:
            arrays |= {"ready_values": self._ready.values, "ready_noise": self._ready.noise}
            arrays["ready_raw"] = self._ready.as_read()
        if self._valves is not None:
            arrays |= {f"valves_{name}": each for name, each in self._valves.snapshot().items()}
            arrays["stuck"] = self._stuck
        if self._watch is not None:
            arrays |= {f"watch_{name}": each for name, each in self._watch.snapshot().items()}
        return pack(arrays)

    def restore(self, snapshot: bytes) -> None:
        """Go on from a snapshot of a filter with the same station and tuning.

        Raises
        ------
        InputError
            if it is none that a filter could have written; the filter is as it was.
        """
        given = unpack(snapshot)
        before = arrays_under(given, "scratch_")
        fresh = self._model.scratch()
        if before:
            refuse_other_shapes(before, fresh._asdict())
        held = ready = kept_frames(given)
        if held is not None:
            like = {"ready_values": held.values, "ready_noise": held.noise, "ready_raw": np.zeros((len(held), RAW))}
            refuse_other_shapes(given, like)
            ready = replace(held, values=given["ready_values"], noise=given["ready_noise"], raw=given["ready_raw"])
        if self._valves is not None:
            count = 0 if held is None else len(held)
            refuse_other_shapes(given, {"stuck": np.zeros((count, STUCK))})
            self._valves.restore(arrays_under(given, "valves_"))
            self._stuck = given["stuck"]
        if self._watch is not None:
            self._watch.restore(arrays_under(given, "watch_"))
        self._held, self._ready = held, ready
        self._scratch = type(fresh)(*(before[name] for name in fresh._fields)) if before else None

    def begin_anew(self, snapshot: bytes) -> None:
        """Begin with the seconds that a filter held back, whatever it estimated: that of another version, say.

        Raises
        ------
        InputError
            if these seconds cannot be read.
        """
        self._held, self._scratch = kept_frames(as_kept_now(unpack(snapshot))), None
        self._ready = None if self._held is None else with_flow_of_power(self._held, self._curve)
        self._stuck = none_found(0 if self._held is None else len(self._held))

    def _advance(self, rows: int) -> Followed:
        """Follow so many of the seconds held, and hold the others."""
        if self._held is None or self._ready is None:
            return self._nothing()
        found = self._follow(self._ready, rows) if rows else self._nothing()
        self._held, self._ready = _rest(self._held, rows), _rest(self._ready, rows)
        return found

    def _nothing(self) -> Followed:
        """Estimates of no second."""
        none = Followed.empty(0, len(self._model.states), self._tuning.gate)
        drifts = None if self._watch is None else Drifts.of_nothing()
        return replace(none, drifts=drifts, stuck=None if self._valves is None else none_found(0))

    def _follow(self, held: Frames, rows: int) -> Followed:
        drifts = None
        if self._watch is not None:
            held, drifts = self._watch.advance(held, rows)
        if self._scratch is None:
            self._scratch = self._model.begin(held, self._station, self._tuning, self._constants)
        found = self._model.advance(held, rows, self._scratch, self._station, self._tuning, self._constants)
        if self._valves is None:
            return replace(found, drifts=drifts)
        stuck, self._stuck = self._stuck[:rows], self._stuck[rows:]
        return replace(found, drifts=drifts, stuck=stuck)


def _rest(frames: Frames, rows: int) -> Frames:
    """All seconds but the first so many, in arrays of their own."""
    rest = frames.part(rows, len(frames))
    raw = None if rest.raw is None else rest.raw.copy()
    return replace(rest, values=rest.values.copy(), noise=rest.noise.copy(), raw=raw)
