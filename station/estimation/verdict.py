"""Whether a model fits: its innovations are white and of unit variance, or it is refused with the channels named."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from station.estimation.detection import Event
from station.estimation.detection_memory import FACTOR_NOTHING, HEALTH, LEAK_NOTHING
from station.estimation.interface import LEAK, MV, Followed
from station.estimation.noise import LOUD
from station.estimation.resting import coarse_channels
from station.frames import Frames
from station.geometry import BUFFERS, VALVES
from station.sensor_names import ANALOG, DETECTABLE

RMS_LIMITS = (0.9, 1.05)
"""Root mean square of a channel's innovations, in standard deviations, of a model that fits."""

BLOCK = 120
"""Seconds whose innovations are summed: what is small each second and always the same way shows there.

Every second begins a block: of blocks that overlap the mean square spreads by a third less than of those that do not
(the variance of a mean by Bartlett's weights: Newey and West 1987, doi:10.2307/1913610).
"""

BLOCK_LIMIT, BY_CHANCE = 1.3, 3.1
"""Most that the root mean square of those sums may be, in standard deviations of a sum; and by how many of its own
standard deviations that of a few readings may lie above 1, which one in a thousand models that fit exceeds."""

OUTLIERS_MAX = 0.01
"""Most of a channel's readings that may lie beyond the filter's gate."""

FEWEST = 1200
"""With fewer readings nothing is said of a channel: the spread of the figures would be that of the limits."""

LEARNING = 600
"""Seconds from where an event was found in which the filter still learns its size."""

AILING_MAX = 0.5
"""Part of the channels whose sensors may have failed; where more seem to, it is the model that does not fit."""

JUDGED_MIN = 0.5
"""A model is judged without the seconds of events if at least this part of a record is left."""

FALLS = 0.8
"""A leak or a weakness of which only so large a part of its median is left is passing."""


@dataclass(frozen=True)
class Fit:
    """How a channel's readings fit the model."""

    innovation_rms: float  # [standard deviations]
    block_rms: float  # [standard deviations of a sum]
    outliers: float  # part of the readings beyond the gate [1]
    coarse: bool = False  # it reads in steps that hide its noise: its innovations are small, and not white
    readings: int = 0  # how many; 0: many

    @property
    def block_limit(self) -> float:
        """Most that `block_rms` may be: BLOCK_LIMIT, and more where so few readings tell less."""
        spread = math.sqrt(BLOCK / (3 * self.readings)) if self.readings else 0.0
        return max(BLOCK_LIMIT, 1.0 + BY_CHANCE * spread)

    @property
    def fits(self) -> bool:
        """Whether it is within every limit."""
        low, high = RMS_LIMITS
        white = low <= self.innovation_rms and self.block_rms <= self.block_limit
        return (white or self.coarse) and self.innovation_rms <= high and self.outliers <= OUTLIERS_MAX


def without_events(followed: Followed, start: float, events: Sequence[Event]) -> Followed:
    """Innovations that speak for or against a model: none from an event's beginning until the filter has learnt it.

    A leak is a step that no model foretells, and the larger it is the worse the innovations that find it. A model that
    needs an event at every turn is judged by all seconds.

    Parameters
    ----------
    followed : Followed
        The record as it was followed.
    start : float
        Time of its first second [s].
    events : sequence of Event
        What was detected in it.

    Returns
    -------
    Followed
        The same with NaN for the innovations of these seconds; unchanged where less than `JUDGED_MIN` would be left.
    """
    judged = np.ones(len(followed.innovations), bool)
    if followed.stuck is not None:
        judged &= ~_while_open(followed.stuck[:, : len(VALVES)])
    for event in events:
        found = int(event.found_s - start)
        if found + LEARNING > 0:
            judged[max(int(event.begin_s - start), 0) : found + LEARNING] = False
        passed = _passed(followed, event.name, found)
        if passed is not None:  # its end is a step as its beginning was
            judged[max(passed - LEARNING, 0) : passed + LEARNING // 2] = False
    if judged.mean() < JUDGED_MIN:
        return followed
    judged &= ~_while_let_through(followed, start, events)
    return replace(followed, innovations=np.where(judged[:, None], followed.innovations, np.nan))


def _while_open(stuck: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Seconds in which a valve is stuck open, and LEARNING behind."""
    sticks = np.convolve((stuck > 0.0).any(1), np.ones(LEARNING + 1))
    return np.asarray(sticks[: len(stuck)] > 0.5)


def _while_let_through(followed: Followed, start: float, events: Sequence[Event]) -> NDArray[np.bool_]:
    """Visits since an outlet is not tight, and LEARNING behind: each begins with a step, and ends with one.

    Of one that was measured: leaks that come and go with visits may be a wrong model's as well.
    """
    measured = [event for event in events if event.size_deviation is not None]
    leaks = [event.begin_s - start for event in measured if event.name.startswith("leak_outlet_")]
    if not leaks:
        return np.zeros(len(followed.states), bool)
    visits = np.isfinite(followed.states[:, MV])
    visits[: max(int(min(leaks)), 0)] = False
    return np.asarray(np.convolve(visits, np.ones(LEARNING + 1))[: len(visits)] > 0.5)


def _passed(followed: Followed, name: str, found: int) -> int | None:
    """The second in which nothing is left of a leak or a weakness that was found in one, or that it is passing in.

    None where it lasts, and where nothing was left of one that was found before the record.
    """
    if name not in DETECTABLE[:HEALTH]:
        return None
    place, earlier, found = DETECTABLE.index(name), found < 0, max(found, 0)
    weak = place >= HEALTH - 2
    value = 1.0 - followed.states[found:, LEAK + place] if weak else followed.states[found:, LEAK + place]
    nothing = np.flatnonzero(value <= (FACTOR_NOTHING if weak else LEAK_NOTHING))
    if len(nothing):
        if earlier and nothing[0] == 0:
            return None
        return found + int(nothing[0])
    return len(followed.states) - 1 if len(value) and value[-1] < FALLS * np.median(value) else None


def without_faint_flows(followed: Followed, frames: Frames) -> Followed:
    """Innovations but for those of flows that are so small that a meter's relative noise is less than its absolute one.

    A meter that its tag makes noisier there than it is would make all of its innovations too small.
    """
    relative = frames.relative * frames.values[:, : len(ANALOG)]  # NaN of a flow that its power tells: it is judged
    faint = (frames.relative > 0.0) & (relative < frames.usual_noise)
    return replace(followed, innovations=np.where(faint, np.nan, followed.innovations))


def coarse_sensors(values: NDArray[np.float64], noise: NDArray[np.float64]) -> frozenset[str]:
    """Sensors that read in steps which hide their noise.

    Parameters
    ----------
    values : ndarray (seconds, len(ANALOG) or more)
        Their readings, NaN for none.
    noise : ndarray (len(ANALOG),)
        Standard deviations, by their tags.
    """
    hidden = coarse_channels(np.ascontiguousarray(values, float), np.ascontiguousarray(noise, float))
    return frozenset(name for name, found in zip(ANALOG, hidden, strict=True) if found)


def judged(
    followed: Followed, start: float, events: Sequence[Event], coarse: Collection[str] = (),
    earlier: Sequence[Event] = (),
) -> tuple[dict[str, Fit], list[str]]:  # fmt: skip
    """How each channel fits, and why the model is refused: no line where it is not.

    A sensor that was told to fail says nothing against the model, unless more than AILING_MAX of them were: what spoils
    most of the readings is the model, or a clock. Robust innovations are quieter than a calibrated model's, which says
    nothing against it.

    Parameters
    ----------
    followed : Followed
        The seconds as they were followed.
    start : float
        Time of the first of them [s].
    events : sequence of Event
        What was detected.
    coarse : collection of str
        Sensors that read in steps (`coarse_sensors`).
    earlier : sequence of Event
        What was detected before these seconds, and may pass in them.
    """
    # of a sensor that says nothing there are no innovations, of one that drifts that is taken off; the others speak
    disturbing = [event for event in events if not event.name.startswith(("absent_", "drift_"))]
    passing = [event for event in earlier if event.name in DETECTABLE[:HEALTH]]
    followed = _once_well(followed, earlier)
    fits = fits_of(without_events(followed, start, [*passing, *disturbing]), coarse=coarse)
    if most_ail(disturbing, fits):
        fits = fits_of(followed, coarse=coarse)
        return fits, reasons(fits, quiet=True)
    ailing = _ailing(disturbing, fits)
    return fits, reasons({name: fit for name, fit in fits.items() if name not in ailing}, quiet=True)


def _once_well(followed: Followed, earlier: Sequence[Event]) -> Followed:
    """Innovations without those of sensors that failed before and were put right meanwhile, until they were."""
    innovations = followed.innovations.copy()
    failed = {event.name.partition("_")[2] for event in earlier if event.name.startswith(("offset_", "noisy_"))}
    for channel in (ANALOG.index(name) for name in failed):
        of_sensor, at = innovations[:, channel], 0
        while _ails(of_sensor[at : at + BLOCK]):
            at += BLOCK
        of_sensor[: at + BLOCK if at else 0] = np.nan
    return replace(followed, innovations=innovations)


def _ails(innovations: NDArray[np.float64]) -> bool:
    """Whether a sensor's innovations, of a block, are larger than noise that nobody would tell makes them."""
    return bool(np.isfinite(innovations).any() and np.nanmean(np.square(innovations)) > LOUD**2)


def most_ail(events: Sequence[Event], channels: Collection[str]) -> bool:
    """Whether more of the channels seem to fail than sensors do at once."""
    return len(_ailing(events, channels)) > AILING_MAX * len(channels)


def _ailing(events: Sequence[Event], channels: Collection[str]) -> set[str]:
    """Channels whose sensors were told to give wrong readings; with a line that leaks banks give more than is known."""
    wrong = [event.name for event in events if not event.name.startswith("absent_")]
    spoiled = {"flow_dispenser", *(f"pressure_{each}" for each in BUFFERS)} if "leak_line" in wrong else set()
    return spoiled | {channel for channel in channels for name in wrong if name.endswith(f"_{channel}")}


def fits_of(followed: Followed, first: int = 0, coarse: Collection[str] = ()) -> dict[str, Fit]:
    """Of each channel with FEWEST readings or more, from the second `first` on; `coarse` channels read in steps."""
    found = {}
    used = followed.used[first:]
    for channel, name in enumerate(ANALOG):
        read = np.isfinite(followed.innovations[first:, channel])
        if read.sum() < FEWEST:
            continue
        z = used[:, channel]
        kept = np.isfinite(z)
        if not kept.any():
            all_of_it = float(np.sqrt(np.mean(followed.innovations[first:, channel][read] ** 2)))
            found[name] = Fit(all_of_it, all_of_it, 1.0, name in coarse)
            continue
        found[name] = Fit(
            float(np.sqrt(np.mean(z[kept] ** 2))),
            _block_rms(np.where(kept, z, 0.0), kept),
            float(1 - kept.sum() / read.sum()),
            name in coarse,
            int(kept.sum()),
        )
    return found


def _block_rms(values: NDArray[np.float64], kept: NDArray[np.bool_]) -> float:
    """Root mean square of sums over BLOCK seconds, whichever they begin with, in those that white innovations have."""
    sums, counts = (np.concatenate([[0.0], np.cumsum(each)]) for each in (values, kept))
    of_blocks = sums[BLOCK:] - sums[:-BLOCK]
    return float(np.sqrt(np.sum(of_blocks**2) / np.sum(counts[BLOCK:] - counts[:-BLOCK])))


def reasons(fits: dict[str, Fit], *, quiet: bool = False) -> list[str]:
    """Why the model is refused, a line a channel; none where it fits.

    `quiet`: innovations that are too small are no reason, as where the filter is soft.
    """
    low, high = RMS_LIMITS
    return [
        f"{name}: innovations {fit.innovation_rms:.3f} (must be {low} to {high}), in blocks of {BLOCK} s "
        f"{fit.block_rms:.2f} (at most {fit.block_limit:.3g}), outliers {100 * fit.outliers:.2g} % (at most "
        f"{100 * OUTLIERS_MAX:g})"
        for name, fit in fits.items()
        if not (replace(fit, innovation_rms=max(fit.innovation_rms, low)) if quiet else fit).fits
    ]
