"""The checker of certificates: rational arithmetic, the standard library, and no trust in the document's words.

It builds the automaton of the constraint's definition (`constraints.py`), proves that the graph covers it, and proves
every inequality (`verification.py`). The folder stands alone: copied elsewhere it works as well.
"""

from .constraints import STEPS_MAX, Label, Refused, covered, explored, rules, spelled
from .verification import FORMAT, VERSION, Verdict, checksum, multiply, prove, schur_stable, verify

__all__ = [
    "FORMAT", "STEPS_MAX", "VERSION", "Label", "Refused", "Verdict", "checksum", "covered", "explored", "multiply",
    "prove", "rules", "schur_stable", "spelled", "verify",
]  # fmt: skip
