"""The command `follow`: a measured record against the model of a station."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from station.sensor_names import ANALOG

if TYPE_CHECKING:
    from station.estimation.calibration import Estimate
    from station.estimation.detection import Event
    from station.estimation.verdict import Fit
    from station.frames import Frames
    from station.measurement import Samples, TagMap
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
    from station.estimation.verdict import coarse_sensors, judged
    from station.measurement import load_tags

    if json_file:
        check_writable(json_file)
    if plot:
        from api.runs.plot import check_format

        check_writable(plot)
        check_format(plot)
    faults = None if truth is None else load_truth(truth)
    frames, known, skewed = read_record(record, tags, station)
    followed = run(frames, known)
    found = detect(frames, followed, known)
    # of a sensor that says nothing there are no innovations; the others speak
    fits, why = judged(followed, frames.start, found, coarse_sensors(frames.values, frames.usual_noise))
    # what a model that does not fit takes for a leak is none; a frozen or absent sensor is one whatever the model
    events = [*skewed, *(event for event in found if not why or event.name.startswith(("frozen_", "absent_")))]
    verdict = "refused" if why else "events" if events else "fits"
    print_fits(fits, frames.measured)
    print_events(events)
    scored = None if faults is None else score(events, faults, load_tags(tags), known)
    if scored:
        _print_score(scored)
    end(verdict, why, fits, {}, events, json_file, scored)
    if why:
        name_untold_volumes(frames, known)
    if plot:
        from api.cli.follow_plot import plot_followed

        plot_followed(frames, followed, plot)
    if why:
        raise typer.Exit(REFUSED)


UNTOLD_MAX = 0.3
"""Of the seconds, without a word: so large a part may go by in which nobody told the valves."""


def read_record(record: Path, tags: Path, station: str) -> tuple[Frames, Station, list[Event]]:
    """The frames of a record with every clock put right, the station, and an event for each clock that was wrong.

    What else was found of the tags is told on stderr.
    """
    from api.cli.console import progress_bar
    from station.estimation.detection import Event, untellable
    from station.estimation.filter import model_of
    from station.estimation.slowness import frames_and_skew
    from station.geometry import TANKS
    from station.measurement import load_tags, read_table, samples_of, seem_told_on_change
    from station.station_files import load_station_file

    given: TagMap = load_tags(tags)
    known = load_station_file(station)
    model_of(known)  # refuses a plant that is not followed
    samples: list[Samples] = samples_of(read_table(record), given, str(record))
    if told := seem_told_on_change(samples):
        typer.echo(f"told only when they change? then say on_change = true of the tags {', '.join(told)}", err=True)
    with progress_bar("clocks") as progress:
        frames, skew = frames_and_skew(samples, given, known, progress)
    known_late = {tag.sensor: tag.time_constant_s for tag in given.tags}
    for tank, late in zip(TANKS, frames.time_constants.tolist(), strict=True):
        if late > 0.0 and known_late[f"temperature_{tank}"] is None:
            typer.echo(f"temperature_{tank} follows its gas late: time_constant_s is about {late:g} s", err=True)
    if (untold := 1.0 - frames.valves_told) > UNTOLD_MAX:
        typer.echo(
            f"no valve was told in {untold:.0%} of the seconds: what flowed in them is not known, and a leak or a weak "
            "machine is hardly found",
            err=True,
        )
    if hidden := untellable(frames.measured):
        typer.echo(
            f"no tag tells the pressure of a bank: not told are {', '.join(sorted(hidden))}, which it may cause",
            err=True,
        )
    name_unknown_buffers(known)
    wrong = [
        Event(f"clock_skew_{source}", frames.start, frames.start, by, "s") for source, by in skew.items() if by != 0
    ]
    return frames, known, wrong


def name_unknown_buffers(station: Station) -> None:
    """Say of which buffers nothing is told, since the calibration's day did not tell their volumes."""
    if names := ", ".join(station.unknown_buffers):
        typer.echo(
            f"the day of the calibration did not tell the volume of {names}: no leak of it is told until the station "
            "is calibrated from a day on which it gives",
            err=True,
        )


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
                "size_deviation": each.size_deviation,
                "begin_low_s": each.begin_low_s,
                "begin_high_s": each.begin_high_s,
            }
            for each in events
        ],
    }
    return document if scored is None else {**document, "score": scored}


def end(
    verdict: str,
    why: list[str],
    fits: dict[str, Fit],
    parameters: dict[str, Estimate],
    events: list[Event],
    json_file: Path | None,
    scored: dict[str, Any] | None = None,
) -> None:
    """Say the verdict, and write it."""
    from api.files import write_json

    if json_file:
        document = document_of(verdict, fits, parameters, events, scored)
        write_json(json_file, document)
    typer.echo(f"verdict: {verdict}")
    for line in why:
        typer.echo(f"model refused: {line}", err=True)


def print_fits(fits: dict[str, Fit], measured: Collection[str] = ()) -> None:
    """Print how each channel fits, a line each; of those that are `measured` too seldom, that they are not judged."""
    from station.estimation.verdict import FEWEST

    typer.echo(f"{'channel':<22} {'innovation rms':>14} {'in 120 s':>9} {'outliers':>9}")
    for name, fit in fits.items():
        typer.echo(f"{name:<22} {fit.innovation_rms:>14.3f} {fit.block_rms:>9.2f} {100 * fit.outliers:>7.2f} %")
    for name in measured:
        if name in ANALOG and name not in fits:
            typer.echo(f"{name:<22} not judged: it has fewer than {FEWEST} readings that a model can foretell")


def name_untold_volumes(frames: Frames, known: Station) -> None:
    """Say where no volume of a vehicle's tank was told, which may be why a model is refused."""
    if not (frames["vehicle_volume"] > 0.0).any():
        typer.echo(
            f"no tag tells vehicle_volume: every tank was taken as the usual one of {known.vehicle.volume_m3:g} m3",
            err=True,
        )


def print_events(events: list[Event]) -> None:
    """Print what was found, a line each, sizes with WIDTH standard deviations."""
    from api.twins.health import WIDTH

    for each in events:
        unsure = "" if each.size_deviation is None else f" ± {WIDTH * each.size_deviation:.2g}"
        size = f"{each.size:.3g}{unsure} {each.unit}"
        if each.name.startswith("stuck_"):
            size = "open" if each.size else "closed"
        known = each.begin_low_s is not None and each.begin_high_s is not None
        between = f" ({each.begin_low_s:.0f} to {each.begin_high_s:.0f} s)" if known else ""
        typer.echo(f"{each.name}: {size}, began about {each.begin_s:.0f} s{between}, found at {each.found_s:.0f} s")
    if not events:
        typer.echo("nothing is found wrong")


def _print_score(scored: dict[str, Any]) -> None:
    for each in scored["faults"]:
        told = f"{each['name']}, there from {each['begin_s']:.0f} s:"
        if not each["found"]:
            typer.echo(f"{told} missed" + (f": {each['untold']}" if each["untold"] else ""))
            continue
        delay = "" if each["delay_s"] is None else f" after {each['delay_s']:.0f} s"
        size = "" if each["size_error"] is None else f", size off by {each['size_error']:.2g} {each['unit']}"
        typer.echo(f"{told} found{delay}{size}")
    typer.echo(f"score: {scored['found']} found, {scored['missed']} missed, {scored['false']} false")


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(follow)
