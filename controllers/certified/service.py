"""Certificates of service: what is claimed of a controller at a station, whether it is proved, and the document."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from controllers.certified.box import OperatingBox, observe_scenarios, widened
from controllers.certified.claim import Asked, Claim, claim_of
from controllers.certified.falsify import Counterexample, Falsifier, Tested, search
from controllers.certified.proof import Grid, States, enclose, recheck
from controllers.certified.reduction import ReducedClaim, reduced_claim
from controllers.slot import create, parse
from station.errors import StationError
from station.margins import certify as certify_margins
from station.parameters import Station
from station.plants.thesis import refuse_others
from station.simulation import liveness_of
from station.starts import may_bar, starts_for
from station.uncertainty import Uncertainty

FORMAT = "hrs-service-certificate"
VERSION = 4

WIDTHS = ("cell_bar", "cell_k", "cell_volume")
"""Where a proof says how wide its cells are."""

SPACE_S = "space_s"
"""The setting of a rule by which fills begin so far apart."""

CERTIFIED, NOT_CERTIFIED, TESTED = "certified", "not certified", "tested"

Progress = Callable[[str], None] | None


class RefusedError(StationError):
    """A document that is no certificate of what it says, with the field that is wrong."""

    def __init__(self, field: str, message: str) -> None:
        self.field, self.reason = field, message
        super().__init__(f"{field}: {message}" if field else message)


def station_hash(station: Station) -> str:
    """SHA-256 over a station's exact parameters and settings."""
    return _hash(station.model_dump(mode="json"))


def certify(
    controller: str, station: Station, asked: Asked | None = None, *, progress: Progress = None,
    given: tuple[States, Grid] | None = None,
) -> dict[str, Any]:  # fmt: skip
    """The certificate of a controller like `minlp1:horizon=2` at a station; its `verdict` says what it is worth.

    `asked`: what is to be claimed; the usual vehicle, where nothing is said. `given`: states and cells of a proof to
    check instead of searching one.

    Raises
    ------
    InputError
        for a controller that is unknown, does not fit the station or cannot be searched, and for vehicles that the
        station cannot fill.
    PlantError
        for a station with another plant than the thesis's.
    """
    refuse_others(station.plant, "certificates of service")
    asked = asked or Asked()
    name, options = parse(controller)
    actor = create(name, **options)
    actor.start(station)
    if progress:
        progress("S1 to S4")
    own = actor.settings_for(station) if hasattr(actor, "settings_for") else None
    space = getattr(own, SPACE_S, 0)
    seen = observe_scenarios(
        station, name, {**options, SPACE_S: 0} if space else options
    )  # fills as they are once they begin
    claim = claim_of(station, seen, asked, space)
    low, high = widened(seen, station)
    bench = Falsifier(station, name, options, claim)
    starved = _starved(bench, seen.starved)
    alone = None if starved is None else Tested(1, 1, np.inf, 0, starved)
    tested = alone or search(bench, low, high, progress=progress)
    proof = None
    subject = reduced_claim(actor, station, claim)
    if tested.counterexample is None and subject is not None:
        proof = _proof(subject, station, seen, claim, given, progress, liveness_of(actor, station))
    settings = {} if own is None else own.model_dump(mode="json")
    of = {"name": name, "options": options, "settings": settings}
    return _document(of, station, seen, claim, asked, _box(low, high), tested, proof)


def _proof(
    subject: ReducedClaim, station: Station, seen: OperatingBox, claim: Claim, given: tuple[States, Grid] | None,
    progress: Progress, liveness: float,
) -> dict[str, Any]:  # fmt: skip
    """The proof as the document holds it; an open one where the guard's promise would not make the claim true."""
    rule, ready = subject.rule, subject.ready
    if given is None:
        found = enclose(rule, station, seen, claim, progress, ready=ready)
    else:
        found = recheck(rule, station, seen, claim, *given, progress, ready=ready)
    if subject.flaw:
        found = replace(found, open=subject.flaw)
    elif found.complete and subject.longest(found) >= liveness:
        found = replace(
            found, open=f"logic stands in after {liveness:g} s, and a fill could last {subject.longest(found):g} s"
        )
    elif found.complete and subject.driest(found, claim, station) >= station.slot.incomplete_s:
        driest, ends = subject.driest(found, claim, station), station.slot.incomplete_s
        found = replace(
            found, open=f"a fill ends incomplete after {ends:g} s without gas, and {driest:g} s could pass so"
        )
    elif found.complete and _may_bar(station, claim):
        found = replace(found, open="the slot may keep an inlet closed, so that a buffer can begin the next fill")
    guard = subject.as_document()
    return found.as_document() if guard is None else {**found.as_document(), "guard": guard}


def _may_bar(station: Station, claim: Claim) -> bool:
    """Whether the slot may keep an inlet closed for the emptiest of the vehicles that are promised."""
    plant = station.constants()
    starts = starts_for(station.emptiest(claim.vehicles.starts[0]), plant, plant.ambient_temperature)
    return may_bar(starts, plant)


def _starved(bench: Falsifier, starved: Any) -> Counterexample | None:
    """The first vehicle of S1-S4 that starves, replayed alone."""
    for item in starved:
        found = bench.confirmed(np.array(item.state), ((0.0, bench.usual),))
        if found is not None:
            return found
    return None


def _box(low: np.ndarray, high: np.ndarray) -> dict[str, list[float]]:
    """The box of a claim as JSON holds it: high, medium, low."""
    return {
        "pressure_low_bar": low[:3].tolist(), "pressure_high_bar": high[:3].tolist(),
        "temperature_low_c": low[3:].tolist(), "temperature_high_c": high[3:].tolist(),
    }  # fmt: skip


def _document(
    controller: dict[str, Any],
    station: Station,
    seen: OperatingBox,
    claim: Claim,
    asked: Asked,
    box: dict[str, list[float]],
    tested: Tested,
    proof: dict[str, Any] | None,
) -> dict[str, Any]:
    verdict = TESTED
    if tested.counterexample is not None or seen.starved:
        verdict = NOT_CERTIFIED
    elif proof is not None and proof["complete"]:
        verdict = CERTIFIED
    found = tested.counterexample
    document = {
        "format": FORMAT, "version": VERSION, "verdict": verdict,
        "claim": _words(verdict, controller["name"], station, claim),
        "controller": controller, "asked": asked.as_document(), "vehicles": claim.vehicles.as_document(),
        "station": {"sha256": station_hash(station), "parameters": station.model_dump(mode="json")},
        "box": box, "spacing_s": claim.spacing, "within_s": claim.within, "burst": claim.burst,
        "promised_s": claim.promised, "gas_at_most": claim.gas(station),
        "seen": seen.as_document(),
        "tested": tested.as_document(), "proof": proof,
        "counterexample": None if found is None else found.as_document(),
        "limits": certify_margins(station, Uncertainty()).as_document(),
    }  # fmt: skip
    plain: dict[str, Any] = json.loads(json.dumps(document))
    return {**plain, "sha256": _hash(plain)}


def _words(verdict: str, name: str, station: Station, claim: Claim) -> str:
    if not claim.spacing:
        return f"{name} at {station.name} serves nobody in S1-S4"
    single = claim.burst == 1
    arrivals = f"{'' if single else f'in bursts of up to {claim.burst}, '}at least {claim.spacing} s apart"
    words = (
        f"from every state of the box, with arrivals {arrivals}{'' if single else ' on the mean'}, {name} at "
        f"{station.name} finishes every {claim.vehicles.in_words()} within {claim.promised} s of its "
        f"{'connection' if single else 'arrival'}"
    )
    if verdict == CERTIFIED:
        return words
    return f"{'false' if verdict == NOT_CERTIFIED else 'not proved, only tested'}: {words}"


def _hash(document: Any) -> str:
    return hashlib.sha256(json.dumps(document, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def controller_of(document: dict[str, Any]) -> str:
    """Name and options of a document's controller, as `parse` reads them."""
    given = document["controller"]
    return ":".join([given["name"], *(f"{key}={json.dumps(value)}" for key, value in given["options"].items())])


def verify(document: dict[str, Any], progress: Progress = None) -> dict[str, Any]:
    """Check a document: everything in it is computed anew from its controller and its station, and must come out equal.

    That the states of a proof hold the box is checked, and each of their cells is proved again; a counterexample is
    replayed, and a search without either repeated.

    Raises
    ------
    RefusedError
        naming the first field that is not what it must be.
    """
    if document.get("format") != FORMAT:
        raise RefusedError("format", f"must be {FORMAT!r}; given {document.get('format')!r}")
    if document.get("version") != VERSION:
        message = f"must be {VERSION}, documents before that are to be made anew; given {document.get('version')!r}"
        raise RefusedError("version", message)
    try:
        station = Station.model_validate(document["station"]["parameters"])
        controller = controller_of(document)
        given = None
        if document["proof"] is not None and document["proof"]["complete"]:
            proof = document["proof"]
            given = States.of_document(proof["states"]), Grid(*(float(proof[width]) for width in WIDTHS))
        asked = Asked.of_document(document["asked"])
        expected = certify(controller, station, asked, progress=progress, given=given)
    except (LookupError, TypeError, ValueError, AttributeError, ArithmeticError, RecursionError) as error:
        raise RefusedError("", f"is not what a certificate holds: {error}") from None
    difference = _difference(document, expected, "")
    if difference is not None:
        raise RefusedError(*difference)
    return expected


def _difference(given: Any, expected: Any, path: str) -> tuple[str, str] | None:
    """The first field in which two documents differ, and how."""
    if isinstance(expected, dict) and isinstance(given, dict):
        for key in sorted({*given, *expected}, key=lambda name: (name == "sha256", name)):
            below = f"{path}.{key}".lstrip(".")
            if key not in given or key not in expected:
                return below, "is missing" if key not in given else "is not a field of a certificate"
            found = _difference(given[key], expected[key], below)
            if found is not None:
                return found
        return None
    if isinstance(expected, list) and isinstance(given, list) and len(expected) == len(given):
        for place, pair in enumerate(zip(given, expected, strict=True)):
            found = _difference(*pair, f"{path}.{place}")
            if found is not None:
                return found
        return None
    if type(given) is type(expected) and given == expected:
        return None
    return path, f"must be {_short(expected)}; given {_short(given)}"


def _short(value: Any) -> str:
    return f"{len(value)} entries" if isinstance(value, list | dict) else repr(value)


def check_belongs(document: dict[str, Any], controller: str, station: Station, progress: Progress = None) -> None:
    """Raise RefusedError unless a document certifies this controller at this station, and verifies."""
    name, options = parse(controller)
    given = document.get("controller")
    if not isinstance(given, dict) or given.get("name") != name or given.get("options") != options:
        raise RefusedError("controller", f"must be that of the certificate; given {controller!r}")
    of = document.get("station")
    if not isinstance(of, dict) or of.get("sha256") != station_hash(station):
        raise RefusedError("station.sha256", "the certificate belongs to a station with other parameters")
    if document.get("verdict") != CERTIFIED:
        raise RefusedError("verdict", f"must be {CERTIFIED!r}; given {document.get('verdict')!r}")
    verify(document, progress)
