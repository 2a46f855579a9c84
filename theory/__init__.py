"""The mathematics: switching languages, stability, gains, reachable sets, and certificates that anyone can check."""

from theory import double_clock, gain, observer, reach, stability, synthesis
from theory.certificate import Certificate
from theory.double_clock import DoubleClock, Tube
from theory.errors import (
    IllPosedError,
    InfeasibleError,
    NotCertifiedError,
    SolverError,
    TheoryError,
    TooLargeError,
)
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
