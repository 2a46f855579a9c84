"""The mathematics: switching languages, stability, gains, reachable sets, and certificates that anyone can check."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from theory import double_clock, gain, observer, reach, stability, synthesis
    from theory.certificate import Certificate
    from theory.double_clock import DoubleClock, Tube
    from theory.errors import IllPosedError, InfeasibleError, NotCertifiedError, SolverError, TheoryError, TooLargeError
    from theory.exact import Refused, Verdict, verify
    from theory.graph import Automaton, Graph, WordList
    from theory.language import (
        ArbitrarySwitching,
        Asynchronous,
        AverageDwellTime,
        DwellTime,
        LabelledGraph,
        Language,
        PersistentDwellTime,
        language_of,
        persistent_around,
    )
    from theory.observer import Observer
    from theory.stability import Along
    from theory.synthesis import Design
    from theory.system import Gains, SwitchedSystem

__all__ = [
    "Along",
    "ArbitrarySwitching",
    "Asynchronous",
    "Automaton",
    "AverageDwellTime",
    "Certificate",
    "Design",
    "DoubleClock",
    "DwellTime",
    "Gains",
    "Graph",
    "IllPosedError",
    "InfeasibleError",
    "LabelledGraph",
    "Language",
    "NotCertifiedError",
    "Observer",
    "PersistentDwellTime",
    "Refused",
    "SolverError",
    "SwitchedSystem",
    "TheoryError",
    "TooLargeError",
    "Tube",
    "Verdict",
    "WordList",
    "double_clock",
    "gain",
    "language_of",
    "observer",
    "persistent_around",
    "reach",
    "stability",
    "synthesis",
    "verify",
]

_MODULES = ("double_clock", "gain", "observer", "reach", "stability", "synthesis")

_PLACES = {
    "theory.certificate": ("Certificate",),
    "theory.double_clock": ("DoubleClock", "Tube"),
    "theory.errors": (
        "IllPosedError",
        "InfeasibleError",
        "NotCertifiedError",
        "SolverError",
        "TheoryError",
        "TooLargeError",
    ),
    "theory.exact": ("Refused", "Verdict", "verify"),
    "theory.graph": ("Automaton", "Graph", "WordList"),
    "theory.language": (
        "ArbitrarySwitching",
        "Asynchronous",
        "AverageDwellTime",
        "DwellTime",
        "LabelledGraph",
        "Language",
        "PersistentDwellTime",
        "language_of",
        "persistent_around",
    ),
    "theory.observer": ("Observer",),
    "theory.stability": ("Along",),
    "theory.synthesis": ("Design",),
    "theory.system": ("Gains", "SwitchedSystem"),
}
"""Where each name is made, and imported from when it is first asked for: the checker does not wait for solvers."""

_PLACE_OF = {name: place for place, names in _PLACES.items() for name in names}


def __getattr__(name: str) -> Any:
    """A name of this room, from the module that makes it."""
    if name in _MODULES:
        return import_module(f"theory.{name}")
    if name not in _PLACE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = globals()[name] = getattr(import_module(_PLACE_OF[name]), name)
    return found
