"""The commands `follow` and `calibrate`: a measured record against the model of a station."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from station.estimation.calibration import Estimate
    from station.estimation.detection import Event
    from station.estimation.verdict import Fit
    from station.measurement import Frames, Samples, TagMap
    from station.parameters import Station

RecordArgument = Annotated[Path, typer.Argument(metavar="RECORD", help="measured seconds, .csv or .parquet")]
TagsOption = Annotated[
    Path, typer.Option("--tags", metavar="FILE.toml", help="which column is which sensor, and in what unit")
]
StationGiven = Annotated[
    str, typer.Option("--station", metavar="PRESET|FILE", help="the station as it is known: a preset, or a file of one")
]
JsonOption = Annotated[
    Path | None, typer.Option("--json", metavar="FILE", help="write verdict, channels, parameters and events as JSON")
]

REFUSED = 3
"""Exit status where the model is refused."""


def follow(
    record: RecordArgument,
    tags: TagsOption,
    station: StationGiven,
    json_file: JsonOption = None,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE.png", help="draw measured against model (.png, .svg or .pdf)")
    ] = None,
    truth: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="score the events against the faults of a scenario, or of a record (.parquet)"
        ),
    ] = None,
) -> None:
    """Follow a record with the model of a station, and print how it fits and what is wrong.

    Exit status 3 where the model does not fit: then no leak or weakness is told, and the station must be calibrated.
    """
    from api.files import check_writable
    from station.estimation.detection import detect
    from station.estimation.filter import follow as run
    from station.estimation.score import load_truth, score
    from station.estimation.verdict import fits_of, reasons, without_events

    if json_file:
        check_writable(json_file)
    if plot:
        from api.runs.plot import check_format

        check_writable(plot)
        check_format(plot)
    faults = None if truth is None else load_truth(truth)
    frames, known, skewed = _read(record, tags, station)
    followed = run(frames, known)
    found = detect(frames, followed)
    fits = fits_of(without_events(followed, frames.start, found))
    ailing = {name for event in found for name in fits if event.name.endswith(f"_{name}")}
    # robust innovations are quieter than a calibrated model's: what is too quiet says nothing against this one
    why = reasons({name: fit for name, fit in fits.items() if name not in ailing}, quiet=True)
    # what a model that does not fit takes for a leak is none; a frozen reading is one whatever the model
    events = [*skewed, *(event for event in found if not why or event.name.startswith("frozen_"))]
    verdict = "refused" if why else "events" if events else "fits"
    _print_fits(fits)
    _print_events(events)
    scored = None if faults is None else score(events, faults)
    if scored:
        _print_score(scored)
    _end(verdict, why, fits, {}, events, json_file, scored)
    if plot:
        from api.cli.follow_plot import plot_followed

        plot_followed(frames, followed, plot)
    if why:
        raise typer.Exit(REFUSED)


def calibrate(
    record: RecordArgument,
    tags: TagsOption,
    station: StationGiven,
    out: Annotated[Path, typer.Option(metavar="FILE.toml", help="write the calibrated station, if it is accepted")],
    json_file: JsonOption = None,
) -> None:
    """Find a station's parameters from a record, with 95 % intervals, and judge them by its last quarter.

    Exit status 3 and no station where the model is refused.
    """
    from api.cli.console import progress_bar
    from api.cli.toml_text import toml_text
    from api.files import check_ending, check_writable, write_whole
    from station.estimation.calibration import calibrate as find

    check_ending(out, (".toml",))
    if json_file:
        check_writable(json_file)
    frames, known, skewed = _read(record, tags, station)
    with progress_bar("calibrating") as progress:
        found = find(frames, known, progress)
    why = found.refused
    _print_parameters(found.parameters)
    _print_fits(found.fits)
    _print_events(skewed)
    _end("refused" if why else "accepted", why, found.fits, found.parameters, skewed, json_file)
    if why or found.station is None:
        raise typer.Exit(REFUSED)
    made = found.station.model_dump(mode="json", exclude_none=True)
    digest = hashlib.sha256(record.read_bytes()).hexdigest()
    made["name"] = f"{known.name[:52]}-calibrated"
    made["source"] = (
        f"{known.source} Calibrated by `hrs calibrate` from {len(frames)} s of {record.name} (sha256 {digest[:16]}); "
        f"not excited and left as they were: "
        f"{', '.join(name for name, each in found.parameters.items() if not each.known) or 'none'}."
    ).strip()
    write_whole(out, toml_text(made))
    typer.echo(f"{out} is written")


def _read(record: Path, tags: Path, station: str) -> tuple[Frames, Station, list[Event]]:
    """The frames of a record with every clock put right, the station, and an event for each clock that was wrong."""
    from api.cli.console import progress_bar
    from station.estimation.clock import skew_of
    from station.estimation.detection import Event
    from station.estimation.filter import refuse_unfollowed
    from station.measurement import frames_of, load_tags, read_table, samples_of
    from station.station_files import load_station_file

    given: TagMap = load_tags(tags)
    known = load_station_file(station)
    refuse_unfollowed(known)
    samples: list[Samples] = samples_of(read_table(record), given, str(record))
    with progress_bar("clocks") as progress:
        skew = skew_of(samples, given, known, progress)
    frames = frames_of(samples, skew)
    wrong = [
        Event(f"clock_skew_{source}", frames.start, frames.start, by, "s") for source, by in skew.items() if by != 0
    ]
    return frames, known, wrong


def document_of(
    verdict: str,
    fits: dict[str, Fit],
    parameters: dict[str, Estimate],
    events: list[Event],
    scored: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """What `--json` writes; `score` where there is a truth."""
    document = {
        "verdict": verdict,
        "channels": {
            name: {"innovation_rms": fit.innovation_rms, "block_rms": fit.block_rms} for name, fit in fits.items()
        },
        "parameters": {
            name: {"value": each.value, "low": each.low, "high": each.high, "known": each.known}
            for name, each in parameters.items()
        },
        "events": [
            {
                "name": each.name,
                "begin_s": each.begin_s,
                "found_s": each.found_s,
                "size": each.size,
                "unit": each.unit,
            }
            for each in events
        ],
    }
    return document if scored is None else {**document, "score": scored}


def _end(
    verdict: str,
    why: list[str],
    fits: dict[str, Fit],
    parameters: dict[str, Estimate],
    events: list[Event],
    json_file: Path | None,
    scored: dict[str, Any] | None = None,
) -> None:
    """Say the verdict, and write it."""
    from api.files import write_whole

    if json_file:
        document = document_of(verdict, fits, parameters, events, scored)
        write_whole(json_file, json.dumps(document, indent=1, allow_nan=False) + "\n")
    typer.echo(f"verdict: {verdict}")
    for line in why:
        typer.echo(f"model refused: {line}", err=True)


def _print_fits(fits: dict[str, Fit]) -> None:
    typer.echo(f"{'channel':<22} {'innovation rms':>14} {'in 120 s':>9} {'outliers':>9}")
    for name, fit in fits.items():
        typer.echo(f"{name:<22} {fit.innovation_rms:>14.3f} {fit.block_rms:>9.2f} {100 * fit.outliers:>7.2f} %")


def _print_events(events: list[Event]) -> None:
    for each in events:
        typer.echo(
            f"{each.name}: {each.size:.3g} {each.unit}, began about {each.begin_s:.0f} s, found at {each.found_s:.0f} s"
        )
    if not events:
        typer.echo("nothing is found wrong")


def _print_score(scored: dict[str, Any]) -> None:
    for each in scored["faults"]:
        told = f"{each['name']}, there from {each['begin_s']:.0f} s:"
        if not each["found"]:
            typer.echo(f"{told} missed")
            continue
        delay = "" if each["delay_s"] is None else f" after {each['delay_s']:.0f} s"
        size = "" if each["size_error"] is None else f", size off by {each['size_error']:.2g} {each['unit']}"
        typer.echo(f"{told} found{delay}{size}")
    typer.echo(f"score: {scored['found']} found, {scored['missed']} missed, {scored['false']} false")


def _print_parameters(parameters: dict[str, Estimate]) -> None:
    for name, each in parameters.items():
        told = f"{each.low:.6g} to {each.high:.6g}" if each.known else "not excited: as the file has it"
        typer.echo(f"{name:<44} {each.value:<12.6g} {told}")


def register(app: typer.Typer) -> None:
    """Add the commands."""
    app.command()(follow)
    app.command()(calibrate)
