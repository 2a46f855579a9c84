"""Commands of the mathematics: certify a claim about a switched system, verify a certificate."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from api.certificates.schemas import Answer

DOCUMENT_BYTES_MAX = 200_000_000
"""Largest certificate that is read; some 2 million inequalities of size 2."""


def certify(
    problem: Annotated[
        Path, typer.Argument(metavar="PROBLEM", help="a .toml or .json file; docs/theory.md shows some")
    ],
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="write the certificate (or the counterproof)")
    ] = None,
    ask: Annotated[str | None, typer.Option(help="ask this instead of what the file asks")] = None,
    lift: Annotated[int | None, typer.Option(min=0, max=60, help="letters looked ahead, or words together")] = None,
    *,
    as_json: Annotated[bool, typer.Option("--json", help="print the whole answer as JSON")] = False,
) -> None:
    """Certify a claim for every admissible signal of a switched system. Status 1: not certified, nothing is claimed."""
    from api.certificates import service
    from api.console import telling
    from api.files import check_writable, write_whole

    if out:
        check_writable(out)
    question = service.read_question(problem)
    changes = {name: value for name, value in (("ask", ask), ("lift", lift)) if value is not None}
    if changes:
        question = service.question_of({**question.model_dump(mode="json", exclude_none=True), **changes}, str(problem))
    with telling(f"{question.ask.value} of {problem.name}") as progress:
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


def told(answer: Answer) -> Iterator[str]:
    """An answer, a line a figure."""
    yield f"{'certified' if answer.certified else 'NOT certified'}: {answer.claim}"
    if answer.tau is not None:
        yield f"smallest tau  {answer.tau} samples"
    if answer.bound is not None:
        yield f"synthesis     {answer.bound:.7g} before the loop was analysed"
    if answer.value is not None:
        yield f"value         {answer.value:.7g}"
    about = (answer.document or {}).get("about", {})
    if "margin" in about:
        yield f"margin        {about['margin']:.3g}, kept by {about['digits']} decimals"
    if "nodes" in about:
        yield f"proof         {about['nodes']} matrices, {about['inequalities']} inequalities"
    yield f"time          {answer.seconds:.3g} s"


def verify(
    document: Annotated[Path, typer.Argument(metavar="CERTIFICATE", help="a .json file that `hrs certify` wrote")],
) -> None:
    """Check a certificate exactly: rational arithmetic, no solver. Status 0 only if every inequality holds."""
    from theory import Refused
    from theory import verify as prove

    try:
        if document.stat().st_size > DOCUMENT_BYTES_MAX:
            raise _unreadable(document, f"larger than the limit of {DOCUMENT_BYTES_MAX} bytes")
        data = json.loads(document.read_bytes())
    except OSError as error:
        raise _unreadable(document, error.strerror or str(error)) from None
    except (ValueError, RecursionError) as error:
        typer.echo(f"refused: not a JSON document: {error}")
        raise typer.Exit(1) from None
    if not isinstance(data, dict):
        typer.echo("refused: not a JSON object")
        raise typer.Exit(1)
    try:
        verdict = prove(data)
    except Refused as error:
        typer.echo(f"refused: {error}")
        raise typer.Exit(1) from None
    typer.echo(f"verified: {verdict.claim}")
    typer.echo(
        f"{verdict.inequalities} inequalities hold exactly; {verdict.states} states prove that every signal is covered"
    )


def _unreadable(path: Path, reason: str) -> Exception:
    from station import InputError  # half a second that a check does not need

    return InputError(str(path), [("", reason)])


def register(app: typer.Typer) -> None:
    """Add the commands to the command line."""
    app.command()(certify)
    app.command()(verify)
