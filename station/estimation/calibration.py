"""A station's parameters from a record: Gauss-Newton on the filter's innovations, from a soft model to a stiff one.

Prediction-error method: Ljung 1999, *System Identification*, ch. 7 and 10; the covariance that allows for innovations
that hang together, by blocks of an hour: White 1982, doi:10.2307/1912526, each of which is judged by what the others
say (the jackknife: MacKinnon and White 1985, doi:10.1016/0304-4076(85)90158-7). Weights that stand still in a step, as
in iteratively reweighted least squares: Wedderburn 1974, doi:10.1093/biomet/61.3.439. Priors come from the station's
file.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from station.errors import InputError
from station.estimation.filter import STIFF, Followed, Tuning, follow, model_of
from station.estimation.interface import AMBIENT, CAP, EstimationModel, field_of
from station.estimation.verdict import Fit, coarse_sensors, fits_of, reasons, without_faint_flows
from station.frames import Frames
from station.geometry import BUFFERS
from station.parameters import Station

BEYOND = 5.0
"""A model whose parameters end so many of the prior's standard deviations from the file is refused."""

KNOWN = 0.25
"""A parameter is found, and known, if the record leaves at most so much of the prior's standard deviation."""

VOLUME_KNOWN = 0.003
"""A buffer's volume is known if its 95 % interval, but for the meters' class, reaches no further than this part of it
to either side: one that is off by more, against the meters, makes leaks that are none."""

HELD_OUT = 0.25
"""Last part of the record that nothing is fitted to: the verdict is about it."""

SHORTEST = 6 * 3600
"""Shortest record that a station is calibrated from [s]."""

_STAGES = (
    (STIFF._replace(mass=20.0, temperature=0.3, gate=1e3), 2),
    (STIFF._replace(mass=1.0, temperature=0.03, gate=50.0), 2),
    (STIFF, 3),
)
_MORE_TURNS = 8  # of the last stage at most, while a step moves a parameter by more than
_SETTLED = 0.5  # of its standard deviation
_STEP = 1e-3  # of the prior's standard deviation, for differences
_FARTHEST = 1.5  # most that a step moves a parameter [standard deviations of its prior]
_FARTHEST_LATE, _LATE_TURNS = 0.3, 4  # likewise of a late one, which needs so many steps more
_SCAN = tuple(k / 4 for k in range(-6, 7))  # where a late one is looked for [standard deviations of its prior]
_HOUR = 3600
_VOLUMES = {f"buffers.{name}.volume_m3": name for name in BUFFERS}


@dataclass(frozen=True)
class Estimate:
    """A parameter with its 95 % interval, in the unit of its field; its file's value where the record says nothing.

    The meters' class is part of the interval where their bias is a scale of the parameter.
    """

    value: float
    low: float
    high: float
    known: bool


@dataclass(frozen=True)
class Calibration:
    """A calibrated station, or why it is none."""

    station: Station | None  # None where no station can have such parameters
    parameters: dict[str, Estimate]
    fits: dict[str, Fit]  # of the part held out
    beyond: list[str]  # what is too far from the file, or from what a station can have

    @property
    def refused(self) -> list[str]:
        """Why the model is refused; empty where it is accepted."""
        none = [] if self.fits else ["no sensor has readings enough in the part held out"]
        return [*self.beyond, *reasons(self.fits), *none]


def calibrate(
    frames: Frames, station: Station, progress: Callable[[int, int], None] = lambda _done, _total: None
) -> Calibration:
    """Find the station's parameters from all but the last HELD_OUT of a record, and judge them by that.

    Raises
    ------
    InputError
        if the plant is not followed, or the record is too short.
    """
    model = model_of(station)
    if len(frames) < SHORTEST:
        raise InputError("record", [("time", f"must span at least {SHORTEST} s; given {len(frames)}")])
    first = int(len(frames) * (1 - HELD_OUT))
    fitted = frames.part(0, first)
    names = list(model.parameters)
    width = np.array(list(model.parameters.values()))
    eta, spread, free = _fitted(fitted, station, model, progress)
    constants = _constants(station, model, eta)
    values = {name: _value(station, model, name, width[k] * eta[k]) for k, name in enumerate(names)}
    held_out = follow(frames, station, STIFF, constants)
    if model.air is not None:  # what was found is the air of the first second
        values[model.air] += float(held_out.states[:first, AMBIENT].mean())
    found = {}
    for k, name in enumerate(names):
        aside = 1.96 * width[k] * spread[k]
        scale = frames.meter_class / 100.0 if name in model.metered else 0.0
        whole = math.hypot(aside, scale) if free[k] else aside
        low, high = (_moved(values[name], name in model.absolute, side * whole) for side in (-1, 1))
        known = bool(free[k] and spread[k] <= KNOWN and (name not in _VOLUMES or aside <= VOLUME_KNOWN))
        found[name] = Estimate(values[name], low, high, known)
    beyond = [
        f"{name}: {values[name]:.4g} is {BEYOND:g} standard deviations or more from what the station's file says"
        for k, name in enumerate(names)
        if abs(eta[k]) >= BEYOND
    ]
    try:
        changed = model.station_at(station, values)
        told = {name: 100.0 * float(width[k] * spread[k]) for k, name in enumerate(names) if free[k]}
        deviations = {str(name): percent for name, percent in station.volume_deviations_percent.items()}
        deviations |= {name: told[volume] for volume, name in _VOLUMES.items() if volume in told}
        left = _unknown_buffers(station, found)
        changed = changed.model_copy(update={"unknown_buffers": left, "volume_deviations_percent": deviations})
    except ValidationError as error:
        changed = None
        beyond += [f"{field}: {message}" for field, message in InputError.of("station", error).problems]
    coarse = coarse_sensors(frames.values, frames.usual_noise)
    return Calibration(changed, found, fits_of(without_faint_flows(held_out, frames), first, coarse), beyond)


def _unknown_buffers(station: Station, found: dict[str, Estimate]) -> list[str]:
    """Buffers whose volumes the record does not tell well, nor one did from which the station was calibrated before."""
    left = [name for volume, name in _VOLUMES.items() if not found[volume].known]
    return [name for name in left if not station.calibrated or name in station.unknown_buffers]


def _fitted(
    frames: Frames, station: Station, model: EstimationModel, progress: Callable[[int, int], None]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Parameters of least innovations and their standard deviations, in those of the priors; which are known."""
    names = list(model.parameters)
    eta = np.zeros(len(names))  # in standard deviations of the prior
    early = np.array([name not in model.late for name in names])
    free, farthest = early, np.where(early, _FARTHEST, _FARTHEST_LATE)
    stages = [*_STAGES[:-1], (STIFF, _STAGES[-1][1] + (_LATE_TURNS if model.late else 0))]
    scans = 2 * len(_SCAN) * len(model.late)
    total, done = sum(n for _, n in stages) * (len(names) + 1) + scans, 0

    def tick() -> None:
        nonlocal done
        done += 1
        progress(min(done, total), total)

    hessian = blocks = np.eye(len(names))
    for tuning, count in stages:
        settled, told = False, count  # the turn of the stiff model at which the record has told what it knows
        if tuning is STIFF:
            free = np.ones(len(names), bool)
        if tuning is not stages[0][0]:
            eta = _scanned(frames, station, model, eta, tick)
        for turn in range(count + (_MORE_TURNS if tuning is STIFF else 0)):
            residual, jacobian = _linearised(frames, station, model, eta, free, tuning, tick)
            hessian = jacobian.T @ jacobian
            gradient = np.where(free, jacobian.T @ residual.ravel() + eta, 0.0)
            if tuning is STIFF and turn < told and ((turn > 0 and settled) or turn == count - 2):
                told = turn  # it says nothing of these: as the file has them
                free = np.sqrt(np.diag(np.linalg.inv(hessian + np.eye(len(names))))) <= KNOWN
                eta = np.where(free, eta, 0.0)
                gradient = np.where(free, gradient, 0.0)
            move = np.zeros(len(names))
            within = np.ix_(free, free)
            move[free] = -np.linalg.solve(hessian[within] + np.eye(int(free.sum())), gradient[free])
            eta = np.clip(eta + np.clip(move, -farthest, farthest), -BEYOND, BEYOND)
            blocks = _block_gram(residual, jacobian, hessian, free, np.array([name == model.air for name in names]))
            settled = bool(np.all(np.abs(move) <= _SETTLED * _spread(hessian, blocks, free)))
            if settled and (turn > told or (turn == told and free.all())):
                break
    progress(total, total)
    return eta, _spread(hessian, blocks, free), free


def _scanned(
    frames: Frames, station: Station, model: EstimationModel, eta: NDArray[np.float64], tick: Callable[[], None]
) -> NDArray[np.float64]:
    """The parameters with each late one where the innovations are least, of a grid: it acts too seldom for slopes."""
    found = eta.copy()
    for place in (k for k, name in enumerate(model.parameters) if name in model.late):
        misfits = []
        for at in _SCAN:
            tick()
            found[place] = at
            z = follow(frames, station, _STAGES[1][0], _constants(station, model, found)).innovations
            misfits.append(float(np.nansum(np.minimum(z * z, CAP))) + at * at)
        found[place] = _SCAN[int(np.argmin(misfits))]
    return found


def _linearised(
    frames: Frames, station: Station, model: EstimationModel, eta: NDArray[np.float64], free: NDArray[np.bool_],
    tuning: Tuning, tick: Callable[[], None],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:  # fmt: skip
    """Innovations (seconds, channels), 0 where there is none, and their slopes by every free parameter.

    In standard deviations of the innovations at the parameters themselves, whose slopes are none of the errors'.
    """

    def at(place: NDArray[np.float64]) -> Followed:
        tick()
        return follow(frames, station, tuning, _constants(station, model, place))

    base = at(eta)
    kept = np.isfinite(base.used) & (base.errors != 0.0)
    residual = np.where(kept, base.used, 0.0)
    weight = residual / np.where(kept, base.errors, 1.0)
    jacobian = np.zeros((residual.size, len(eta)))
    for k in np.flatnonzero(free):
        moved = eta.copy()
        moved[k] += _STEP
        shifted = at(moved)
        both = kept & np.isfinite(shifted.used)
        slope = np.where(both, weight * (shifted.errors - base.errors) / _STEP, 0.0)
        jacobian[:, k] = slope.ravel()
    return residual, jacobian


def _block_gram(
    residual: NDArray[np.float64], jacobian: NDArray[np.float64], hessian: NDArray[np.float64],
    free: NDArray[np.bool_], first: NDArray[np.bool_],
) -> NDArray[np.float64]:  # fmt: skip
    """Sum of the outer products of each hour's gradient, as it is where the other hours alone are fitted to.

    An hour that says most of what is known of a parameter is fitted to, and its own residuals say little of the error.
    Of parameters of the `first` second other hours say nothing.
    """
    rows, found = _HOUR * residual.shape[1], np.zeros(hessian.shape)
    flat, within = residual.ravel(), np.ix_(free, free)
    inverse = np.linalg.inv(hessian[within] + np.eye(int(free.sum())))
    for at in range(0, len(flat), rows):
        slopes = jacobian[at : at + rows][:, free]
        told = np.where(first[free], 0.0, slopes)
        alone = np.eye(len(inverse)) - told.T @ told @ inverse
        gradient = np.linalg.solve(alone, slopes.T @ flat[at : at + rows])
        found[within] += np.outer(gradient, gradient)
    return found


def _spread(
    hessian: NDArray[np.float64], blocks: NDArray[np.float64], free: NDArray[np.bool_]
) -> NDArray[np.float64]:  # fmt: skip
    """Standard deviations of the parameters in those of their priors: by hours, never less than Fisher's, at most 1."""
    spread = np.ones(len(free))
    within = np.ix_(free, free)
    inverse = np.linalg.inv(hessian[within] + np.eye(int(free.sum())))
    by_hours = inverse @ (blocks[within] + np.eye(int(free.sum()))) @ inverse
    spread[free] = np.sqrt(np.maximum(np.diag(inverse), np.diag(by_hours)))
    return np.minimum(spread, 1.0)


def _value(station: Station, model: EstimationModel, name: str, moved: float) -> float:
    """A parameter of a station's file, moved by a part of itself or by so many degrees."""
    return _moved(field_of(station, name), name in model.absolute, moved)


def _moved(given: float, absolute: bool, by: float) -> float:
    return float(given + by if absolute else given * np.exp(by))


def _constants(station: Station, model: EstimationModel, eta: NDArray[np.float64]) -> Any:
    """The plant's constants with parameters moved by so many standard deviations of their priors."""
    values = {
        name: _value(station, model, name, width * eta[k]) for k, (name, width) in enumerate(model.parameters.items())
    }
    return model.constants_at(station, values)
