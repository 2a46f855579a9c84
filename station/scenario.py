"""A scenario: a station, its arrivals and how to run them; S1-S4 and examples are files in data/scenarios."""

from __future__ import annotations

import csv
import json
import tomllib
from collections.abc import Iterator
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, ValidationError, model_validator

from station.arrivals import PERIOD_MAX, Arrivals, Trace, Vehicles, realise
from station.errors import InputError
from station.margins import Proof, cautious, certify, check_serves
from station.parameters import DEFAULT_PRESET, Part, Station, load_station
from station.plant import PlantConstants
from station.sensing import KINDS, OFF, Sensing, key_of
from station.uncertainty import Disturbance

SCENARIOS = files("station") / "data" / "scenarios"

FILE_MAX = 8_000_000
"""Largest scenario or trace file read [bytes]: COUNT_MAX vehicles take a tenth of it."""

_COLUMNS = {"time_s", "start_pressure_bar", "volume_m3", "finish_pressure_bar"}
_REQUIRED = {"time_s", "start_pressure_bar"}


class Scenario(Part):
    """Everything one run needs but the controller."""

    name: Annotated[str, Field(min_length=1, max_length=64)]
    about: str = ""
    station: Station
    arrivals: Arrivals
    communication: Annotated[
        bool, Field(description="Whether vehicles report pressure and temperature while they fill")
    ] = True
    announcement_s: Annotated[
        float,
        Field(
            ge=0,
            le=86_400,
            allow_inf_nan=False,
            description="How long before they arrive vehicles say so; 0: nobody does, as in the thesis",
            json_schema_extra={"unit": "s"},
        ),
    ] = 0.0
    idle_period_s: Annotated[
        int,
        Field(
            ge=1,
            le=60,
            description="Seconds from one decision to the next while no vehicle is connected and every valve is closed",
            json_schema_extra={"unit": "s"},
        ),
    ] = 1
    time_limit_s: Annotated[
        float,
        Field(
            gt=0,
            le=3 * PERIOD_MAX,
            allow_inf_nan=False,
            description="A run ends here at the latest; left out: twice the span of the arrivals and four hours",
            json_schema_extra={"unit": "s"},
        ),
    ]
    disturbance: Annotated[
        Disturbance | None,
        Field(
            description="Noisy sensors and a plant that differs; the shield then decides from readings with margins",
            examples=[{"sensors": "uniform", "plant": "corner", "seed": 7}],
        ),
    ] = None

    @model_validator(mode="before")
    @classmethod
    def _resolve(cls, given: Any) -> Any:
        """Resolve a station's name or `preset` with changes, and the default time limit."""
        if not isinstance(given, dict):
            return given
        given = dict(given)
        station = given.get("station", DEFAULT_PRESET)
        if isinstance(station, str):
            station = {"preset": station}
        if isinstance(station, dict) and "preset" in station:
            changes = {key: value for key, value in station.items() if key != "preset"}
            base = load_station(str(station["preset"])).model_dump()
            given["station"] = _merged(base, changes)
        return given

    @model_validator(mode="before")
    @classmethod
    def _limit(cls, given: Any) -> Any:
        if isinstance(given, dict) and given.get("time_limit_s") is None:
            period = _period(given.get("arrivals"))
            return {**given, "time_limit_s": 2.0 * period + 14_400.0}
        return given

    @model_validator(mode="after")
    def _runnable(self) -> Scenario:
        if self.time_limit_s < self.arrivals.period_s:
            raise ValueError(
                f"time_limit_s must not end before the last arrival at {self.arrivals.period_s:g} s; "
                f"given {self.time_limit_s:g}"
            )
        if isinstance(self.arrivals, Trace):
            for row, vehicle in enumerate(self.arrivals.vehicles):
                field = f"arrivals.vehicles.{row}.finish_pressure_bar"
                finish = vehicle.finish_pressure_bar or self.station.vehicle.finish_pressure_bar
                self.station.check_finish(field, finish)
                if vehicle.volume_m3:
                    self.station.check_tank(f"arrivals.vehicles.{row}.volume_m3", vehicle.volume_m3)
                if vehicle.start_pressure_bar >= finish:
                    raise ValueError(
                        f"arrivals.vehicles.{row}.start_pressure_bar must lie below the finish pressure "
                        f"{finish:g} bar; given {vehicle.start_pressure_bar:g}"
                    )
        if self.disturbance is not None:
            self._check_disturbed(self.disturbance)
        return self

    def _check_disturbed(self, disturbance: Disturbance) -> None:
        if self.idle_period_s != 1:
            raise ValueError(f"idle_period_s must be 1 in a scenario with a disturbance; given {self.idle_period_s}")
        check_serves(self.station, disturbance.uncertainty, self.finish_pressure_max)
        if isinstance(self.arrivals, Trace) and not self.communication:
            for row, vehicle in enumerate(self.arrivals.vehicles):
                if vehicle.volume_m3:
                    self.check_unseen(f"arrivals.vehicles.{row}.volume_m3", vehicle.volume_m3)

    def check_unseen(self, field: str, volume: float, finish: float = 0.0) -> None:
        """Raise ValueError if a disturbed station without communication could not know such a vehicle.

        `volume` [m3] is its tank's, `finish` [bar] the pressure at which it leaves.
        """
        if self.disturbance is None or self.communication:
            return
        usual, width = self.station.vehicle.volume_m3, self.disturbance.uncertainty.parameters
        if volume != usual:
            raise ValueError(
                f"{field} must be the station's usual {usual:g} m3 where a disturbance without communication draws it "
                f"within {width:g} of that; given {volume:g}"
            )
        if finish > self.finish_pressure_max:
            raise ValueError(
                f"finish_pressure_bar must not exceed {self.finish_pressure_max:g} bar, which the station takes for "
                f"the highest pressure of a vehicle that reports nothing; given {finish:g}"
            )

    @property
    def finish_pressure_max(self) -> float:
        """The highest pressure at which a vehicle of this scenario leaves [bar]."""
        usual = self.station.vehicle.finish_pressure_bar
        given = self.arrivals.vehicles if isinstance(self.arrivals, Trace) else []
        return max([vehicle.finish_pressure_bar or usual for vehicle in given], default=usual)

    @property
    def proof(self) -> Proof | None:
        """The margins of a disturbed scenario and what proves them; None where nothing is disturbed."""
        return None if self.disturbance is None else certify(self.station, self.disturbance.uncertainty)

    @property
    def told(self) -> Station:
        """The station as controllers and the shield know it: limits moved by their margins in a disturbed scenario."""
        proof = self.proof
        return self.station if proof is None else cautious(self.station, proof)

    def plant(self, replication: int = 0) -> PlantConstants:
        """The plant that is simulated; drawn within its error in a disturbed scenario."""
        plant = self.station.constants()
        return plant if self.disturbance is None else self.disturbance.realise(plant, replication)

    def sensing(self, replication: int = 0) -> Sensing:
        """The sensors of a replication, as kernels take them."""
        given, usual = self.disturbance, self.station.vehicle.volume_m3
        if given is None:
            return Sensing(OFF, 0, 0.0, 0.0, 0.0, 0.0, usual, self.station.constants())
        known = given.uncertainty
        return Sensing(
            KINDS[given.sensors], key_of(given.seed, replication), known.pressure_bar, known.temperature_k,
            known.parameters, self.finish_pressure_max, usual, self.told.constants(),
        )  # fmt: skip

    def vehicles(self, replication: int = 0, seed: int = 0) -> Vehicles:
        """The vehicles of one replication; see `station.arrivals.realise`.

        Tanks of vehicles that report nothing are drawn within their error in a disturbed scenario.
        """
        arriving = realise(self.arrivals, self.station.vehicle, replication, seed)
        if self.disturbance is None or self.communication:
            return arriving
        return arriving._replace(volume=arriving.volume * self.disturbance.tanks(len(arriving.volume), replication))

    def on(self, station: Station) -> Scenario:
        """The same arrivals at another station."""
        return parse_scenario({**self.model_dump(), "station": station.model_dump()}, self.name)


def _merged(base: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """`base` with `changes` laid over it, group by group."""
    merged = dict(base)
    for key, value in changes.items():
        below = merged.get(key)
        merged[key] = _merged(below, value) if isinstance(below, dict) and isinstance(value, dict) else value
    return merged


def _period(arrivals: Any) -> float:
    """Span of arrivals not validated yet [s]; 0 where it cannot be told, for validation to refuse."""
    try:
        if "period_s" in arrivals:
            return float(arrivals["period_s"])
        if "hourly_weights" in arrivals:
            return 3600.0 * len(arrivals["hourly_weights"])
        return max(float(vehicle["time_s"]) for vehicle in arrivals["vehicles"])
    except (TypeError, ValueError, KeyError, OverflowError):
        return 0.0


def scenarios() -> list[str]:
    """Names of the scenarios that ship with the package."""
    return sorted(item.name.removesuffix(".toml") for item in SCENARIOS.iterdir() if item.name.endswith(".toml"))


def parse_scenario(given: dict[str, Any], source: str = "scenario") -> Scenario:
    """A scenario from a mapping, as in a TOML or JSON file.

    Raises
    ------
    InputError
        naming each wrong field with its limit.
    """
    try:
        return Scenario.model_validate(given)
    except ValidationError as error:
        raise InputError.of(source, error) from None


def load_scenario(name: str | Path) -> Scenario:
    """The scenario of that name, or of a TOML, JSON or CSV file.

    A CSV file is a trace (see `read_trace`) at the default station. In a TOML or JSON file `arrivals.file` names
    a trace beside it.

    Raises
    ------
    InputError
        naming each wrong field with its limit, or the file that cannot be read.
    """
    if str(name) in scenarios():
        entry = SCENARIOS / f"{name}.toml"
        return parse_scenario(_with_trace(_parse(entry, str(name)), SCENARIOS), str(name))
    path = Path(name)
    if path.suffix not in (".toml", ".json", ".csv"):
        known = ", ".join(scenarios())
        raise InputError(
            "scenario", [("", f"{str(name)!r} is neither a scenario ({known}) nor a .toml, .json or .csv file")]
        )
    if path.suffix == ".csv":
        given = {"name": path.stem[:64], "arrivals": {"kind": "trace", "vehicles": read_trace(path)}}
    else:
        given = _with_trace(_parse(path, str(name)), path.parent)
    return parse_scenario(given, str(name))


def load_station_file(name: str) -> Station:
    """The preset of that name, or the station of a TOML or JSON file: a whole one, or a `preset` with changes.

    Raises
    ------
    InputError
        naming each wrong field with its limit, or the file that cannot be read.
    """
    path = Path(name)
    if path.suffix not in (".toml", ".json"):
        return load_station(name)
    given = _parse(path, name)
    try:
        if "preset" in given:
            changes = {key: value for key, value in given.items() if key != "preset"}
            given = _merged(load_station(str(given["preset"])).model_dump(), changes)
        return Station.model_validate(given)
    except ValidationError as error:
        raise InputError.of(name, error) from None


def read_trace(path: Traversable | Path) -> list[dict[str, float]]:
    """Vehicles of a CSV file with columns time_s, start_pressure_bar and, where wanted, volume_m3, finish_pressure_bar.

    Raises
    ------
    InputError
        naming the line and column that cannot be read.
    """
    return parse_trace(_text(path), str(path))


def parse_trace(text: str, source: str = "trace") -> list[dict[str, float]]:
    """Vehicles of a CSV text; see `read_trace`.

    Raises
    ------
    InputError
        naming the line and column that cannot be read.
    """
    rows = _rows(text, source)
    header = [name.strip() for name in next(rows, [])]
    if not set(header) >= _REQUIRED or not set(header) <= _COLUMNS or len(set(header)) != len(header):
        names, extra = ", ".join(sorted(_REQUIRED)), ", ".join(sorted(_COLUMNS - _REQUIRED))
        given = ", ".join(header) or "nothing"
        raise InputError(source, [("line 1", f"columns must be {names} and may be {extra}; given {given}")])
    vehicles, problems = [], []
    for line, row in enumerate(rows, start=2):
        if not row:
            continue
        if len(row) != len(header):
            problems.append((f"line {line}", f"must have {len(header)} values; given {len(row)}"))
            continue
        vehicle = {}
        for column, cell in zip(header, row, strict=True):
            if not cell.strip() and column not in _REQUIRED:
                continue
            try:
                vehicle[column] = float(cell)
            except ValueError:
                problems.append((f"line {line}, {column}", f"must be a number; given {cell!r}"))
        vehicles.append(vehicle)
    if problems:
        raise InputError(source, problems[:20])
    return vehicles


def _rows(text: str, source: str) -> Iterator[list[str]]:
    """The lines of a CSV text, apart; InputError at the first that is none."""
    rows = csv.reader(text.splitlines())
    try:
        yield from rows
    except csv.Error as error:
        raise InputError(source, [(f"line {rows.line_num}", f"cannot be read: {error}")]) from None


def _text(path: Traversable | Path) -> str:
    try:
        with path.open("rb") as stream:
            content = stream.read(FILE_MAX + 1)
        if len(content) > FILE_MAX:
            raise InputError(str(path), [("", f"must not exceed {FILE_MAX:,} bytes")])
        return content.decode("utf-8-sig")
    except OSError as error:
        raise InputError(str(path), [("", f"cannot be read: {error.strerror}")]) from None
    except UnicodeDecodeError:
        raise InputError(str(path), [("", "is not UTF-8 text")]) from None
    except ValueError as error:  # no file can have that name: it has a NUL, or half a character
        raise InputError(str(path), [("", f"cannot be read: {error}")]) from None


def _parse(path: Traversable | Path, source: str) -> dict[str, Any]:
    text = _text(path)
    try:
        given = json.loads(text) if path.name.endswith(".json") else tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # a number of thousands of digits is a plain ValueError
        raise InputError(source, [("", f"cannot be parsed: {error}")]) from None
    if not isinstance(given, dict):
        raise InputError(source, [("", "must be a table of fields")])
    return given


def _with_trace(given: dict[str, Any], folder: Any) -> dict[str, Any]:
    """Read `arrivals.file`, a CSV trace beside the scenario, into the scenario."""
    arrivals = given.get("arrivals")
    if not isinstance(arrivals, dict) or "file" not in arrivals:
        return given
    rest = {key: value for key, value in arrivals.items() if key != "file"}
    return {**given, "arrivals": {"kind": "trace", **rest, "vehicles": read_trace(folder / str(arrivals["file"]))}}
