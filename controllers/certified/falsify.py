"""A search for a state from which a vehicle is served late, or never: corners, samples, descent, sequences."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import qmc

from controllers.certified.claim import Claim
from controllers.certified.vehicles import Vehicle
from controllers.slot import create
from station.errors import InputError
from station.geometry import BUFFERS
from station.kernels import CLOSED_CONTROLLER, run_to_end
from station.parameters import Station
from station.plants.interface import M, P, T
from station.plants.thesis import gas_mass
from station.run import ARRIVAL, START_PRESSURE, VOLUME
from station.scenario import parse_scenario
from station.simulation import simulate, start_run

SAMPLES = 256
"""Low-discrepancy states of the box, one vehicle each."""

DESCENTS = 64
"""Steps from the worst state found, each a seeded change of it that is kept where it is worse."""

SEQUENCES = 32
"""Runs of SEQUENCE vehicles s or more apart."""

SEQUENCE = 6
LONGEST_GAP = 8
"""Longest time between arrivals of a sequence, by s."""

PATIENCE = 21_600
"""A vehicle that has not left so long after T starves [s]."""

CONFIDENCE = 1e-6
"""Chance at which the statement on samples may be wrong."""

Progress = Callable[[str], None] | None


@dataclass(frozen=True)
class Counterexample:
    """A run that contradicts a claim."""

    kind: str  # starves, or late
    fill: float  # longest [s]; inf where a vehicle starves
    state: tuple[float, ...]  # of the buffers at first: pressures [bar], temperatures [deg C]
    scenario: dict[str, Any]  # the run, as `hrs simulate` reads it

    def as_document(self) -> dict[str, Any]:
        """As JSON holds it."""
        return {
            "kind": self.kind, "fill_s": self.fill if np.isfinite(self.fill) else None, "state": list(self.state),
            "scenario": self.scenario,
        }  # fmt: skip


@dataclass(frozen=True)
class Tested:
    """Result of a search."""

    simulations: int
    vehicles: int
    worst_fill: float  # [s]
    seed: int
    counterexample: Counterexample | None

    def as_document(self) -> dict[str, Any]:
        """As JSON holds it, with what the samples say if none of them was late.

        With N independent states none of which is late, the share p of late ones is at most 1 - c^(1/N) but for a
        chance c (binomial law).
        """
        share = 1.0 - CONFIDENCE ** (1.0 / SAMPLES) if self.counterexample is None else None
        return {
            "simulations": self.simulations, "vehicles": self.vehicles, "seed": self.seed,
            "worst_fill_s": self.worst_fill if np.isfinite(self.worst_fill) else None,
            "late_share_below": share, "but_for_a_chance_of": CONFIDENCE if share is not None else None,
        }  # fmt: skip


Arrivals = tuple[tuple[float, Vehicle], ...]
"""Who comes when [s]."""


class Falsifier:
    """Runs of one controller at one station from chosen states."""

    def __init__(self, station: Station, name: str, options: dict[str, Any], claim: Claim) -> None:
        self.station, self.name, self.options, self.claim = station, name, options, claim
        self._actor = create(name, **options)
        self._actor.start(station)
        self.runs = self.vehicles = 0
        shield = getattr(self._actor, "fallback", None)
        self._fallback = CLOSED_CONTROLLER
        if shield is not None:
            shield.start(station)
            self._fallback = shield.compiled()
        if getattr(self._actor, "compiled", lambda: None)() is None:
            raise InputError("certificate", [("controller", f"{name} is not compiled: its service cannot be searched")])
        self._prepared: dict[int, Any] = {}

    @property
    def usual(self) -> Vehicle:
        """The station's usual vehicle."""
        return Vehicle(self.station.vehicle.start_pressure_bar, self.station.vehicle.volume_m3)

    def scenario(self, state: np.ndarray, arrivals: Arrivals) -> dict[str, Any]:
        """The run from a state, as a scenario file holds it."""
        station = self.station.model_dump(mode="json")
        for place, buffer in enumerate(BUFFERS):
            station["buffers"][buffer]["initial_pressure_bar"] = float(state[place])
            station["buffers"][buffer]["initial_temperature_c"] = float(state[3 + place])
        return {
            "name": f"counterexample-{self.name}", "about": f"A claim of service of {self.name} fails here.",
            "station": station,
            "arrivals": {
                "kind": "trace",
                "vehicles": [
                    {"time_s": time, "start_pressure_bar": vehicle.start, "volume_m3": vehicle.volume}
                    for time, vehicle in arrivals
                ],
            },
            "time_limit_s": self._limit(arrivals),
        }  # fmt: skip

    def _limit(self, arrivals: Arrivals) -> float:
        """When a run is given up [s]."""
        return arrivals[-1][0] + len(arrivals) * (self.claim.promised + PATIENCE)

    def fills(self, state: np.ndarray, arrivals: Arrivals) -> np.ndarray:
        """How long each vehicle takes, as the claim counts it [s]; inf for one that was never served."""
        if len(arrivals) not in self._prepared:
            given = parse_scenario(self.scenario(np.array(self._initial()), arrivals))
            self._prepared[len(arrivals)] = start_run(given)
        run, rules = self._prepared[len(arrivals)]
        limit = self._limit(arrivals)
        rows = int(limit) + 2
        begun, vehicles = run.state.copy(), run.vehicles.copy()
        vehicles[ARRIVAL] = [time for time, _ in arrivals]
        vehicles[START_PRESSURE] = [vehicle.start for _, vehicle in arrivals]
        vehicles[VOLUME] = [vehicle.volume for _, vehicle in arrivals]
        for buffer, tank in enumerate(self.station.buffers.all):
            begun[P + buffer], begun[T + buffer] = state[buffer], state[3 + buffer]
            begun[M + buffer] = gas_mass(state[buffer], state[3 + buffer], tank.volume_m3)
        run = run._replace(
            state=begun, vehicles=vehicles, counters=run.counters.copy(),
            values=np.empty((run.values.shape[0], rows)), codes=np.empty((run.codes.shape[0], rows), np.uint8),
            counts=np.empty((run.counts.shape[0], rows), np.int32),
        )  # fmt: skip
        run_to_end(run, rules._replace(time_limit=limit), self._actor.compiled(), self._fallback)
        self.runs += 1
        self.vehicles += len(arrivals)
        return self.claim.taken(vehicles[ARRIVAL], vehicles[1], vehicles[2])

    def _initial(self) -> list[float]:
        tanks = self.station.buffers.all
        return [tank.initial_pressure_bar for tank in tanks] + [tank.initial_temperature_c for tank in tanks]

    def confirmed(self, state: np.ndarray, arrivals: Arrivals) -> Counterexample | None:
        """The counterexample, replayed as `hrs simulate` does; None where the replay serves everybody in time."""
        document = self.scenario(state, arrivals)
        record = simulate(parse_scenario(document), create(self.name, **self.options))
        worst = float(self.claim.taken(*(record.vehicles[name] for name in ("arrival", "connected", "finished"))).max())
        if worst <= self.claim.promised:
            return None
        kind = "late" if np.isfinite(worst) else "starves"
        return Counterexample(kind, worst, tuple(map(float, state)), document)


def search(bench: Falsifier, low: np.ndarray, high: np.ndarray, seed: int = 0, progress: Progress = None) -> Tested:
    """Look for a counterexample in the box `low` to `high`; stops at the first vehicle that starves.

    The widest vehicle comes to the corners and with the descent, others of the claim to the samples.
    """
    random, vehicles = np.random.default_rng(seed), bench.claim.vehicles
    sampler = qmc.Halton(6 if vehicles.usual else 8, rng=np.random.default_rng(seed))
    worst, at, by = -1.0, low, vehicles.widest
    corners = ((np.where(corner, high, low), vehicles.widest) for corner in itertools.product((False, True), repeat=6))
    samples = (
        (low + (high - low) * point[:6], vehicles.widest if vehicles.usual else vehicles.drawn(point[6:]))
        for point in sampler.random(SAMPLES)
    )
    for number, (state, vehicle) in enumerate(itertools.chain(corners, samples)):
        if progress and number % 32 == 0:
            progress(f"state {number} of {64 + SAMPLES}, worst fill {max(worst, 0.0):.0f} s")
        fill = float(bench.fills(state, ((0.0, vehicle),))[0])
        if fill > worst:
            worst, at, by = fill, state, vehicle
        if not np.isfinite(worst):
            return _tested(bench, worst, seed, at, ((0.0, by),))
    for step in range(DESCENTS):
        state = np.clip(at + random.normal(size=6) * (high - low) * 0.2 * 0.5 ** (8 * step / DESCENTS), low, high)
        fill = float(bench.fills(state, ((0.0, by),))[0])
        if fill > worst:
            worst, at = fill, state
    if worst > bench.claim.promised:
        return _tested(bench, worst, seed, at, ((0.0, by),))
    return _sequences(bench, low, high, seed, worst, random, progress)


def _sequences(
    bench: Falsifier, low: np.ndarray, high: np.ndarray, seed: int, worst: float, random: np.random.Generator,
    progress: Progress,
) -> Tested:  # fmt: skip
    """Go on with vehicles one after the other, s apart, or as long as LONGEST_GAP s; at first the widest.

    Where the claim is of bursts, half of the vehicles that may come with the one before do.
    """
    vehicles, spacing, drawn = bench.claim.vehicles, bench.claim.spacing, np.random.default_rng(seed + 1)
    for number in range(SEQUENCES):
        if progress and number % 8 == 0:
            progress(f"sequence {number} of {SEQUENCES}, worst fill {worst:.0f} s")
        gaps = (
            np.ceil(spacing * LONGEST_GAP ** random.random(SEQUENCE - 1)) if number else np.full(SEQUENCE - 1, spacing)
        )
        if bench.claim.burst > 1:
            gaps = np.where(random.random(SEQUENCE - 1) < 0.5 * bool(number), gaps, 0.0)
        times = map(float, bench.claim.times(gaps))
        arrivals = tuple((time, vehicles.drawn(drawn.random(2)) if number % 2 else vehicles.widest) for time in times)
        state = low + (high - low) * random.random(6)
        longest = float(bench.fills(state, arrivals).max())
        worst = max(worst, longest)
        if longest > bench.claim.promised:
            return _tested(bench, longest, seed, state, arrivals)
    return Tested(bench.runs, bench.vehicles, worst, seed, None)


def _tested(bench: Falsifier, worst: float, seed: int, state: np.ndarray, arrivals: Arrivals) -> Tested:
    found = bench.confirmed(state, arrivals)
    return Tested(bench.runs, bench.vehicles, worst, seed, found)
