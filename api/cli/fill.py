"""The command `fill`: one fill of a vehicle's tank by the real-gas model, and what ended it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from station import InputError

if TYPE_CHECKING:
    from station.plants.real_gas.fill import Fill, FillStart
    from station.plants.real_gas.ramp import RampChoice, Spread

_BAR = 1e5
_PER_MINUTE = 1e6 / 60
_ROWS = 12
"""Of the table, about."""


def fill(
    tank: Annotated[str, typer.Option(metavar="CLASS-LITRES", help="type1, type3 or type4 and a volume: type4-122")],
    start: Annotated[float, typer.Option("--from", metavar="BAR", help="pressure in the tank before")],
    ambient: Annotated[float, typer.Option(metavar="DEGC", help="temperature of the air")] = 20.0,
    ramp: Annotated[
        str, typer.Option(metavar="MPA/MIN|auto", help="auto: the largest that keeps the worst such tank below 85 degC")
    ] = "auto",
    target: Annotated[
        float | None, typer.Option(metavar="PERCENT", help="state of charge that ends it; 95 by default")
    ] = None,
    nwp: Annotated[
        float | None, typer.Option(metavar="BAR", help="nominal working pressure; usual of its class")
    ] = None,
    delivery: Annotated[
        float | None, typer.Option(metavar="DEGC", help="temperature of the gas at the nozzle; -33 by default")
    ] = None,
    cooldown: Annotated[
        float, typer.Option(metavar="SECONDS", help="for so long at first the gas is as warm as the air")
    ] = 0.0,
    soak: Annotated[float, typer.Option(metavar="K", help="tank warmer than the air before the fill")] = 0.0,
    flow_max: Annotated[
        float | None, typer.Option(metavar="G/S", help="limit of the nozzle's flow; 60 by default")
    ] = None,
    json_file: Annotated[Path | None, typer.Option("--json", metavar="FILE", help="write every second as JSON")] = None,
    plot: Annotated[Path | None, typer.Option(metavar="FILE.png", help="draw it (.png, .svg or .pdf)")] = None,
    *,
    communication: Annotated[
        bool,
        typer.Option(
            "--communication/--no-communication",
            help="without it a pressure ends the fill: where the coldest tank would be full",
        ),
    ] = True,
) -> None:
    """Fill one tank: pressure, temperatures of gas and wall, flow and state of charge until a limit ends it."""
    from api.files import check_writable, write_json
    from api.runs.plot import check_format

    for path in (json_file, plot):
        if path:
            check_writable(path)
    if plot:
        check_format(plot)
    given = _Given(
        tank, start, ambient, ramp, target, nwp, delivery, cooldown, soak, flow_max, communication=communication
    )
    found, choice = given.run()
    _print(found, choice, given.start)
    if json_file:
        write_json(json_file, _document(found, choice, given.start))
    if plot:
        from api.cli.gas_plots import plot_fill

        plot_fill(found, plot)


class _Given:
    """The options of a fill, checked, in SI units."""

    def __init__(
        self, tank: str, start: float, ambient: float, ramp: str, target: float | None, nwp: float | None,
        delivery: float | None, cooldown: float, soak: float, flow_max: float | None, *, communication: bool,
    ) -> None:  # fmt: skip
        from station.geometry import KELVIN
        from station.plants.real_gas.catalog import DISPENSING, tank_kind
        from station.plants.real_gas.fill import FillStart
        from station.plants.real_gas.tables import TEMPERATURE_MIN

        usual, limits = DISPENSING["usual"], DISPENSING["limits"]
        nominal = None if nwp is None else _within("--nwp", nwp, 100, 700, "bar") * _BAR
        self.kind = tank_kind(tank, nominal)
        pressure = _within("--from", start, 1, self.kind.pressure_max / _BAR, "bar") * _BAR
        air = _within("--ambient", ambient, -40, 60, "degC") + KELVIN
        self.start = FillStart(pressure, air + _within("--soak", soak, -40, 40, "K"), air)
        self.target = _within("--target", usual["target_percent"] if target is None else target, 10, 100, "%") / 100
        cold = usual["delivery_temperature_C"] if delivery is None else delivery
        self.delivery = _within("--delivery", cold, math.ceil(TEMPERATURE_MIN - KELVIN), 60, "degC") + KELVIN
        self.cooldown = _within("--cooldown", cooldown, 0, 600, "s")
        most = limits["flow_max_g_s"] if flow_max is None else flow_max
        self.flow_max = _within("--flow-max", most, 0.1, 1000, "g/s") * 1e-3
        self.ramp = _ramp(ramp, limits["ramp_min_MPa_min"], limits["ramp_max_MPa_min"])
        self.communication = communication

    def run(self) -> tuple[Fill, RampChoice | None]:
        """The fill, and how its ramp was chosen if it was."""
        from station.plants.real_gas.fill import Dispenser, fill_tank
        from station.plants.real_gas.ramp import choose_ramp, safe_pressure, usual_spread

        self._check_room()
        spread: Spread = usual_spread(
            self.kind.volume, self.start.pressure, self.start.ambient, self.delivery, self.cooldown
        )
        soak = self.start.temperature - self.start.ambient
        spread = spread._replace(soak=(spread.soak[0] + soak, spread.soak[1] + soak))
        choice = None
        if self.ramp is None:
            choice = choose_ramp(self.kind, spread, self.target if self.communication else 1.0, self.flow_max)
        ramp = choice.ramp if choice else self.ramp or 0.0
        pressure = None if self.communication else safe_pressure(self.kind, spread, ramp, self.flow_max)
        dispenser = Dispenser(ramp, self.flow_max, self.delivery, self.cooldown)
        return fill_tank(self.kind, self.start, dispenser, self.target, pressure), choice

    def _check_room(self) -> None:
        """Raise InputError where the tank is as full before the fill as it shall be after it."""
        from station.plants.real_gas.leachman import density

        held = float(density(self.start.pressure, self.start.temperature)) * self.kind.volume / self.kind.full_mass
        if held >= self.target:
            raise InputError("fill", [("--from", (
                f"must leave the tank below --target {100 * self.target:g} %; at {self.start.pressure / _BAR:g} bar it "
                f"holds {100 * held:.1f} %"
            ))])  # fmt: skip


def _within(name: str, given: float, low: float, high: float, unit: str) -> float:
    """The number; InputError unless it is one between two limits."""
    if not (math.isfinite(given) and low <= given <= high):
        raise InputError("fill", [(name, f"must lie between {low:g} and {high:g} {unit}; given {given:g}")])
    return float(given)


def _ramp(given: str, low: float, high: float) -> float | None:
    """A ramp [Pa/s]; None for one that is to be chosen."""
    if given == "auto":
        return None
    try:
        value = float(given)
    except ValueError:
        raise InputError("fill", [("--ramp", f"must be auto or a number of MPa/min; given {given!r:.100}")]) from None
    return _within("--ramp", value, low, high, "MPa/min") * _PER_MINUTE


def _ending(found: Fill) -> str:
    """What ended a fill, in words with its figure."""
    from station.geometry import KELVIN
    from station.plants.real_gas.catalog import TEMPERATURE_LIMIT
    from station.plants.real_gas.fill import End

    last = f"{found.pressure[-1] / _BAR:.0f} bar"
    return {
        End.TIME: f"time: nothing else ended it within {found.time[-1]:.0f} s",
        End.STATE_OF_CHARGE: f"state of charge: {100 * found.state_of_charge[-1]:.1f} % as wanted",
        End.PRESSURE: f"pressure: {last}, 1.25 times the nominal working pressure",
        End.TEMPERATURE: f"temperature: the gas would pass {TEMPERATURE_LIMIT - KELVIN:g} degC",
        End.FULL: f"pressure: at {last} the coldest tank would be full (no communication)",
    }[found.end]


def _print(found: Fill, choice: RampChoice | None, start: FillStart) -> None:
    """A table of some moments of the fill, what ended it and what it came to."""
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table

    from station.geometry import KELVIN

    console = Console()
    console.width = max(console.width, 100)
    about = f"{found.kind.name} at {found.kind.nominal / _BAR:.0f} bar, from {start.pressure / _BAR:.4g} bar"
    table = Table(
        box=SIMPLE_HEAD, padding=(0, 1), title=f"{about}, air {start.ambient - KELVIN:.4g} degC", title_justify="left"
    )
    for heading in ("time [s]", "pressure [bar]", "gas [degC]", "wall inside [degC]", "flow [g/s]", "SoC [%]"):
        table.add_column(heading, justify="right", no_wrap=True)
    last = len(found.time) - 1
    for place in sorted({*range(0, last, max(1, last // _ROWS)), last}):
        table.add_row(
            f"{found.time[place]:.0f}", f"{found.pressure[place] / _BAR:.1f}",
            f"{found.temperature[place] - KELVIN:.1f}", f"{found.surface[place] - KELVIN:.1f}",
            f"{found.flow[place] * 1e3:.1f}", f"{100 * found.state_of_charge[place]:.1f}",
        )  # fmt: skip
    console.print(table)
    given, ramp = found.mass[-1] - found.mass[0], found.dispenser.ramp / _PER_MINUTE
    lines = [_why(choice)] if choice else []
    lines.append(f"ended by {_ending(found)}")
    lines.append(
        f"{given:.3f} kg in {found.time[-1]:.0f} s at {ramp:.1f} MPa/min, gas at most "
        f"{found.temperature.max() - KELVIN:.1f} degC"
    )
    if held := _at_nozzle_limit(found):
        lines.append(f"the nozzle's limit of {found.dispenser.flow_max * 1e3:g} g/s held it back for {held:.0f} s")
    console.print("\n".join(lines), highlight=False, soft_wrap=True)


def _at_nozzle_limit(found: Fill) -> float:
    """For how long the nozzle let no more through [s]."""
    return float((found.flow >= found.dispenser.flow_max * (1 - 1e-9)).sum() * (found.time[1] - found.time[0]))


def _why(choice: RampChoice) -> str:
    """Why the ramp is not larger."""
    from station.geometry import KELVIN

    worst = choice.corner
    tank = (
        f"the worst tank ({worst.volume * 1e3:.4g} L from {worst.pressure / _BAR:.4g} bar, air "
        f"{worst.ambient - KELVIN:.4g} degC, tank {worst.soak:+.4g} K, gas {worst.delivery - KELVIN:.4g} degC after "
        f"{worst.cooldown:g} s) reaches {choice.peak - KELVIN:.1f} degC"
    )
    limit = "" if choice.is_bound else "; the dispenser has no steeper one"
    return f"ramp {choice.ramp / _PER_MINUTE:.1f} MPa/min: {tank}{limit}"


def _document(found: Fill, choice: RampChoice | None, start: FillStart) -> dict[str, Any]:
    """The fill as JSON holds it: units in the names."""
    from station.geometry import KELVIN

    series = {
        "time_s": found.time, "pressure_bar": found.pressure / _BAR, "gas_temperature_c": found.temperature - KELVIN,
        "wall_inside_temperature_c": found.surface - KELVIN, "wall_outside_temperature_c": found.outer - KELVIN,
        "flow_g_per_s": found.flow * 1e3, "mass_kg": found.mass,
        "state_of_charge_percent": 100 * found.state_of_charge,
    }  # fmt: skip
    corner = None if choice is None else {
        "volume_l": choice.corner.volume * 1e3, "start_pressure_bar": choice.corner.pressure / _BAR,
        "ambient_c": choice.corner.ambient - KELVIN, "soak_k": choice.corner.soak,
        "delivery_c": choice.corner.delivery - KELVIN, "cooldown_s": choice.corner.cooldown,
        "peak_gas_temperature_c": choice.peak - KELVIN, "binds": choice.is_bound,
    }  # fmt: skip
    return {
        "tank": found.kind.name,
        "nominal_working_pressure_bar": found.kind.nominal / _BAR,
        "ambient_c": start.ambient - KELVIN,
        "ramp_mpa_per_min": found.dispenser.ramp / _PER_MINUTE,
        "worst_tank": corner,
        "ended_by": found.end.name.lower(),
        "duration_s": float(found.time[-1]),
        "nozzle_limited_s": _at_nozzle_limit(found),
        "delivered_kg": float(found.mass[-1] - found.mass[0]),
        "peak_gas_temperature_c": float(found.temperature.max() - KELVIN),
        "end": {name: float(values[-1]) for name, values in series.items() if name != "flow_g_per_s"},
        "series": {name: values.tolist() for name, values in series.items()},
    }


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(fill)
