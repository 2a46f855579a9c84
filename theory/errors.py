"""Typed errors of the mathematics; each message names the field and its limit."""


class TheoryError(ValueError):
    """Base class of all errors of the mathematics."""


class IllPosedError(TheoryError):
    """The question is not well posed: matrices that do not fit, numbers outside their limits, a dead end."""

    def __init__(self, field: str, message: str) -> None:
        super().__init__(f"{field}: {message}")
        self.field = field
        self.reason = message


class UnboundedError(IllPosedError):
    """A set that must be bounded is not."""


class EmptySetError(IllPosedError):
    """A set has no point, or no inside where one is needed."""


class RankError(IllPosedError):
    """The data do not span the unknowns."""


class TooLargeError(TheoryError):
    """The problem was estimated before it was built, and the estimate exceeds the limit."""

    def __init__(self, what: str, estimate: int, limit: int) -> None:
        super().__init__(f"{what}: an estimated {estimate}, the limit is {limit}")
        self.estimate, self.limit = estimate, limit


class NotCertifiedError(TheoryError):
    """No certificate was found at this lift. The claim itself is refuted only by a `counterexample`."""

    def __init__(self, message: str, counterexample: object = None) -> None:
        super().__init__(message)
        self.counterexample = counterexample


class SolverError(TheoryError):
    """The solver ended without a solution; no number comes from it."""

    def __init__(self, status: str, what: str) -> None:
        super().__init__(f"{what}: the solver ended with {status!r}")
        self.status = status


class InfeasibleError(SolverError):
    """The solver found the inequalities contradictory (in floating point: an indication, not a proof)."""
