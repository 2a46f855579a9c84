"""The checker of certificates: rational arithmetic, the standard library, and no trust in the document's words.

It builds the automaton of the constraint's definition (`constraints.py`), proves that the graph covers it, and proves
every inequality (`verification.py`, `algebra.py`) and bound from below (`lower.py`), within limits (`work.py`). The
folder stands alone: copied elsewhere it works as well.
"""

from .algebra import multiply, prove, prove_fractions, schur_stable, weighted
from .constraints import STEPS_MAX, Label, Refused, covered, explored, rules, spelled
from .feedback import beside
from .lower import orbit, repeatable, response
from .verification import FORMAT, VERSION, Verdict, checksum, verify
from .work import OverLimit, Work, estimate

__all__ = [
    "FORMAT",
    "STEPS_MAX",
    "VERSION",
    "Label",
    "OverLimit",
    "Refused",
    "Verdict",
    "Work",
    "beside",
    "checksum",
    "covered",
    "estimate",
    "explored",
    "multiply",
    "orbit",
    "prove",
    "prove_fractions",
    "repeatable",
    "response",
    "rules",
    "schur_stable",
    "spelled",
    "verify",
    "weighted",
]  # fmt: skip
