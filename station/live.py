"""A run without an end in sight: stepped second by second, its record passing through a window."""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np

from station.archives import pack, unpack
from station.columns import CODES, COUNTS, VALUES
from station.controller import NEVER, CompiledController, Decision, Observation
from station.entry_points import EntryPoint
from station.errors import InputError
from station.forecasting.demand import Seen
from station.forecasting.fork import Fork
from station.geometry import BUFFERS, CLOSED
from station.kernels import CLOSED_CONTROLLER, apply, begin, leak_second, observe
from station.plants.interface import OWN, M, plant_named
from station.record import vehicle_columns
from station.run import (
    ARRIVAL,
    ARRIVED,
    CLOCK,
    CURRENT,
    DELIVERED,
    FINISH_PRESSURE,
    NEXT,
    PERIOD,
    ROW,
    START_PRESSURE,
    START_TEMPERATURE,
    VOLUME,
    RunParameters,
    ailing,
)
from station.scenario import Scenario
from station.sensors import TUBE
from station.simulation import start_run, vehicle_table

WINDOW = 1024
"""Rows kept of the record: only the newest is ever read."""

GONE_MAX = 64
"""Vehicles that have left are dropped when there are so many: a run of months keeps its size."""

SNAPSHOT_VERSION = 2

_UNWATCHED = 1
"""The version before an account was kept of the seconds in which a vehicle is given nothing; still read."""

_WATCHED = 3
"""Entries of that account in RunState.state, before `TUBE`."""

_VEHICLE = list(COUNTS).index("vehicle")
_STATE = ("state", "counters", "vehicles")
_NUMBERS = ("version", "rows", "gone", "replication", "shift")


class AtEnd(StrEnum):
    """Continuations of a run whose vehicles are served."""

    STOP = "stop"  # ends as a simulation does
    IDLE = "idle"  # goes on without vehicles; some may be added
    REPEAT = "repeat"  # draws the next replication's vehicles when the last arrives


class SlotState(NamedTuple):
    """A controller as a live run asks it."""

    decide: Callable[[Observation], Decision]
    obeys_hold: bool = True
    wake_pressure: tuple[float, float, float] = NEVER
    fallback: CompiledController = CLOSED_CONTROLLER  # asked where the shield closes a valve
    liveness: float = math.inf  # it stands in when a vehicle has been given nothing for so long [s]


class Second(NamedTuple):
    """Outcome of one second. Vehicles are counted from the run's first."""

    seq: int  # row of the record, from 0
    row: tuple[float, ...]  # VALUES, CODES and COUNTS of station.columns in their order, then the plant's own columns
    arrived: range  # vehicles that arrived
    connected: int  # vehicle that was connected, or -1
    left: int  # vehicle that left at the end of the second, filled or not, or -1
    figures: dict[str, float]  # vehicle_columns of the one that left
    over: bool  # the run has ended: this row is its last
    energy: float = 0.0  # electric, of the second [kWh]; 0 where the plant keeps no account of it
    stock: tuple[float, ...] = ()  # masses of the buffers at its end [g]; () where the station has no tariff


class LiveRun:
    """A scenario run second by second, for as long as wanted.

    The same kernels advance it as advance a simulation: with `AtEnd.STOP` the rows are those of `simulate`, bit for
    bit. Every second has a row, whatever the scenario's `idle_period_s`.
    """

    def __init__(self, scenario: Scenario, at_end: AtEnd, replication: int = 0, seed: int = 0) -> None:
        self.scenario = scenario
        self.at_end = at_end
        self.over = False
        self._seed = seed
        self._replication = replication
        self._shift = 0.0  # of the current replication's arrivals [s]
        self._begin, self._observe, self._apply = EntryPoint(begin), EntryPoint(observe), EntryPoint(apply)
        self._leak = EntryPoint(leak_second)
        self._fallback: CompiledController | None = None  # of whose types `_apply` is
        self._rows = 0  # rows that have left the window
        self._gone = 0  # vehicles that have been dropped
        run, parameters = start_run(scenario, replication, seed)
        limit = parameters.time_limit if at_end is AtEnd.STOP else math.inf
        self._parameters: RunParameters = parameters._replace(idle_period=PERIOD, time_limit=limit)
        self._faults, self._healthy = scenario.plant_faults, parameters.plant
        plant = plant_named(scenario.station.plant)
        self._is_billed = scenario.station.tariff is not None
        self._powers = [len(VALUES) + list(plant.rates).index(name) for name in plant.powers]
        self._run = run._replace(
            values=np.empty((len(run.values), WINDOW)),
            codes=np.zeros((len(CODES), WINDOW), np.uint8),
            counts=np.empty((len(COUNTS), WINDOW), np.int32),
        )

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return float(self._run.state[CLOCK])

    @property
    def seq(self) -> int:
        """Row that the next second will write."""
        return self._rows + int(self._run.counters[ROW])

    def step(self, slot: SlotState) -> Second:
        """Simulate one second: arrivals, a decision, the shield, the plant. Whatever `slot.decide` raises passes.

        A decision that was refused with an error leaves the run where it was: the second can be stepped again.
        """
        counters = self._run.counters
        if counters[ROW] == WINDOW:
            self._rows += WINDOW
            counters[ROW] = 0
        if self.at_end is AtEnd.REPEAT and not self._awaits_vehicles():
            self._append_replication()
        arrived, connected = int(counters[ARRIVED]), int(counters[CURRENT])
        going = self._begin(self._run, self._parameters)
        seq, row = self.seq, int(counters[ROW])
        now_connected = int(counters[CURRENT])
        left, figures = -1, {}
        if going or self.at_end is not AtEnd.STOP:
            time = self.time
            if self._faults:
                plant = self._faults.constants(self._healthy, time)
                self._parameters = ailing(self._parameters, plant, self._faults.stuck(time))
            observation = self._observation()
            decision = slot.decide(observation)
            if slot.liveness != self._parameters.liveness:
                self._parameters = self._parameters._replace(liveness=slot.liveness)
            if slot.fallback is not self._fallback:
                self._apply, self._fallback = EntryPoint(apply), slot.fallback
            self._apply(
                self._run, self._parameters, observation, decision, slot.obeys_hold, slot.wake_pressure, slot.fallback
            )  # fmt: skip
            if self._faults:
                self._leak(self._run, self._parameters, self._faults.rates(time))
            if now_connected >= 0 and counters[CURRENT] < 0:
                left, figures = self._gone + now_connected, self.vehicle(self._gone + now_connected)
        else:
            self.over = True
            counters[ROW] += 1
        second = Second(
            seq,
            self._row(row),
            range(self._gone + arrived, self._gone + int(counters[ARRIVED])),
            self._gone + now_connected if now_connected >= 0 and now_connected != connected else -1,
            left,
            figures,
            self.over,
            self._energy(row),
            self.stock() if self._is_billed else (),
        )
        if counters[CURRENT] < 0 and counters[NEXT] >= GONE_MAX:
            self._forget_the_gone()
        return second

    def _observation(self) -> Observation:
        """What the controller sees; it, too, counts vehicles from the run's first."""
        seen = self._observe(self._run, self._parameters)
        return seen._replace(vehicle=seen.vehicle + self._gone) if self._gone and seen.vehicle >= 0 else seen

    def _row(self, row: int) -> tuple[float, ...]:
        run = self._run
        counts = run.counts[:, row].tolist()
        if counts[_VEHICLE] >= 0:
            counts[_VEHICLE] += self._gone
        values, shared = run.values[:, row].tolist(), len(VALUES)
        return (*values[:shared], *run.codes[:, row].tolist(), *counts, *values[shared:])

    def _energy(self, row: int) -> float:
        """What the second of a row took [kWh]."""
        return float(self._run.values[self._powers, row].sum()) * PERIOD / 3600 if self._powers else 0.0

    def stock(self) -> tuple[float, ...]:
        """Masses of the buffers now [g], in the order of BUFFERS."""
        return tuple(self._run.state[M : M + len(BUFFERS)].tolist())

    def vehicle(self, index: int) -> dict[str, float]:
        """Columns of the table of vehicles of one that has not been dropped; NaN where it has no figure yet."""
        columns = vehicle_columns(self.scenario.station.plant)
        return dict(zip(columns, self._run.vehicles[:, index - self._gone].tolist(), strict=True))

    def _awaits_vehicles(self) -> bool:
        """Whether a vehicle is to arrive after this second."""
        arrivals = self._run.vehicles[ARRIVAL]
        return len(arrivals) > 0 and bool(arrivals[-1] > self.time)

    def _append_replication(self) -> None:
        self._replication += 1
        # A trace may end with its first second: its next replication begins a second later.
        self._shift += max(PERIOD, math.ceil(self.scenario.arrivals.period_s))
        new = vehicle_table(self.scenario, self._replication, self._seed)
        new[ARRIVAL] += self._shift
        self._run = self._run._replace(vehicles=np.hstack((self._run.vehicles, new)))

    def _forget_the_gone(self) -> None:
        """Drop vehicles that have left; done between two vehicles, so that no controller sees one renamed."""
        counters = self._run.counters
        gone = int(counters[NEXT])
        self._run = self._run._replace(vehicles=np.ascontiguousarray(self._run.vehicles[:, gone:]))
        counters[ARRIVED] -= gone
        counters[NEXT] = 0
        self._gone += gone

    def add_vehicle(
        self, start_pressure: float, *, start_temperature: float | None = None, volume: float | None = None,
        finish_pressure: float | None = None,
    ) -> int:  # fmt: skip
        """Let a vehicle arrive with the next second; pressures in bar, temperature in deg C, volume in m3.

        What is left out is the station's usual vehicle's. Returns the vehicle's number.

        Raises
        ------
        InputError
            naming the figure with which nobody could fill it.
        """
        station = self.scenario.station
        usual = station.vehicle
        volume = usual.volume_m3 if volume is None else volume
        finish = usual.finish_pressure_bar if finish_pressure is None else finish_pressure
        temperature = usual.start_temperature_c if start_temperature is None else start_temperature
        try:
            station.check_finish("finish_pressure_bar", finish)
            station.check_nominal("finish_pressure_bar", finish, communication=self.scenario.communication)
            station.check_tank("volume_m3", volume)
            self.scenario.check_unseen("volume_m3", volume, finish)
        except ValueError as error:
            raise InputError("vehicle", [("", str(error))]) from None
        if start_pressure >= finish:
            message = f"must lie below the finish pressure {finish:g} bar; given {start_pressure:g}"
            raise InputError("vehicle", [("start_pressure_bar", message)])
        if temperature > usual.temperature_max_c:
            message = f"must not exceed {usual.temperature_max_c:g} degC; given {temperature:g}"
            raise InputError("vehicle", [("start_temperature_c", message)])
        place = int(np.searchsorted(self._run.vehicles[ARRIVAL], self.time, side="right"))
        new = np.full((len(self._run.vehicles), 1), np.nan)
        given = (self.time, start_pressure, temperature, volume, finish, 0.0)
        new[[ARRIVAL, START_PRESSURE, START_TEMPERATURE, VOLUME, FINISH_PRESSURE, DELIVERED], 0] = given
        vehicles = self._run.vehicles
        self._run = self._run._replace(vehicles=np.hstack((vehicles[:, :place], new, vehicles[:, place:])))
        return self._gone + place

    @property
    def waited(self) -> float:
        """How long the first of the queue has waited [s]; 0 where nobody waits."""
        counters = self._run.counters
        if counters[ARRIVED] == counters[NEXT]:
            return 0.0
        return self.time - float(self._run.vehicles[ARRIVAL, counters[NEXT]])

    def set_faults(self, scenario: Scenario) -> None:
        """Let the faults of the plant be those of a scenario that has others than the run's, and nothing else."""
        self._faults = scenario.plant_faults
        if not self._faults:
            self._parameters = ailing(self._parameters, self._healthy, (CLOSED, CLOSED))

    def fork(self) -> Fork:
        """Fork of the run as it stands now; times and vehicles are the run's own."""
        run = self._run
        healthy = ailing(self._parameters, self._healthy, (CLOSED, CLOSED))
        return Fork(run.state.copy(), run.counters.copy(), run.vehicles.copy(), healthy, self._faults, self._gone)

    def seen(self) -> Seen:
        """The vehicles that have arrived, of those not dropped, and for how long they were watched [s]."""
        came = self._run.vehicles[:, : int(self._run.counters[ARRIVED])].copy()
        since = float(came[ARRIVAL, 0]) if self._gone and came.shape[1] else 0.0
        return Seen(came, self.time - since)

    def snapshot(self, **memories: np.ndarray) -> bytes:
        """Everything needed to go on in another process, with the memories of controllers beside it."""
        run = self._run
        numbers = (SNAPSHOT_VERSION, self.seq, self._gone, self._replication, self._shift)
        arrays: dict[str, Any] = {name: getattr(run, name) for name in _STATE}
        arrays |= {f"memory_{name}": memory for name, memory in memories.items()}
        return pack({"numbers": np.array(numbers, float), "over": np.array(self.over), **arrays})

    def restore(self, snapshot: bytes) -> dict[str, np.ndarray]:
        """Go on from a snapshot of a run of the same scenario; the memories it carries.

        Raises
        ------
        InputError
            if it is no snapshot of this version; the run is as it was.
        """
        arrays = _read(snapshot, self._run.state.shape, len(self._run.vehicles))
        numbers = dict(zip(_NUMBERS, arrays["numbers"].tolist(), strict=True))
        state, counters, vehicles = (arrays[name] for name in _STATE)
        counters[ROW] = 0
        self._run = self._run._replace(state=state, counters=counters, vehicles=np.ascontiguousarray(vehicles))
        self._rows, self._gone = int(numbers["rows"]), int(numbers["gone"])
        self._replication, self._shift = int(numbers["replication"]), numbers["shift"]
        self.over = bool(arrays["over"])
        return {name.removeprefix("memory_"): array for name, array in arrays.items() if name.startswith("memory_")}


def _read(snapshot: bytes, shape: tuple[int, ...], columns: int) -> dict[str, np.ndarray]:
    """The arrays of a snapshot, refused where the kernels would read beyond them: these check no index."""
    arrays = unpack(snapshot)
    try:
        version = float(arrays["numbers"].flat[0])
        if version == _UNWATCHED and arrays["state"].shape == (shape[0] - _WATCHED,):
            before, behind = np.split(arrays["state"], [TUBE - _WATCHED])
            arrays["state"] = np.concatenate((before, np.zeros(_WATCHED), behind))
            version = float(SNAPSHOT_VERSION)
        wrong = "" if version != SNAPSHOT_VERSION else _wrong(arrays, shape, columns)
    except (ValueError, TypeError, KeyError, IndexError) as error:
        raise InputError("snapshot", [("", f"cannot be read: {error}")]) from None
    if version != SNAPSHOT_VERSION:
        raise InputError("snapshot", [("version", f"must be {SNAPSHOT_VERSION}; given {version:g}")])
    if wrong:
        raise InputError("snapshot", [(wrong, "cannot be read: it is none that a run could have written")])
    return arrays


def _wrong(arrays: dict[str, np.ndarray], shape: tuple[int, ...], columns: int) -> str:
    """The first array that no run could have written, or ""; `columns` are those of the table of vehicles."""
    shapes = {"numbers": (len(_NUMBERS),), "over": (), "state": shape, "counters": (5,)}
    types = {"over": np.bool_, "counters": np.int64}
    for name in ("numbers", "over", *_STATE):
        array = arrays[name]
        shape = shapes.get(name, (columns, *array.shape[-1:]))
        if array.shape != shape or array.dtype != types.get(name, np.float64):
            return name
    state, counters, vehicles = (arrays[name] for name in _STATE)
    if not np.isfinite(arrays["numbers"]).all():
        return "numbers"
    if not np.isfinite(state[:OWN]).all() or np.isinf(state[OWN:]).any():  # a plant may have entries without a figure
        return "state"
    ordered = -1 <= counters[CURRENT] < counters[NEXT] <= counters[ARRIVED] <= vehicles.shape[1]
    return "" if ordered else "counters"
