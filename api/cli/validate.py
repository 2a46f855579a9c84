"""The command `validate`: measured fills and discharges beside the real-gas model."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from station import InputError

if TYPE_CHECKING:
    from station.plants.real_gas.cases import Case, OrificeCase
    from station.plants.real_gas.comparison import Comparison, Difference


def validate(
    cases: Annotated[list[Path], typer.Argument(metavar="CASE.json...", help="measured cases; see docs/validation.md")],
    json_file: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="write the differences of every case as JSON")
    ] = None,
    plot: Annotated[Path | None, typer.Option(metavar="DIR", help="draw each case into this folder")] = None,
) -> None:
    """Run measured cases with the model, and print how far gas temperature and pressure are apart."""
    from api.cli.console import working
    from api.files import check_writable, write_json
    from station.plants.real_gas.comparison import compare_case

    if json_file:
        check_writable(json_file)
    if plot:
        _check_folder(plot)
    read = [(str(path), _read(path)) for path in cases]
    compared: list[tuple[OrificeCase | None, Comparison | None]] = []
    with working("running the model"):
        for source, case in read:
            compared.append((case, None) if case.kind == "orifice" else (None, compare_case(case, source)))
    _print(compared)
    if json_file:
        document = {"cases": [_row(orifice, found) for orifice, found in compared]}
        write_json(json_file, document)
    if plot:
        from api.cli.gas_plots import plot_case

        plot.mkdir(exist_ok=True)
        for path, (_, found) in zip(cases, compared, strict=True):
            if found:
                plot_case(found, plot / f"{path.stem}.png")


def _read(path: Path) -> Case | OrificeCase:
    """A case from its file."""
    from station.files import parse_file
    from station.plants.real_gas.cases import parse_case

    return parse_case(parse_file(path, str(path)), str(path))


def _check_folder(path: Path) -> None:
    """Raise InputError unless pictures can be put into a folder of this name."""
    if path.exists() and not path.is_dir():
        raise InputError("output", [(str(path), "must be a folder")])
    if not path.parent.is_dir():
        raise InputError("output", [(str(path), "must be a folder in one that exists")])


def _row(orifice: OrificeCase | None, found: Comparison | None) -> dict[str, Any]:
    """The differences of a case; null where nothing was measured."""
    gas = found.gas_difference if found else None
    pressure = found.pressure_difference if found else None
    name = orifice.case if orifice else found.case.case if found else ""
    return {
        "case": name,
        "gas_rms_K": gas.rms if gas else None,
        "gas_max_K": gas.largest if gas else None,
        "pressure_rms_bar": pressure.rms if pressure else None,
        "pressure_max_bar": pressure.largest if pressure else None,
    }


def _print(compared: list[tuple[OrificeCase | None, Comparison | None]]) -> None:
    """A table of the differences, and a line for whatever was assumed."""
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table

    table = Table(
        box=SIMPLE_HEAD,
        padding=(0, 1),
        title="Model less measurement: root mean square / largest",
        title_justify="left",
    )
    table.add_column("case", no_wrap=True)
    for heading in ("gas [K]", "pressure [bar]"):
        table.add_column(heading, justify="right", no_wrap=True)
    for orifice, found in compared:
        if found:
            table.add_row(found.case.case, _shown(found.gas_difference), _shown(found.pressure_difference))
        elif orifice:
            table.add_row(orifice.case, "-", "-")
    console = Console()
    console.width = max(console.width, 100)
    console.print(table)
    for orifice, found in compared:
        for line in _orifice_remarks(orifice) if orifice else _remarks(found) if found else ():
            console.print(line, highlight=False, soft_wrap=True)


def _shown(difference: Difference | None) -> str:
    return "-" if difference is None else f"{difference.rms:.2f} / {difference.largest:.2f}"


def _remarks(found: Comparison) -> list[str]:
    """What a reader must know of a comparison."""
    case, lines = found.case, []
    if found.gas and found.gas.name != "gas_mean_temperature_K":
        lines.append(f"compared with the {found.gas.name}")
    if found.gas is None:
        lines.append("no temperature of the gas was measured")
    others = [name for name in case.measured if name != "pressure_MPa" and not name.endswith("_temperature_K")]
    if others:
        lines.append(f"not compared: {', '.join(others)}; what is are pressure_MPa and gas_*_temperature_K")
    if found.area is not None:
        lines.append(f"the area of the orifice was not published: {found.area * 1e6:.4g} mm2 meets the pressure best")
    if case.compare_until_s:
        lines.append(f"compared up to {case.compare_until_s:g} s")
    if case.boundary.mass_flow_factor != 1.0:
        lines.append(f"measured flow times {case.boundary.mass_flow_factor:g}, as the case says")
    return [f"{case.case}: {line}" for line in lines]


def _orifice_remarks(case: OrificeCase) -> list[str]:
    """The discharge coefficients that a case of choked flow implies: it has no tank to compare."""
    from station.plants.real_gas.comparison import implied_coefficients

    found = implied_coefficients(case)
    return [f"{case.case}: no tank; its flows imply discharge coefficients from {found.min():.2f} to {found.max():.2f}"]


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(validate)
