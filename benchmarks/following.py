"""What filter, calibration and detection reach at drawn stations: `python -m benchmarks.following [--station ...]`.

Stations are drawn around a preset, as far off as a station's file may be. Each is calibrated from a measured day;
another day says how well it is known then. Healthy days, and days with a fault that begins by chance, by controllers
that the twin does not know, are then followed with what was found. Nobody reads the air, which is warmer or colder by
up to 5 K and waves by as much over a day.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.measured_forecasts import AIR, drawn_station, measured
from controllers import create_from
from station import Record, Scenario, load_station, parse_scenario, simulate
from station.estimation.calibration import HELD_OUT, Calibration, calibrate
from station.estimation.detection import Event, detect
from station.estimation.filter import STIFF, follow, model_of
from station.estimation.followed import deviations_of
from station.estimation.interface import field_of
from station.estimation.score import score
from station.estimation.verdict import fits_of, reasons, without_faint_flows
from station.faults.plant import PlantFaults
from station.frames import Frames
from station.geometry import BUFFERS
from station.measured_day import tags_of_day
from station.parameters import Station
from station.plants.interface import plant_of

DAY, HALF_DAY = 86_400, 43_200
VEHICLES = 40  # a day
CONTROLLERS = ("logic", "switched", "minlp1")
EARLY = 600
"""Seconds of a day that its masses are not judged by: the filter learns."""

AIR_FIELD = "thermal.ambient_temperature_c"

WIDTH = 15.0
"""By which parameters of a drawn station are off at most [%]."""

AIR_STEP = 600.0
"""The air that waves moves each so many seconds."""

FAULTS: tuple[dict[str, Any], ...] = (
    {"kind": "leak", "rate_g_per_s": 0.5},
    {"kind": "leak", "rate_g_per_s": 0.1},
    {"kind": "compressor_weak", "loss_percent": 20.0},
    {"kind": "sensor_drift", "drift_bar_per_h": 3.0},
    {"kind": "precooler_weak", "warmer_k": 5.0},
    {"kind": "sensor_frozen"},
)
"""Each on a day of its own; the bank is the next one at each station."""

REAL_GAS = {"precooler_weak"}
"""Faults of the faithful plant alone."""

Floats = NDArray[np.float64]


class Wave(PlantFaults):
    """Faults of a station in air whose temperature waves over the day."""

    def __init__(self, scenario: Scenario, phase: float) -> None:
        super().__init__(scenario.faults)
        self._scenario, self._phase = scenario, phase

    def __bool__(self) -> bool:
        """Air always changes."""
        return True

    def constants(self, plant: Any, time: float) -> Any:
        """Those of the healthy plant in the air of a time [s], changed by its faults."""
        station = self._scenario.station
        warmer = AIR * float(np.sin(2 * np.pi * time / DAY + self._phase))
        air = station.thermal.ambient_temperature_c + warmer
        there = station.model_copy(
            update={"thermal": station.thermal.model_copy(update={"ambient_temperature_c": air})}
        )  # fmt: skip
        known = plant_of(type(plant)).constants_of(there, communication=self._scenario.communication)
        return super().constants(known, time)

    def next_change(self, time: float) -> float:
        """When a fault begins or ends behind a time [s], or the air moves."""
        return min(super().next_change(time), (time // AIR_STEP + 1) * AIR_STEP)


def day_of(station: Station, seconds: int, faults: Iterable[dict[str, Any]] = ()) -> Scenario:
    """A day with VEHICLES in 24 hours, at drawn times."""
    law = {"kind": "uniform", "count": round(VEHICLES * seconds / DAY), "period_s": float(seconds)}
    given = {"name": "day", "station": station.model_dump(mode="json"), "arrivals": law, "faults": list(faults)}
    return parse_scenario({**given, "time_limit_s": float(seconds)})


def played(scenario: Scenario, controller: str, seed: int) -> Record:
    """The day in air that waves from a phase of its own; its vehicles are those of the seed."""
    wave = Wave(scenario, float(np.random.default_rng([seed, 5]).uniform(0, 2 * np.pi)))
    return simulate(scenario, create_from(controller), replication=seed, seed=seed, faults=wave)


def fault_of(kind: dict[str, Any], place: int, begin: float) -> dict[str, Any]:
    """A fault that begins at a time, of the bank at `place` or of its pressure where it is one's."""
    bank = BUFFERS[place % len(BUFFERS)]
    where = {"leak": {"buffer": bank}, "sensor_drift": {"sensor": f"pressure_{bank}"}}
    frozen = {"sensor_frozen": {"sensor": f"pressure_{bank}"}}
    return {**kind, **{**where, **frozen}.get(kind["kind"], {}), "begin_s": begin}


def in_use(record: Record, column: str, begin: float, end: float) -> int:
    """Seconds with a flow between two times."""
    return int(np.count_nonzero(np.asarray(record[column])[int(begin) : int(end) + 1] > 0))


USE = {"compressor_weak": "flow_compressor", "precooler_weak": "flow_dispenser"}
"""Flows in whose seconds the delay of a fault is counted."""


def told(frames: Frames, known: Station) -> list[Event]:
    """What detection tells of frames."""
    return detect(frames, follow(frames, known), known)


def calibration_lines(preset: str, hidden: dict[int, Station], found: dict[int, Calibration], cpu: list[float]) -> None:
    """Print how near the parameters are that are known, and whether their intervals cover."""
    known, errors, covered = load_station(preset), defaultdict(list), []
    absolute = model_of(known).absolute
    for seed, calibration in found.items():
        for name, each in calibration.parameters.items():
            if each.known:
                true = field_of(hidden[seed], name)
                if name == AIR_FIELD:
                    continue  # it has waved
                off = abs(each.value - true)
                errors[name].append(off if name in absolute else 100 * off / true)
                covered.append(each.low <= true <= each.high)
    refused = [f"{seed}: {'; '.join(each.refused)}" for seed, each in found.items() if each.refused]
    print(f"calibration: {len(found)} stations, {min(cpu):.0f} to {max(cpu):.0f} CPU-seconds")
    print(f"  refused: {refused or 'none'}")
    print(f"  intervals of what is known: {sum(covered)} of {len(covered)} cover")
    for name, found_off in errors.items():
        unit = "K" if name in absolute else "%"
        about = f"off by {np.median(found_off):.3g} {unit} in the median, {max(found_off):.3g} at most"
        print(f"  {name}: known at {len(found_off)}, {about}")
    fits = [fit for each in found.values() for fit in each.fits.values()]
    rms, blocks = [fit.innovation_rms for fit in fits], [fit.block_rms for fit in fits]
    print(
        f"  held-out innovations {min(rms):.3f} to {max(rms):.3f}, in blocks of 120 s {min(blocks):.2f} to "
        f"{max(blocks):.2f}"
    )


class Known(NamedTuple):
    """How well a day of a station is followed."""

    masses: list[float]  # RMS of each bank's error [g]
    parts: list[float]  # of its mass [1]
    heats: list[float]  # RMS of its temperature's [K]
    covered: list[float]  # seconds in which its mass lies within the filter's 95 % [1]
    cpu: float  # of a second [us]


def known_by(record: Record, frames: Frames, station: Station, banks: Iterable[str] = BUFFERS) -> Known:
    """How well the stiff filter of a station follows these banks."""
    began = time.process_time()
    followed = follow(frames, station, STIFF)
    found = Known([], [], [], [], 1e6 * (time.process_time() - began) / len(frames))
    places, seconds = list(model_of(station).states), slice(EARLY, len(frames))
    deviations = deviations_of(followed, station)
    for bank in banks:
        place, warm = places.index(f"mass_{bank}"), places.index(f"temperature_{bank}")
        true = np.asarray(record[f"mass_{bank}"], float)[seconds]
        error = followed.states[EARLY:, place] - true
        apart = followed.states[EARLY:, warm] - np.asarray(record[f"temperature_{bank}"], float)[seconds]
        found.masses.append(float(np.sqrt(np.mean(error**2))))
        found.parts.append(found.masses[-1] / float(true.mean()))
        found.heats.append(float(np.sqrt(np.mean(apart**2))))
        found.covered.append(float(np.mean(np.abs(error) <= 1.96 * deviations[EARLY:, place])))
    return found


def known_lines(name: str, found: list[Known]) -> None:
    """Print how well days are followed."""

    def of(figure: str, scale: float = 1.0) -> list[float]:
        return [scale * value for each in found for value in getattr(each, figure)]

    grams, heats, covered, cpu = of("masses"), of("heats"), of("covered", 100), [each.cpu for each in found]
    print(
        f"{name}, {len(grams)} banks of {len(found)} stations: masses off by {min(grams):.2g} to {max(grams):.2g} g "
        f"RMS, {max(of('parts', 100)):.2g} % at most; temperatures by {min(heats):.2g} to {max(heats):.2g} K"
    )
    print(
        f"  95 % intervals of masses cover {min(covered):.1f} to {max(covered):.1f} %, {np.mean(covered):.1f} % in the "
        f"mean; {min(cpu):.1f} to {max(cpu):.1f} us a second"
    )


def true_lines(hidden: dict[int, Station], controller: str) -> None:
    """Print what a calibration would refuse of a day that is followed with the true parameters: nothing should be."""
    blocks, refused = [], 0
    for seed, station in hidden.items():
        frames = measured(played(day_of(station, DAY), controller, seed), seed)
        followed = without_faint_flows(follow(frames, station, STIFF), frames)
        fits = fits_of(followed, int(len(frames) * (1 - HELD_OUT)))
        blocks += [fit.block_rms for fit in fits.values()]
        why = reasons(fits)
        refused += bool(why)
        for line in why:
            print(f"  station {seed}, {controller}: {line}", file=sys.stderr, flush=True)
    print(
        f"true parameters, {controller}: {refused} of {len(hidden)} days refused; in blocks of 120 s {min(blocks):.2f} "
        f"to {max(blocks):.2f}"
    )


def healthy_lines(name: str, hidden: dict[int, Station], known: dict[int, Station], days: int) -> None:
    """Print what is told of healthy days, by each controller in turn."""
    told_of: dict[str, int] = defaultdict(int)
    count = 0
    for seed, station in known.items():
        for k in range(days):
            controller = CONTROLLERS[count % len(CONTROLLERS)]
            frames = measured(played(day_of(hidden[seed], DAY), controller, 100 * seed + k), 100 * seed + k)
            for event in told(frames, station):
                told_of[event.name] += 1
                print(f"  station {seed}, {controller}: {event}", file=sys.stderr, flush=True)
            count += 1
    print(f"{name}: {count} healthy days: {dict(told_of) or 'no event'}")


class Told(NamedTuple):
    """How a fault was told of one day."""

    delay: float | None  # [s]; None: not told
    used: int | None  # of them with a flow that shows it [s]; None where it shows always
    untold: bool  # nothing can be told of it there
    false: list[str]  # events that it does not explain


def fault_day(hidden: Station, known: Station, kind: dict[str, Any], place: int, seed: int) -> Told:
    """A fault that begins by chance on half a day, as it is told; `place` chooses bank and controller."""
    begin = float(np.random.default_rng([seed, 6]).integers(3 * 3600, 6 * 3600))
    scenario = day_of(hidden, HALF_DAY, [fault_of(kind, place, begin)])
    record = played(scenario, CONTROLLERS[place % len(CONTROLLERS)], seed)
    found = score(told(measured(record, seed), known), scenario.faults, tags_of_day(), known)
    (judged,) = found["faults"]
    delay, column = judged["delay_s"], USE.get(kind["kind"])
    used = None if delay is None or column is None else in_use(record, column, begin, begin + delay)
    return Told(delay, used, judged["untold"] is not None, found["false_events"])


def fault_lines(name: str, hidden: dict[int, Station], known: dict[int, Station], each: int) -> None:
    """Print how faults are told."""
    for kind in FAULTS:
        if kind["kind"] in REAL_GAS and next(iter(hidden.values())).real_gas is None:
            continue
        days = [
            fault_day(hidden[seed], station, kind, place + k, 10_000 + 100 * seed + k)
            for place, (seed, station) in enumerate(known.items())
            for k in range(each)
        ]
        delays = [day.delay for day in days if day.delay is not None]
        used = [day.used for day in days if day.used is not None]
        untold, about = sum(day.untold for day in days), " ".join(str(value) for value in kind.values())
        print(
            f"{name}: {about}: {len(delays)} told, {len(days) - len(delays) - untold} missed, {untold} cannot be told"
        )
        if delays:
            print(f"  after {min(delays):.0f} to {max(delays):.0f} s, median {np.median(delays):.0f} s")
        if used:
            print(f"  of use {min(used)} to {max(used)} s, median {np.median(used):.0f} s")
        print(f"  also told: {dict(Counter(wrong for day in days for wrong in day.false)) or 'nothing'}", flush=True)


def main() -> None:
    """Parse the arguments and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--station", default="thesis-fit")
    parser.add_argument("--stations", type=int, default=10)
    parser.add_argument("--days", type=int, default=3, help="healthy ones of each station")
    parser.add_argument("--faults", type=int, default=1, help="days of each station with each fault")
    parser.add_argument("--seed", type=int, default=1, help="of the first station")
    parser.add_argument("--off", type=float, help="follow with a file so many percent off, not calibrated")
    parser.add_argument("--true", action="store_true", help="only count what is refused with the true parameters")
    asked = parser.parse_args()
    seeds = range(asked.seed, asked.seed + asked.stations)
    print(
        f"{asked.station}, stations {seeds.start} to {seeds.stop - 1}, air up to {AIR:g} K off that waves by {AIR:g} K"
    )
    if asked.true:
        for controller in CONTROLLERS:
            true_lines({seed: drawn_station(asked.station, seed) for seed in seeds}, controller)
        return
    if asked.off is None:
        hidden = {seed: drawn_station(asked.station, seed) for seed in seeds}
        found, cpu = {}, []
        for seed, station in hidden.items():
            frames = measured(played(day_of(station, DAY), "logic", seed), seed)
            began = time.process_time()
            found[seed] = calibrate(frames, load_station(asked.station))
            cpu.append(time.process_time() - began)
            print(f"  station {seed}: {cpu[-1]:.0f} CPU-seconds", file=sys.stderr, flush=True)
        calibration_lines(asked.station, hidden, found, cpu)
        accepted = {seed: each.station for seed, each in found.items() if each.station and not each.refused}
        known = {seed: each.model_copy(update={"calibrated": True}) for seed, each in accepted.items()}
        followed: list[Known] = []
        true: list[Known] = []
        for seed, station in hidden.items():
            record = played(day_of(station, DAY), "logic", 1000 + seed)
            frames = measured(record, 1000 + seed)
            true.append(known_by(record, frames, station))
            if seed in known:
                banks = [bank for bank in BUFFERS if found[seed].parameters[f"buffers.{bank}.volume_m3"].known]
                followed.append(known_by(record, frames, known[seed], banks))
        known_lines("true parameters", true)
        if followed:
            known_lines("calibrated, where the volume is known", followed)
        name = "calibrated"
    else:
        known = dict.fromkeys(seeds, load_station(asked.station))
        hidden = {seed: drawn_station(asked.station, seed, asked.off / WIDTH) for seed in seeds}
        name = f"{asked.off:g} % off"
    healthy_lines(name, hidden, known, asked.days)
    fault_lines(name, hidden, known, asked.faults)


if __name__ == "__main__":
    main()
