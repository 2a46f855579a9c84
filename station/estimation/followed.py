"""A real station followed second by second: batches in, estimates out, going on later from a snapshot."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from station.archives import arrays_under, pack, refuse_other_shapes, unpack
from station.batches import Batch, tag_places
from station.errors import InputError
from station.estimation.assembly import LATENESS, Assembler, Counts
from station.estimation.belief import Belief
from station.estimation.clock_shift import SKEW_MAX, ClockShift
from station.estimation.clock_watch import BLOCK, ClockWatch
from station.estimation.detection import Detector, Event
from station.estimation.filter import Followed, model_of, model_of_plant
from station.estimation.online import OnlineFilter
from station.frames import Frames, told_each_second
from station.geometry import BUFFERS
from station.measurement import TagMap, unit_of
from station.parameters import Station
from station.plants.thesis import THESIS
from station.sensor_names import ANALOG, DETECTABLE, SENSORS

SNAPSHOT_VERSION = 20


@dataclass(frozen=True, eq=False)
class FollowedSeconds:
    """Seconds that are followed and that no later sample can change, and the events that they told."""

    time: NDArray[np.float64]  # (n,) [s]
    states: NDArray[np.float64]  # (n, states) estimates; NaN of a vehicle that is not there
    deviations: NDArray[np.float64]  # (n, states) their standard deviations, by what is not sure of the volumes, too
    innovations: NDArray[np.float64]  # (n, len(ANALOG)) in standard deviations; NaN where nothing was read
    errors: NDArray[np.float64]  # (n, len(ANALOG)) in the sensor's unit
    measured: NDArray[np.float64]  # (n, len(SENSORS)) in the sensor's unit; NaN where nothing is known
    lasting: NDArray[np.bool_]  # (n, len(DETECTABLE)) which events last after each second
    skew: NDArray[np.float64]  # (n,) by how much the clock of a source is fast that is most so, of those found [s]
    events: tuple[Event, ...]  # as a `Detector` tells them: `detection.latest` takes the last word of each
    anew: float | None = None  # the second with which estimates began anew, as a clock was put right [s]

    def __len__(self) -> int:
        return len(self.time)

    @classmethod
    def joined(cls, parts: Sequence[FollowedSeconds]) -> FollowedSeconds:
        """Seconds that follow each other as one; at least one part."""
        arrays = {name: np.concatenate([getattr(part, name) for part in parts]) for name in _ARRAYS}
        anew = [part.anew for part in parts if part.anew is not None]
        events = tuple(event for part in parts for event in part.events)
        return cls(**arrays, events=events, anew=anew[-1] if anew else None)

    def table(self) -> NDArray[np.float64]:
        """All of it but the events, a row a second, with the columns of `followed_columns`."""
        return np.column_stack((self.states, self.deviations, self.innovations, self.errors, self.measured))


_ARRAYS = ("time", "states", "deviations", "innovations", "errors", "measured", "lasting", "skew")


def followed_columns(plant: str = THESIS.name) -> dict[str, str]:
    """The columns of `FollowedSeconds.table` in their order, with their units.

    Parameters
    ----------
    plant : str
        Name of the station's plant.
    """
    states = model_of_plant(plant).states
    return {
        **{f"estimate_{name}": unit for name, unit in states.items()},
        **{f"deviation_{name}": "K" if unit == "degC" else unit for name, unit in states.items()},
        **{f"innovation_{name}": "" for name in ANALOG},
        **{f"error_{name}": "K" if unit_of(name) == "degC" else unit_of(name) for name in ANALOG},
        **{f"measured_{name}": unit_of(name) for name in SENSORS},
    }


class FollowedRun:
    """A station followed by batches of its measurements, for as long as wanted.

    In whatever batches samples come, as long as none is late, the seconds are those of `follow` over the whole record,
    bit for bit; and they are from a snapshot on. Where a source's clock is found to be fast or slow its readings are
    put right from then on, and estimates begin anew.

    Parameters
    ----------
    station : Station
        The station as it is known.
    tags : TagMap
        What the tags of batches are; each with a name of its own.
    skew : dict, optional
        By how much the clock of a source is fast [s].
    lateness : float
        How long samples are waited for, by the time of the data [s].

    Raises
    ------
    InputError
        if the station's plant is not followed, or a tag's name or the lateness is refused.
    """

    def __init__(
        self, station: Station, tags: TagMap, skew: dict[str, float] | None = None, lateness: float = LATENESS
    ) -> None:
        tag_places(tags)
        self._station, self._tags = station, tags
        self._given = tags, skew, lateness
        self._assembler = Assembler(tags, skew, lateness)
        self._shift = ClockShift(tags)
        self._states = len(model_of(station).states)
        self._begin()
        self.over, self._plant = False, station.plant
        self.renewed = False  # whether it began anew from what another version left
        given = [station.model_dump(mode="json"), tags.model_dump(mode="json"), sorted((skew or {}).items()), lateness]
        self._key = hashlib.sha256(json.dumps(given, sort_keys=True).encode()).hexdigest()

    @property
    def counts(self) -> Counts:
        """Counts of the samples so far, by what became of them."""
        return self._assembler.counts

    @property
    def newest(self) -> float | None:
        """Time of the newest sample taken [s]; None before the first."""
        return self._assembler.newest

    @property
    def active(self) -> tuple[str, ...]:
        """Names of the events that last, in order."""
        skewed = (name for name, _ in self._skews())
        return tuple(sorted((*self._detector.active, *skewed)))

    @property
    def skew(self) -> dict[str, int]:
        """By how much the clock of each source but that of the valves was found to be fast [s]."""
        return dict(self._shift.skew)

    @property
    def next_second(self) -> float | None:
        """Time of the next second to be followed [s]; None before the first sample."""
        held = self._filter.held
        return self._assembler.next_second if held is None else held.start

    def _begin(self) -> None:
        """Begin to estimate."""
        self._filter = OnlineFilter(self._station)
        self._detector = Detector(told_each_second(self._tags.tags), self._station)
        self._watch = ClockWatch(self._station, self._tags)

    def _skews(self) -> list[tuple[str, int]]:
        """Names of the events of clocks that are fast or slow, and by how much [s]."""
        return [(f"clock_skew_{source}", skew) for source, skew in self._shift.skew.items() if skew]

    def belief(self) -> Belief | None:
        """The belief before the second behind the last one followed; None before the first."""
        return self._filter.belief()

    def push(self, batch: Batch) -> FollowedSeconds:
        """Take a batch, and give the seconds that it completes.

        Raises
        ------
        InputError
            if the run has ended, or the batch is refused; nothing is taken then.
        """
        if self.over:
            raise InputError("run", [("", "must not have ended: no batch can be taken")])
        return self._follow(self._assembler.push(batch), finish=False)

    def finish(self) -> FollowedSeconds:
        """End the run, and give the seconds that were held back."""
        if self.over:
            return self._follow(None, finish=False)
        found = self._follow(self._assembler.close(), finish=True)
        self.over = True
        return found

    def moved(self, station: Station) -> tuple[FollowedRun, list[Event]]:
        """A run that goes on from here with another station and takes this one's place, and this one's last events.

        The seconds held back are the first that it follows. What was estimated of another station counts no more:
        filter and detection begin anew, with the first minute held back.

        Raises
        ------
        InputError
            if the run has ended, or the station has another plant, whose estimates are others.
        """
        if self.over:
            raise InputError("run", [("", "must not have ended: it follows nothing more")])
        if station.plant != self._plant:
            raise InputError("station", [("plant", f"must stay {self._plant!r}; given {station.plant!r}")])
        run = FollowedRun(station, *self._given)
        run._assembler, run._shift = self._assembler, self._shift
        if (held := self._filter.held) is not None:
            run._advance(held)
        return run, self._detector.finish()

    def snapshot(self) -> bytes:
        """Everything needed to go on in another process, as an archive of arrays."""
        parts = {
            "assembly": self._assembler.snapshot(), "detector": self._detector.snapshot(),
            "shift": self._shift.snapshot(), "watch": self._watch.snapshot(),
        }  # fmt: skip
        arrays = {f"{part}_{name}": array for part, given in parts.items() for name, array in given.items()}
        arrays |= {"version": np.array(SNAPSHOT_VERSION), "key": np.array(self._key), "over": np.array(self.over)}
        arrays["filter"] = np.frombuffer(self._filter.snapshot(), np.uint8)
        return pack(arrays)

    @classmethod
    def restore(
        cls, station: Station, tags: TagMap, snapshot: bytes, skew: dict[str, float] | None = None,
        lateness: float = LATENESS,
    ) -> FollowedRun:  # fmt: skip
        """A run that goes on from a snapshot of one with the same station, tags, skew and lateness.

        What another version estimated cannot be read: from such a snapshot samples and seconds go on, while filter and
        detection begin anew (`renewed`), with the first minute held back.

        Raises
        ------
        InputError
            if it cannot be read, or is one of this version of another station or other tags.
        """
        run = cls(station, tags, skew, lateness)
        arrays = unpack(snapshot)
        like = {"version": np.array(SNAPSHOT_VERSION), "key": np.array(run._key), "over": np.array(False)}
        refuse_other_shapes(arrays, like)
        run.renewed = int(arrays["version"]) != SNAPSHOT_VERSION
        if str(arrays["key"]) != run._key and not run.renewed:  # a version may have more fields than another
            raise InputError("snapshot", [("key", "must be that of the same station, tags, skew and lateness")])
        assembly = arrays_under(arrays, "assembly_")
        if run.renewed:  # versions up to 6 had no tag that is told when it changes
            fresh = run._assembler.snapshot()  # and those up to 10 none that was heard by sources
            assembly = {**{name: fresh[name] for name in ("last", "heard", "newest_of")}, **assembly}
        run._assembler.restore(assembly)
        if not run.renewed or "shift_skew" in arrays:  # seconds go on by the clocks that were found
            run._shift.restore(arrays_under(arrays, "shift_"), renewed=run.renewed)
        estimated = arrays["filter"].tobytes() if "filter" in arrays else b""
        if run.renewed:
            run._filter.begin_anew(estimated)
        else:
            run._detector.restore(arrays_under(arrays, "detector_"))
            run._watch.restore(arrays_under(arrays, "watch_"))
            run._filter.restore(estimated)
        run.over = bool(arrays["over"])
        return run

    def _follow(self, frames: Frames | None, *, finish: bool) -> FollowedSeconds:
        """Follow seconds that are closed; `finish`: and those held back."""
        if frames is None:
            return self._nothing()
        parts = []
        for block in frames.blocks(BLOCK) if self._watch.looks else (frames,):
            parts.append(self._advance(self._shift.push(block)))
            if len(block) and (block.start + len(block)) % BLOCK == 0:
                parts.append(self._look(block.start + len(block)))
        if finish and (rest := self._shift.close()) is not None:
            parts.append(self._advance(rest, finish=True))
        return FollowedSeconds.joined(parts)

    def _advance(self, frames: Frames, *, finish: bool = False) -> FollowedSeconds:
        """Follow seconds whose clocks are put right."""
        taken = self._filter.joined(frames)
        parts = [self._filter.push(frames)]
        if finish:
            parts.append(self._filter.close())
        followed = Followed.joined(parts)
        done = taken.part(0, len(followed.states))
        events = self._detector.feed(done, followed)
        lasting = self._detector.lasting
        self._watch.watch(done, lasting)
        skew = max((skew for _, skew in self._skews()), key=abs, default=0)
        known = replace(followed, deviations=deviations_of(followed, self._station))
        return _seconds(done, known, lasting, skew, (*events, *(self._detector.finish() if finish else ())))

    def _look(self, now: float) -> FollowedSeconds:
        """Look at the clocks at the end of a block; where one is wrong it is put right, and estimates begin anew."""
        found = self._watch.end_block()
        if found is None or abs(skew := self._shift.skew[found.source] + found.shift) > SKEW_MAX:
            return self._nothing()
        self._shift.skew[found.source] = skew
        told, held = self._detector.finish(), self._filter.held
        if skew:
            about = found.begin if found.right is None else max(found.begin, found.right)
            name, size = f"clock_skew_{found.source}", float(skew)
            told.append(Event(name, about, now, size, "s", begin_low_s=found.right, begin_high_s=now))
        self._begin()
        if held is not None:
            self._advance(held)
        return replace(self._nothing(), events=tuple(told), anew=self.next_second)

    def _nothing(self) -> FollowedSeconds:
        """No second."""
        nothing, unread = np.zeros((0, self._states)), np.zeros((0, len(ANALOG)))
        measured, no_event = np.zeros((0, len(SENSORS))), np.zeros((0, len(DETECTABLE)), np.bool_)
        return FollowedSeconds(
            np.zeros(0), nothing, nothing, unread, unread, measured, no_event, np.zeros(0), ()
        )  # fmt: skip


def deviations_of(followed: Followed, station: Station) -> NDArray[np.float64]:
    """Standard deviations of estimates, (seconds, states): the filter's, and of masses what is not sure of the volumes.

    A filter takes its station's parameters for true. What its file says of the volumes, `volume_deviations_percent`, is
    of masses in proportion.
    """
    found = followed.deviations.copy()
    for name, percent in station.volume_deviations_percent.items():
        bank = BUFFERS.index(name)
        found[:, bank] = np.hypot(found[:, bank], percent / 100.0 * followed.states[:, bank])
    return found


def _seconds(
    frames: Frames, followed: Followed, lasting: NDArray[np.bool_], skew: int, events: tuple[Event, ...]
) -> FollowedSeconds:  # fmt: skip
    """Frames and what the filter says of them."""
    time = frames.start + np.arange(len(frames), dtype=float)
    return FollowedSeconds(
        time, followed.states, followed.deviations, followed.innovations, followed.errors, frames.values, lasting,
        np.full(len(frames), float(skew)), events,
    )  # fmt: skip
