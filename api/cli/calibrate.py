"""The command `calibrate`: a station's parameters from a record, or from what a service's twin was measured."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from api.cli.follow import (
    REFUSED,
    JsonOption,
    end,
    name_unknown_buffers,
    name_untold_volumes,
    print_events,
    print_fits,
    read_record,
)
from api.cli.options import UrlOption

if TYPE_CHECKING:
    from station import Station
    from station.estimation.calibration import Estimate


def calibrate(
    record: Annotated[
        Path | None, typer.Argument(metavar="[RECORD]", help="measured seconds, .csv or .parquet; or --twin")
    ] = None,
    tags: Annotated[
        Path | None, typer.Option("--tags", metavar="FILE.toml", help="which column is which sensor, and in what unit")
    ] = None,
    station: Annotated[
        str | None,
        typer.Option("--station", metavar="PRESET|FILE", help="the station as it is known: a preset, or a file of one"),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE.toml", help="write the calibrated station, if it is accepted")
    ] = None,
    json_file: JsonOption = None,
    twin: Annotated[
        str | None, typer.Option(metavar="ID", help="a measured twin of a service, whose own seconds it is done from")
    ] = None,
    from_s: Annotated[int | None, typer.Option("--from", min=0, metavar="SECONDS", help="first second of it")] = None,
    to_s: Annotated[
        int | None, typer.Option("--to", min=0, metavar="SECONDS", help="last second of it; default the newest")
    ] = None,
    url: UrlOption = None,
    *,
    use: Annotated[
        bool, typer.Option("--use", help="let the twin follow with the station that is found, if it is accepted")
    ] = False,
) -> None:
    """Find a station's parameters from a record, with 95 % intervals, and judge them by its last quarter.

    Exit status 3 and no station where the model is refused. With --twin it is a job of the service (see `hrs jobs`).
    """
    from api.files import check_ending, check_writable

    if out:
        check_ending(out, (".toml",))
    if json_file:
        check_writable(json_file)
    of_a_record, of_a_twin = {"RECORD": record, "--tags": tags, "--station": station}, {"--from": from_s, "--to": to_s}
    if twin is None:
        _check_given({**of_a_record, "--out": out}, {**of_a_twin, "--url": url, "--use": use or None}, "with RECORD")
        _of_record(Path(str(record)), Path(str(tags)), str(station), Path(str(out)), json_file)
    else:
        _check_given({}, of_a_record, "with --twin")
        _of_twin(twin, {"from_s": from_s, "to_s": to_s}, url, out, json_file, use=use)


def _check_given(wanted: dict[str, Any], unwanted: dict[str, Any], where: str) -> None:
    from station import InputError

    problems = [(name, f"must be given {where}") for name, value in wanted.items() if value is None]
    problems += [(name, f"must be left out {where}") for name, value in unwanted.items() if value is not None]
    if problems:
        raise InputError("calibrate", problems)


def _of_record(record: Path, tags: Path, station: str, out: Path, json_file: Path | None) -> None:
    from api.calibrations.job import calibrated_station
    from api.cli.console import progress_bar
    from station.estimation.calibration import calibrate as find

    frames, known, skewed = read_record(record, tags, station)
    with progress_bar("calibrating") as progress:
        found = find(frames, known, progress)
    why = found.refused
    print_parameters(found.parameters)
    print_fits(found.fits, frames.measured)
    print_events(skewed)
    end("refused" if why else "accepted", why, found.fits, found.parameters, skewed, json_file)
    if why:
        name_untold_volumes(frames, known)
    digest = hashlib.sha256(record.read_bytes()).hexdigest()
    by = f"`hrs calibrate` from {len(frames)} s of {record.name} (sha256 {digest[:16]})"
    made = calibrated_station(found, known, by)
    if made is None:
        raise typer.Exit(REFUSED)
    name_unknown_buffers(made)
    _write(out, made)


def _of_twin(
    twin: str, stretch: dict[str, int | None], url: str | None, out: Path | None, json_file: Path | None, *, use: bool
) -> None:
    from urllib.parse import quote

    from api.cli.console import progress_bar
    from api.client import Client
    from api.settings import load_settings
    from station import Station

    given = {name: second for name, second in stretch.items() if second is not None}
    with Client(load_settings(url=url)) as client:
        job = client.post("/v1/calibrations", {"twin": twin, **given})
        typer.echo(f"{job['id']}: seconds {job['from_s']} to {job['to_s']} of twin {twin}")
        with progress_bar("calibrating") as progress:
            path = f"/v1/calibrations/{job['id']}"
            ended = client.wait(path, lambda now: progress(round(100 * now["progress"]), 100))
        result = show_calibration(ended, json_file)
        if result["station"] is None:
            raise typer.Exit(REFUSED)
        made = Station.model_validate(result["station"])
        name_unknown_buffers(made)
        if out:
            _write(out, made)
        if use:
            state = client.post(f"/v1/twins/{quote(twin, safe='')}/station", {"calibration": job["id"]})
            typer.echo(f"twin {twin} follows with station {state['station']} from now on")


def show_calibration(job: dict[str, Any], json_file: Path | None = None) -> dict[str, Any]:
    """Print a calibration of a service that has ended, and give its result; exit status 1 where it has none."""
    from station.estimation.calibration import Estimate
    from station.estimation.verdict import Fit

    if job["result"] is None:
        problem = job["problem"] or {}
        typer.echo(f"{job['state']}: {problem.get('title', '')}: {problem.get('detail', '')}".rstrip(": "), err=True)
        raise typer.Exit(1)
    result: dict[str, Any] = job["result"]
    parameters = {name: Estimate(**each) for name, each in result["parameters"].items()}
    fits = {name: Fit(**each) for name, each in result["channels"].items()}
    print_parameters(parameters)
    print_fits(fits)
    end(result["verdict"], result["refused"], fits, parameters, [], json_file)
    return result


def _write(out: Path, station: Station) -> None:
    from api.cli.toml_text import toml_text
    from api.files import write_whole

    write_whole(out, toml_text(station.model_dump(mode="json", exclude_none=True)))
    typer.echo(f"{out} is written")


def print_parameters(parameters: dict[str, Estimate]) -> None:
    """Print parameters with their intervals, a line each."""
    for name, each in parameters.items():
        told = f"{each.low:.6g} to {each.high:.6g}" + ("" if each.known else ", not known")
        typer.echo(f"{name:<44} {each.value:<12.6g} {told}")


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(calibrate)
