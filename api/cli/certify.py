"""Commands that prove: certify a claim about a switched system or a controller's service, verify a certificate."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from api.jobs.check import SERVICE_FORMAT

if TYPE_CHECKING:
    from api.certificates.questions import Answer

DOCUMENT_BYTES_MAX = 200_000_000
"""Largest certificate that is read; some 2 million inequalities of size 2."""

PARSED = 18
"""Bytes of memory that a byte of JSON takes once read, at most: short lists of small numbers."""

MB = 1_000_000

DEFAULT_STATION = "thesis-fit"
"""As `station.preset_files.DEFAULT_PRESET`, which takes half a second to import."""


def certify(
    problem: Annotated[
        Path | None, typer.Argument(metavar="[PROBLEM]", help="a .toml or .json file; docs/theory.md shows some")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="write the certificate (or the counterproof)")
    ] = None,
    ask: Annotated[str | None, typer.Option(help="ask this instead of what the file asks")] = None,
    lift: Annotated[int | None, typer.Option(min=0, max=60, help="letters looked ahead, or words together")] = None,
    gap: Annotated[
        float | None, typer.Option(metavar="PART", help="without a lift: how near the bounds of a rate or gain must be")
    ] = None,
    budget: Annotated[
        float | None, typer.Option(metavar="S", help="without a lift: time in which larger ones are tried (default 10)")
    ] = None,
    controller: Annotated[
        str | None, typer.Option(metavar="NAME[:option=value]", help="certify this controller's service instead")
    ] = None,
    station: Annotated[
        str, typer.Option(metavar="PRESET", help="with --controller: a preset, or a .toml or .json file of a station")
    ] = DEFAULT_STATION,
    volume: Annotated[
        str | None, typer.Option(metavar="M3:M3", help="with --controller: for tanks of these volumes, as 0.1:0.25")
    ] = None,
    start_spread: Annotated[
        float | None,
        typer.Option(metavar="BAR", help="with --controller: for start pressures so far to either side of the usual"),
    ] = None,
    spacing: Annotated[
        int | None, typer.Option(metavar="S", help="with --controller: for arrivals at least so far apart")
    ] = None,
    within: Annotated[
        int | None, typer.Option(metavar="S", help="with --controller: finished so soon after connection")
    ] = None,
    burst: Annotated[
        int | None,
        typer.Option(metavar="N", help="with --controller: for up to so many vehicles at once, --spacing on the mean"),
    ] = None,
    *,
    as_json: Annotated[bool, typer.Option("--json", help="print the whole answer as JSON")] = False,
) -> None:
    """Certify a claim about a switched system, or the service of a controller. Status 1: not certified.

    A problem is a claim for every admissible signal; --controller asks whether a controller finishes every vehicle.
    """
    if (problem is None) == (controller is None):
        raise typer.BadParameter("give either PROBLEM or --controller")
    if controller is not None:
        times = {"spacing": spacing, "within": within}
        vehicles = {"volume": _range(volume), "start_spread": start_spread, "burst": 1 if burst is None else burst}
        _certify_service(controller, station, out, {**vehicles, **times}, as_json=as_json)
        return
    if any(given is not None for given in (volume, start_spread, spacing, within, burst)):
        raise typer.BadParameter("--volume, --start-spread, --spacing, --within and --burst need --controller")
    changes = {"ask": ask, "lift": lift, "gap": gap, "budget": budget}
    _certify_problem(cast("Path", problem), out, changes, as_json=as_json)


def _certify_problem(problem: Path, out: Path | None, asked: dict[str, Any], *, as_json: bool) -> None:
    """Certify what a problem file asks."""
    from api.certificates import service
    from api.cli.console import status_line
    from api.files import check_writable, write_whole

    if out:
        check_writable(out)
    question = service.read_question(problem)
    changes = {name: value for name, value in asked.items() if value is not None}
    if changes:
        question = service.question_of({**question.model_dump(mode="json", exclude_none=True), **changes}, str(problem))
    with status_line(f"{question.ask.value} of {problem.name}") as progress:
        answer = service.answer(question, progress)
    if out and answer.document:
        write_whole(out, json.dumps(answer.document) + "\n")
    typer.echo(answer.model_dump_json(indent=1) if as_json else "\n".join(told(answer)))
    if out and answer.document and not as_json:
        typer.echo(
            f"written       {out}{'' if answer.certified else ' (the counterproof)'}; check it: hrs verify {out}"
        )
    if not answer.certified:
        raise typer.Exit(1)


def _range(given: str | None) -> tuple[float, float] | None:
    """Two numbers, as in 0.1:0.25."""
    if given is None:
        return None
    try:
        low, high = map(float, given.split(":"))
    except ValueError:
        raise typer.BadParameter(f"--volume must be two numbers like 0.1:0.25; given {given!r}") from None
    return low, high


def _certify_service(controller: str, station: str, out: Path | None, asked: dict[str, Any], *, as_json: bool) -> None:
    """Certify the service of a controller at a station."""
    from api.cli.console import status_line
    from api.files import check_writable, write_whole
    from controllers.certified.claim import Asked
    from controllers.certified.service import CERTIFIED, certify
    from station.station_files import load_station_file

    if out:
        check_writable(out)
    at = load_station_file(station)
    with status_line(f"service of {controller} at {at.name}") as progress:
        document = certify(controller, at, Asked(**asked), progress=progress)
    text = json.dumps(document) + "\n"
    if out:
        write_whole(out, text)
    typer.echo(text if as_json else "\n".join(format_service(document)), nl=not as_json)
    if out and not as_json:
        typer.echo(f"written       {out}; check it: hrs verify {out}")
    if document["verdict"] != CERTIFIED:
        raise typer.Exit(1)


def format_service(document: dict[str, Any]) -> Iterator[str]:
    """A certificate of service, a line a figure."""
    seen, tested, proof, found = (document[name] for name in ("seen", "tested", "proof", "counterexample"))
    yield f"{document['verdict']}: {document['claim']}"
    mean, longest = seen["mean_fill_s"], seen["worst_fill_s"]
    yield f"seen          {seen['fills']} fills in S1-S4, mean {mean:.0f} s, longest {longest:.0f} s"
    box = document["box"]
    for place, buffer in enumerate(("high", "medium", "low")):
        yield (
            f"box {buffer:9} {box['pressure_low_bar'][place]:.0f}-{box['pressure_high_bar'][place]:.0f} bar, "
            f"{box['temperature_low_c'][place]:.1f} to {box['temperature_high_c'][place]:.1f} degC"
        )
    gas = document["gas_at_most"]
    yield f"gas           no vehicle takes more than {gas['vehicle_kg']:.2f} kg, all {gas['hour_kg']:.1f} kg in an hour"
    if proof is not None:
        cells = f"{proof['cells']} cells" if proof["complete"] else f"not the box: {proof['open']}"
        fills = "" if proof["longest_fill_s"] is None else f", no fill there longer than {proof['longest_fill_s']} s"
        yield f"proved        {cells}{fills}"
    single = document["burst"] == 1
    if found is None:
        yield (
            f"tested        {tested['simulations']} runs from the box with {tested['vehicles']} vehicles, longest "
            f"{'fill' if single else 'stay'} {tested['worst_fill_s']:.0f} s"
        )
        return
    there = "connected" if single else "there"
    lasts = "never finished" if found["fill_s"] is None else f"{there} for {found['fill_s']:.0f} s"
    begins = ", ".join(f"{pressure:.0f}" for pressure in found["state"][:3])
    yield f"counterproof  a vehicle is {lasts}: buffers begin at {begins} bar"


def told(answer: Answer) -> Iterator[str]:
    """An answer, a line a figure."""
    yield f"{'certified' if answer.certified else 'NOT certified'}: {answer.claim}"
    if answer.tau is not None:
        yield f"smallest tau  {answer.tau} samples"
    if answer.bound is not None:
        yield f"synthesis     {answer.bound:.7g} before the loop was analysed"
    if answer.value is not None:
        yield f"value         {answer.value:.9g}"
    if answer.at_least is not None and answer.value is not None:
        yield f"at least      {answer.at_least:.9g}, {answer.value / answer.at_least - 1:.1e} below"
    about = (answer.document or {}).get("about", {})
    if "margin" in about:
        yield f"margin        {about['margin']:.3g}, kept by {about['digits']} decimals"
    if "nodes" in about:
        yield f"proof         {about['nodes']} matrices, {about['inequalities']} inequalities"
    if "undecided" in about:
        yield f"undecided     smaller values: {about['undecided']}"
    yield f"time          {answer.seconds:.3g} s"


def verify(
    document: Annotated[Path, typer.Argument(metavar="CERTIFICATE", help="a .json file that `hrs certify` wrote")],
    time_limit: Annotated[
        float, typer.Option(metavar="S", min=0.1, help="of matrices: give up, or do not begin, beyond this time")
    ] = 60.0,
    memory_limit: Annotated[
        int, typer.Option(metavar="MB", min=1, help="of matrices: do not begin where more memory is foreseen")
    ] = 1000,
) -> None:
    """Check a certificate: matrices in rational arithmetic without a solver, service by proving every cell anew.

    Status 0 only if everything in the document holds, a verdict that nothing is proved included.
    """
    from theory import Refused
    from theory import verify as prove

    try:
        content = _content(document, memory_limit)
    except OSError as error:
        raise _unreadable(document, error.strerror or str(error)) from None
    try:
        data = json.loads(content)
    except (ValueError, RecursionError) as error:
        typer.echo(f"refused: not a JSON document: {error}")
        raise typer.Exit(1) from None
    if not isinstance(data, dict):
        typer.echo("refused: not a JSON object")
        raise typer.Exit(1)
    if data.get("format") == SERVICE_FORMAT:
        _verify_service(data)
        return
    from api.cli.console import working

    try:
        with working(f"verifying {document.name}; Ctrl-C gives up"):
            verdict = prove(data, seconds=time_limit, memory_bytes=memory_limit * MB)
    except Refused as error:
        typer.echo(f"refused: {error}")
        raise typer.Exit(1) from None
    typer.echo(f"verified: {verdict.claim}")
    typer.echo(
        f"{verdict.inequalities} inequalities hold exactly; {verdict.states} states prove that every signal is covered"
    )


def _content(document: Path, memory_limit: int) -> bytes:
    """The bytes of a document, unless they would fill too much memory once read."""
    size = document.stat().st_size
    if size > DOCUMENT_BYTES_MAX:
        raise _unreadable(document, f"larger than the limit of {DOCUMENT_BYTES_MAX} bytes")
    if size * PARSED > memory_limit * MB:
        reason = f"not read: an estimated {size * PARSED // MB} MB of memory, --memory-limit is {memory_limit} MB"
        raise _unreadable(document, reason)
    return document.read_bytes()


def _verify_service(document: dict[str, Any]) -> None:
    """Check a certificate of service."""
    from api.cli.console import status_line
    from controllers.certified.service import RefusedError
    from controllers.certified.service import verify as prove

    try:
        with status_line("verifying; Ctrl-C gives up") as progress:
            found = prove(document, progress)
    except RefusedError as error:
        typer.echo(f"refused: {error}")
        raise typer.Exit(1) from None
    typer.echo(f"verified: the verdict is {found['verdict']!r}")
    typer.echo(found["claim"])


def _unreadable(path: Path, reason: str) -> Exception:
    from station import InputError  # half a second that a check does not need

    return InputError(str(path), [("", reason)])


def register(app: typer.Typer) -> None:
    """Add the commands to the command line."""
    app.command()(certify)
    app.command()(verify)
