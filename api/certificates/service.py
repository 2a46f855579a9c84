"""Answer questions about switched systems: what the command line, jobs and tests call."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from api.certificates.questions import Answer, Ask, Decimal, Question
from station import InputError
from station.texts import half_characters
from theory.errors import IllPosedError, NotCertifiedError, TheoryError
from theory.switching import gain, loops, markov, output_feedback, reach, stability, synthesis, varying
from theory.switching.certificate import Certificate
from theory.switching.language import Language, language_of
from theory.switching.representation import Representation
from theory.switching.sampled import SampledSystem
from theory.switching.synthesis import Design
from theory.switching.system import Gains, SwitchedSystem, closed_by
from theory.switching.varying_system import Parameter, VaryingSystem

Progress = Callable[[str], None] | None


def question_of(data: dict[str, Any], source: str) -> Question:
    """A question from a problem file; raises InputError with every wrong field."""
    try:
        return Question.model_validate(data)
    except ValidationError as error:
        raise InputError.of(source, error) from None


def read_question(path: Path) -> Question:
    """A question from a .toml or .json file; decimals stay the decimals written."""
    import json
    import tomllib

    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(str(path), [("", str(error))]) from None
    try:
        read = json.loads if path.suffix == ".json" else tomllib.loads
        data = read(text, parse_float=Decimal)
    except ValueError as error:
        raise InputError(str(path), [("", str(error))]) from None
    if halves := half_characters(text, data):
        raise InputError(str(path), halves)
    if not isinstance(data, dict):
        raise InputError(str(path), [("", "has to be a table of fields")])
    return question_of(data, str(path))


def check(question: Question) -> None:
    """Raise InputError if a question is ill posed or too large, before anything is solved."""
    try:
        system, language = _posed(question, question.constraint.model_dump())
        _varying(question)
        if question.tau_max is None:
            _representation(question).graph(language)
        needs = {
            Ask.GAIN: "CEF",
            Ask.REACH: "E",
            Ask.STABILIZE: "B",
            Ask.MINIMIZE_GAIN: "BCDEF",
            Ask.MINIMIZE_REACH: "BE",
        }
        system.need(needs.get(question.ask, ""), question.ask.value)
        _check_measured(question)
        _check_chain(question)
        if question.ask in {Ask.STABILITY, Ask.DECAY_RATE, Ask.GAIN, Ask.REACH} and question.tau_max is None:
            loops.check_fit(closed_by(system, _gains(question)), language, _gains(question))
    except IllPosedError as error:
        raise InputError("question", [(error.field, error.reason)]) from error
    except TheoryError as error:
        raise InputError("question", [("", str(error))]) from error


def _check_measured(question: Question) -> None:
    """Where feedback has what is measured alone, observers are found for decay and gain, by their own inequalities."""
    measured = any(mode.M is not None for mode in question.modes)
    if measured and question.ask is Ask.MINIMIZE_REACH:
        raise IllPosedError("M", "minimize-reach finds gains of the whole state; leave M out")
    if measured and question.symmetric and question.ask in {Ask.STABILIZE, Ask.MINIMIZE_GAIN}:
        raise IllPosedError("symmetric", "is for gains of the whole state")


def _varying(question: Question) -> VaryingSystem | None:
    """The system with its parameters, which go with some questions alone; None where there are none."""
    if not question.parameters:
        if any(mode.vary for mode in question.modes):
            raise IllPosedError("vary", "is by the value of parameters, and there are none")
        return None
    if (
        question.ask not in {Ask.STABILITY, Ask.DECAY_RATE, Ask.GAIN}
        or (question.tau_max or question.period) is not None
    ):
        raise IllPosedError("parameters", "are for stability, decay-rate and gain, without tau_max and period")
    modes = [mode.model_dump(exclude_none=True) for mode in question.modes]
    return VaryingSystem(modes, [Parameter.of(one.low, one.high, one.rate) for one in question.parameters])


def _certify_varying(question: Question, system: VaryingSystem, language: Language) -> Certificate:
    gains, representation = _gains(question), _representation(question)
    if question.ask is Ask.STABILITY:
        return varying.certify(system, language, rate=question.rate, gains=gains, representation=representation)
    ask = varying.decay_rate if question.ask is Ask.DECAY_RATE else varying.gain
    return ask(system, language, gains=gains, representation=representation, gap=question.gap, budget=question.budget)


def _check_chain(question: Question) -> None:
    """A chain goes with the mean square, and with nothing else that tells which signals there are."""
    if question.ask is not Ask.MEAN_SQUARE:
        if question.chain is not None:
            raise IllPosedError("chain", "is for the mean square alone")
        return
    markov.exact_chain(question.chain, len(question.modes))
    if question.constraint.kind != "arbitrary" or question.gains or question.tau_max is not None:
        raise IllPosedError("constraint", "is arbitrary where modes jump by a chain, without gains and tau_max")


def answer(question: Question, progress: Progress = None) -> Answer:
    """The answer: a certificate, or the reason why there is none with a counterproof where one was found.

    Raises
    ------
    InputError
        The question is ill posed or too large.
    theory.errors.SolverError
        The solver failed; nothing is claimed.
    """
    started = time.perf_counter()
    constraint = question.constraint.model_dump()
    tau: int | None = None
    try:
        _check_chain(question)
        _check_measured(question)
        if question.tau_max is None:
            found = _solve(question, constraint, progress)
        else:
            tau, found = _smallest(question, constraint, progress)
    except IllPosedError as error:
        raise InputError("question", [(error.field, error.reason)]) from error
    except NotCertifiedError as error:
        proof = error.counterexample
        document = dict(proof.document) if isinstance(proof, Certificate) else None
        return Answer(certified=False, claim=str(error), seconds=_since(started), document=document)
    certificate = found.certificate if isinstance(found, Design) else found
    return Answer(
        certified=True, claim=certificate.verdict.claim, value=certificate.value, tau=tau, seconds=_since(started),
        at_least=certificate.at_least, bound=found.bound if isinstance(found, Design) else None,
        document=dict(certificate.document),
    )  # fmt: skip


def _smallest(question: Question, constraint: dict[str, Any], progress: Progress) -> tuple[int, Certificate | Design]:
    if "tau" not in constraint or constraint["kind"] == "average":
        raise IllPosedError("tau_max", f"a constraint of kind {constraint['kind']!r} has no whole tau to search")
    designs: dict[int, Certificate | Design] = {}

    def ask(tau: int) -> Certificate:
        if progress:
            progress(f"tau = {tau}")
        found = designs[tau] = _solve(question, {**constraint, "tau": tau}, progress)
        return found.certificate if isinstance(found, Design) else found

    low = constraint.get("delay", 0) + 1
    if question.tau_max is not None and question.tau_max < low:
        raise IllPosedError("tau_max", f"{question.tau_max} is below delay + 1 = {low}")
    tau, _ = stability.smallest(ask, low=low, high=question.tau_max or low)
    return tau, designs[tau]


def _solve(question: Question, constraint: dict[str, Any], progress: Progress) -> Certificate | Design:
    system, language = _posed(question, constraint)
    gains, representation, given = _gains(question), _representation(question), question
    if (varied := _varying(given)) is not None:
        return _certify_varying(given, varied, language)
    budget = given.budget if given.tau_max is None else 0.0  # of each tau, the smallest lift
    match given.ask:
        case Ask.STABILITY:
            return stability.certify(
                system, language, rate=given.rate, gains=gains, representation=representation, budget=budget
            )
        case Ask.DECAY_RATE | Ask.GAIN:
            ask = stability.decay_rate if given.ask is Ask.DECAY_RATE else gain.certify
            return ask(
                system, language, gains=gains, representation=representation, gap=given.gap, budget=budget,
                progress=progress,
            )  # fmt: skip
        case Ask.MEAN_SQUARE:
            return markov.decay_rate(system, given.chain, gap=given.gap)
        case Ask.REACH:
            return reach.certify(
                system,
                language,
                peak=given.peak,
                gains=gains,
                alpha=given.alpha,
                representation=representation,
                progress=progress,
            )
        case Ask.STABILIZE | Ask.MINIMIZE_GAIN if system.has("M"):
            find = output_feedback.stabilize if given.ask is Ask.STABILIZE else output_feedback.minimize_gain
            return find(system, language, schedule=given.schedule, representation=representation, progress=progress)
        case Ask.STABILIZE:
            return synthesis.stabilize(
                system,
                language,
                schedule=given.schedule,
                symmetric=given.symmetric,
                representation=representation,
                progress=progress,
            )
        case Ask.MINIMIZE_GAIN:
            return synthesis.minimize_gain(
                system, language, schedule=given.schedule, symmetric=given.symmetric, representation=representation
            )
        case Ask.MINIMIZE_REACH:
            return reach.minimize(
                system, language, peak=given.peak, schedule=given.schedule, symmetric=given.symmetric,
                alpha=given.alpha, representation=representation, progress=progress,
            )  # fmt: skip


def _posed(question: Question, constraint: dict[str, Any]) -> tuple[SwitchedSystem, Language]:
    modes = [mode.model_dump(exclude_none=True, exclude={"vary"}) for mode in question.modes]
    system, language = SwitchedSystem.of_modes(modes), language_of(constraint, len(modes))
    if question.period is not None:
        system = SampledSystem(system, question.period)
    if (
        question.clock is not None
        or question.gains
        or question.ask in {Ask.STABILIZE, Ask.MINIMIZE_GAIN, Ask.MINIMIZE_REACH}
    ):
        language = synthesis.with_clock(language, question.clock)
    return system, language


def _gains(question: Question) -> Gains | None:
    return (
        Gains.of_document([gain.model_dump(exclude_none=True) for gain in question.gains]) if question.gains else None
    )


def _representation(question: Question) -> Representation:
    return Representation(question.representation, question.lift, question.shared)


def _since(started: float) -> float:
    return round(time.perf_counter() - started, 4)
