"""A scenario: a station, its arrivals and how to run them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, NamedTuple

from pydantic import Field, ValidationError, model_validator

from station.arrivals import PERIOD_MAX, Arrivals, Trace, TraceVehicle, Vehicles, sample
from station.errors import InputError
from station.faults.kinds import Faults
from station.faults.plant import PlantFaults, check_plant
from station.margins import Proof, certify
from station.parameters import Station
from station.plants.interface import plant_named
from station.preset_files import DEFAULT_PRESET
from station.quantities import Part
from station.sensors import KINDS, OFF, SensorModel, key_of
from station.station_files import with_changes
from station.tightening import check_serves, tightened
from station.uncertainty import Disturbance
from station.whole import WHOLE


class Named(NamedTuple):
    """Vehicles that the arrivals of a scenario name, and where: ranges of start, tank and finish."""

    field: str
    start_low: float  # [bar]
    start: float  # the highest
    volume_low: float  # [m3]
    volume_high: float
    finish_low: float  # [bar]
    finish_high: float


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
        WHOLE,
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
    faults: Annotated[
        Faults,
        Field(
            default_factory=list,
            description="What is wrong with the station, and when; controllers are not told",
            examples=[[{"kind": "leak", "buffer": "high", "begin_s": 20_000.0, "rate_g_per_s": 0.5}]],
            exclude_if=lambda faults: not faults,  # documents of scenarios without faults stay as they were
        ),
    ]

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
            given["station"] = with_changes(station)
        return given

    @model_validator(mode="before")
    @classmethod
    def _limit(cls, given: Any) -> Any:
        if isinstance(given, dict) and "time_limit_s" not in given:
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
        for named in self._named():
            self._check_fill(named)
        if self.disturbance is not None:
            self._check_disturbed(self.disturbance)
        self._check_faults()
        return self

    def _check_faults(self) -> None:
        check_plant(self.faults, self.station.plant)
        if not self.plant_faults:
            return
        if self.idle_period_s != 1:
            raise ValueError(
                f"idle_period_s must be 1 in a scenario with faults of the plant; given {self.idle_period_s}"
            )
        if self.disturbance is not None:
            raise ValueError(
                "disturbance must be left out of a scenario with faults of the plant: its margins are proved for a "
                "plant that has none"
            )

    @property
    def plant_faults(self) -> PlantFaults:
        """The faults of the plant; false where there are none."""
        return PlantFaults(self.faults)

    def _named(self) -> Iterator[Named]:
        """What the arrivals say of vehicles: of each one of a trace, of each class of a fleet."""
        usual = self.station.vehicle
        if isinstance(self.arrivals, Trace):
            for row, vehicle in enumerate(self.arrivals.vehicles):
                volume, finish = vehicle.volume_m3 or usual.volume_m3, vehicle.finish_pressure_bar
                yield Named(
                    f"arrivals.vehicles.{row}",
                    vehicle.start_pressure_bar,
                    vehicle.start_pressure_bar,
                    volume,
                    volume,
                    *(finish or usual.finish_pressure_bar,) * 2,
                )
            return
        for row, each in enumerate(self.arrivals.fleet):
            volumes = each.volume_m3 or [usual.volume_m3] * 2
            finishes = each.finish_pressure_bar or [usual.finish_pressure_bar] * 2
            starts = each.start_pressure_bar or usual.start_range
            yield Named(f"arrivals.fleet.{row}", starts[0], starts[-1], *volumes, *finishes)

    def _check_fill(self, named: Named) -> None:
        """Raise ValueError unless the station can fill every such vehicle."""
        self.station.check_finish(f"{named.field}.finish_pressure_bar", named.finish_high)
        for finish in (named.finish_low, named.finish_high):
            self.station.check_nominal(f"{named.field}.finish_pressure_bar", finish, communication=self.communication)
        self.station.check_tank(f"{named.field}.volume_m3", named.volume_low)
        if named.start >= named.finish_low:
            raise ValueError(
                f"{named.field}.start_pressure_bar must lie below the finish pressure {named.finish_low:g} bar; "
                f"given {named.start:g}"
            )

    def _check_disturbed(self, disturbance: Disturbance) -> None:
        if self.idle_period_s != 1:
            raise ValueError(f"idle_period_s must be 1 in a scenario with a disturbance; given {self.idle_period_s}")
        check_serves(self.station, disturbance.uncertainty, self.finish_pressure_max)
        if not self.communication:
            for named in self._named():
                for volume in (named.volume_low, named.volume_high):
                    self.check_unseen(f"{named.field}.volume_m3", volume)

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
        return max((named.finish_high for named in self._named()), default=self.station.vehicle.finish_pressure_bar)

    @property
    def emptiest(self) -> float | None:
        """The emptiest vehicle that the slot keeps a buffer able to begin [bar]; None: the station is left as it is."""
        usual = self.station.vehicle.start_range[0]
        return self.station.emptiest(min((named.start_low for named in self._named()), default=usual))

    @property
    def proof(self) -> Proof | None:
        """The margins of a disturbed scenario and what proves them; None where nothing is disturbed."""
        return None if self.disturbance is None else certify(self.station, self.disturbance.uncertainty)

    @property
    def known_station(self) -> Station:
        """The station as controllers and the shield know it: limits moved by their margins in a disturbed scenario."""
        proof = self.proof
        return self.station if proof is None else tightened(self.station, proof)

    def plant(self, replication: int = 0) -> Any:
        """The constants of the plant that is simulated; drawn within its error in a disturbed scenario."""
        constants = plant_named(self.station.plant).constants_of(self.station, communication=self.communication)
        return constants if self.disturbance is None else self.disturbance.sample(constants, replication)

    def sensor_model(self, replication: int = 0) -> SensorModel:
        """The sensors of a replication, as kernels take them."""
        given, usual = self.disturbance, self.station.vehicle.volume_m3
        if given is None:
            return SensorModel(OFF, 0, 0.0, 0.0, 0.0, 0.0, usual, self.station.constants())
        known = given.uncertainty
        return SensorModel(
            KINDS[given.sensors], key_of(given.seed, replication), known.pressure_bar, known.temperature_k,
            known.parameters, self.finish_pressure_max, usual, self.known_station.constants(),
        )  # fmt: skip

    def vehicles(self, replication: int = 0, seed: int = 0) -> Vehicles:
        """The vehicles of one replication; see `station.arrivals.sample`.

        Tanks of vehicles that report nothing are drawn within their error in a disturbed scenario.
        """
        arriving = sample(self.arrivals, self.station.vehicle, replication, seed)
        if self.disturbance is None or self.communication:
            return arriving
        return arriving._replace(volume=arriving.volume * self.disturbance.tanks(len(arriving.volume), replication))

    @property
    def drawn(self) -> bool:
        """Whether replications differ: a trace is the same day in each, unless a disturbance draws something.

        A controller does not see the replication, so that nothing else depends on it.
        """
        if not isinstance(self.arrivals, Trace):
            return True
        return self.disturbance is not None and self.disturbance.drawn(tanks=not self.communication)

    def on(self, station: Station) -> Scenario:
        """The same arrivals at another station."""
        return parse_scenario({**self.model_dump(), "station": station.model_dump()}, self.name)


def _period(arrivals: Any) -> float:
    """Span of arrivals not validated yet [s]; 0 where it cannot be read, for validation to refuse."""
    try:
        if "period_s" in arrivals:
            return float(arrivals["period_s"])
        if "hourly_weights" in arrivals:
            return 3600.0 * len(arrivals["hourly_weights"])
        return max(float(_time(vehicle)) for vehicle in arrivals["vehicles"])
    except (TypeError, ValueError, KeyError, OverflowError):
        return 0.0


def _time(vehicle: Any) -> Any:
    """When a vehicle arrives [s]; long lists are validated piece by piece before the scenario is."""
    return vehicle.time_s if isinstance(vehicle, TraceVehicle) else vehicle["time_s"]


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
