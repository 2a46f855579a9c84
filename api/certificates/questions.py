"""Questions about switched systems, as problem files and requests put them, and their answers."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, BeforeValidator, Field, model_validator

from api.http.strict import Body
from station.whole import WHOLE


class Decimal(float):
    """A decimal of a problem file, whose digits stay those written."""

    def __init__(self, text: str) -> None:
        self.text = text


def _digits(given: Any) -> Any:
    return given.text if isinstance(given, Decimal) else given


_EXACT = BeforeValidator(_digits)

Number = Annotated[
    Annotated[float, Field(ge=-1e9, le=1e9)] | Annotated[str, Field(max_length=60)],
    Field(description="A number, or a text like '27/25'; 0.39 means exactly 39/100", examples=["0.39"]),
    _EXACT,
]
Positive = Annotated[Annotated[float, Field(gt=0, le=1e9)] | Annotated[str, Field(max_length=60)], _EXACT]
Row = Annotated[list[Number], Field(fail_fast=True, min_length=1, max_length=60)]
Matrix = Annotated[list[Row], Field(fail_fast=True, min_length=1, max_length=60)]
Tau = Annotated[
    int,
    Field(ge=1, le=1000, description="Samples (thesis: tau)", examples=[3], json_schema_extra={"unit": "samples"}),
    WHOLE,
]


class Change(Body):
    """What a parameter adds to the matrices of a mode, by its value."""

    A: Annotated[Matrix | None, Field(description="n x n", examples=[[["0", "0"], ["0", "0.9"]]])] = None
    B: Annotated[Matrix | None, Field(description="n x m", examples=[[["0"], ["0.1"]]])] = None
    C: Annotated[Matrix | None, Field(description="p x n", examples=[[["0.1", "0"]]])] = None
    D: Annotated[Matrix | None, Field(description="p x m", examples=[[["0.1"]]])] = None
    E: Annotated[Matrix | None, Field(description="n x q", examples=[[["0.1"], ["0"]]])] = None
    F: Annotated[Matrix | None, Field(description="p x q", examples=[[["0.1"]]])] = None


class Parameter(Body):
    """A parameter on which the modes' matrices depend, known to nobody."""

    low: Annotated[Number, Field(description="Its least value", examples=["-1"])]
    high: Annotated[Number, Field(description="Its most, above `low`", examples=["1"])]
    rate: Annotated[
        Number | None, Field(description="Its largest change in a sample; left out: any", examples=["0.01"])
    ] = None  # fmt: skip


class Mode(Body):
    """The matrices of a mode: x+ = A x + B u + E w, y = C x + D u + F w, measured m = M x + N w."""

    A: Annotated[Matrix, Field(description="n x n", examples=[[["1.08", "0.39"], ["-0.13", "0.09"]]])]
    B: Annotated[Matrix | None, Field(description="n x m, of the input", examples=[[["-0.54"], ["-1.89"]]])] = None
    C: Annotated[Matrix | None, Field(description="p x n, of the output", examples=[[["-0.67", "-0.91"]]])] = None
    D: Annotated[Matrix | None, Field(description="p x m; zero if left out beside C", examples=[[["1.55"]]])] = None
    E: Annotated[Matrix | None, Field(description="n x q, of the disturbance", examples=[[["-0.56"], ["0.18"]]])] = None
    F: Annotated[Matrix | None, Field(description="p x q; zero if left out beside C", examples=[[["-1.41"]]])] = None
    M: Annotated[
        Matrix | None, Field(description="s x n: feedback has m instead of x", examples=[[["1", "0"]]])
    ] = None  # fmt: skip
    N: Annotated[Matrix | None, Field(description="s x q; zero if left out beside M", examples=[[["0.1"]]])] = None
    vary: Annotated[
        list[Change],
        Field(max_length=4, description="For each parameter, what it adds by its value", examples=[[{"A": [["0.1"]]}]]),
    ] = []  # noqa: RUF012  # pydantic copies it


class Gain(Body):
    """A feedback gain u = K x (u = K m where modes have M), or a controller x_c+ = A x_c + B m, u = C x_c + D m."""

    mode: Annotated[int, Field(ge=1, le=1000, description="Mode it is made for", examples=[1]), WHOLE]
    clock: Annotated[
        int,
        Field(ge=0, le=1000, description="Clock at which it acts", examples=[0], json_schema_extra={"unit": "samples"}),
        WHOLE,
    ]
    K: Annotated[
        Matrix | None, Field(description="m x n, or m x s where modes have M", examples=[[["0.41", "0.12"]]])
    ] = None  # fmt: skip
    A: Annotated[Matrix | None, Field(description="Of a controller, c x c", examples=[[["0.3"]]])] = None
    B: Annotated[Matrix | None, Field(description="Of a controller, c x s", examples=[[["0.5"]]])] = None
    C: Annotated[Matrix | None, Field(description="Of a controller, m x c", examples=[[["-0.2"]]])] = None
    D: Annotated[
        Matrix | None, Field(description="Of a controller, m x s; zero if left out", examples=[[["0"]]])
    ] = None  # fmt: skip

    @model_validator(mode="after")
    def _gain_or_controller(self) -> Self:
        given = {name for name in "KABCD" if getattr(self, name) is not None}
        if given != {"K"} and given | {"D"} != set("ABCD"):
            raise ValueError("needs either K, or A, B and C of a controller with or without D")
        return self


class Arbitrary(Body):
    """Any mode at any instant."""

    kind: Literal["arbitrary"]


class Dwell(Body):
    """At least `tau` samples between switches."""

    kind: Literal["dwell"]
    tau: Tau


class Average(Body):
    """At most burst + (t - s) / tau switches in every interval [s, t]."""

    kind: Literal["average"]
    tau: Annotated[
        Positive, Field(description="Average dwell time", json_schema_extra={"unit": "samples"}, examples=["5/2"])
    ]
    burst: Annotated[Positive, Field(description="Switches at once (thesis: N_0)", examples=[2])] = 1.0


class Persistent(Body):
    """Portions of at least `tau` samples in one mode, at most `period` samples apart."""

    kind: Literal["persistent"]
    tau: Tau
    period: Annotated[
        int, Field(ge=0, le=1000, description="Thesis: T", examples=[1], json_schema_extra={"unit": "samples"}), WHOLE
    ]


class AsynchronousDwell(Body):
    """Dwell time; after a switch the old mode's gain acts for up to `delay` < `tau` samples more."""

    kind: Literal["asynchronous"]
    tau: Tau
    delay: Annotated[
        int,
        Field(ge=0, le=999, description="Thesis: Delta", examples=[1], json_schema_extra={"unit": "samples"}),
        WHOLE,
    ]


_Node = Annotated[int, WHOLE] | str
_Edge = Annotated[tuple[_Node, Annotated[int, WHOLE], _Node], Field(strict=False)]


class LabelledGraph(Body):
    """Paths of a graph."""

    kind: Literal["graph"]
    edges: Annotated[
        list[_Edge],
        Field(
            fail_fast=True,
            min_length=1,
            max_length=20_000,
            description="[from, mode, to]",
            examples=[[["a", 1, "b"], ["b", 2, "a"]]],
        ),
    ]
    initial: Annotated[
        list[_Node],
        Field(fail_fast=True, max_length=20_000, description="Where signals begin; default anywhere", examples=[["a"]]),
    ] = []  # noqa: RUF012  # pydantic copies it


Constraint = Annotated[
    Arbitrary | Dwell | Average | Persistent | AsynchronousDwell | LabelledGraph,
    Field(
        discriminator="kind",
        description="Which signals are admissible",
        examples=[{"kind": "persistent", "tau": 2, "period": 1}],
    ),
]


class Ask(StrEnum):
    """The kind of a question."""

    STABILITY = "stability"
    DECAY_RATE = "decay-rate"
    GAIN = "gain"
    MEAN_SQUARE = "mean-square"
    REACH = "reach"
    STABILIZE = "stabilize"
    MINIMIZE_GAIN = "minimize-gain"
    MINIMIZE_REACH = "minimize-reach"


class Question(Body):
    """A switched system, a switching constraint, and what is asked of every admissible signal."""

    ask: Annotated[
        Ask,
        Field(
            description="Certify stability at `rate`, the smallest decay rate, l2 gain or reachable ball, the decay of"
            " the mean square where modes jump by `chain`; or find gains"
            " that stabilise, minimise the l2 gain or the ball, and certify their loop",
            examples=["stability"],
            strict=False,
        ),
    ]
    modes: Annotated[
        list[Mode],
        Field(
            fail_fast=True, min_length=1, max_length=1000, description="Modes 1, 2, ...", examples=[[{"A": [["0.5"]]}]]
        ),
    ]
    constraint: Constraint
    period: Annotated[
        Positive | None,
        Field(
            description="Modes are x' = A x + B u + E w, u and w held for so long", examples=["0.1"],
            json_schema_extra={"unit": "s"},
        ),
    ] = None  # fmt: skip
    parameters: Annotated[
        list[Parameter],
        Field(
            max_length=4,
            examples=[[{"low": "-1", "high": "1", "rate": "0.01"}]],
            description="Of the modes' matrices, for stability, decay rate and gain; what each adds stands in `vary`",
        ),
    ] = []  # noqa: RUF012  # pydantic copies it
    gains: Annotated[
        list[Gain],
        Field(
            fail_fast=True,
            max_length=20_000,
            examples=[[]],
            description="Of a given loop, for every mode and clock: gains, or controllers with as many states each",
        ),
    ] = []  # noqa: RUF012  # pydantic copies it
    clock: Annotated[
        int | None,
        Field(
            ge=0,
            le=1000,
            description="Last value of the gains' clock; default tau",
            examples=[1],
            json_schema_extra={"unit": "samples"},
        ),
        WHOLE,
    ] = None
    rate: Annotated[
        Positive, Field(description="Decay a sample, for stability; 1 asks for stability alone", examples=[1])
    ] = 1.0
    peak: Annotated[Positive, Field(description="Bound of |w|, for reachable sets, in the unit of w", examples=[1])] = (
        1.0
    )
    schedule: Annotated[
        Literal["clock", "mode", "common"],
        Field(description="What gains depend on: mode and clock, mode, nothing", examples=["clock"]),
    ] = "clock"
    symmetric: Annotated[bool, Field(description="X of Theorem 3.3 symmetric, which proves less", examples=[False])] = (
        False
    )
    alpha: Annotated[
        Literal["mode", "common", "grid"] | Annotated[list[Annotated[float, Field(gt=0, lt=1)]], Field(fail_fast=True)],
        Field(
            description="Contraction for reachable sets: searched a mode, in common, on 0.1..0.9, or given",
            examples=["mode"],
        ),
    ] = "mode"
    representation: Annotated[
        Literal["automaton", "words"],
        Field(description="The minimal automaton, or the thesis's words", examples=["automaton"]),
    ] = "automaton"
    lift: Annotated[
        int | None,
        Field(
            ge=0,
            le=60,
            description="Letters looked ahead, or words together; without, the smallest, raised where `budget` says",
            examples=[2],
        ),
        WHOLE,
    ] = None
    chain: Annotated[
        Matrix | None,
        Field(
            description="For the mean square: the probability of each mode after each, rows that sum up to 1 exactly",
            examples=[[["0.9", "0.1"], ["1/2", "1/2"]]],
        ),
    ] = None  # fmt: skip
    gap: Annotated[
        float,
        Field(
            ge=1e-9, lt=1, examples=[1e-6],
            description="Without a lift: relative distance of a rate or gain to a word's that is small enough",
        ),
    ] = 1e-6  # fmt: skip
    budget: Annotated[
        float,
        Field(
            ge=0, le=3600, examples=[10], json_schema_extra={"unit": "s"},
            description="Without a lift: time in which larger lifts are tried; 0 tries the smallest alone",
        ),
    ] = 10.0  # fmt: skip
    shared: Annotated[
        bool, Field(description="Copies of a word share matrices, as in print (words only)", examples=[False])
    ] = False
    tau_max: Annotated[
        int | None,
        Field(
            ge=1, le=1000, description="Search the smallest tau up to this one; the constraint's own is ignored",
            examples=[20], json_schema_extra={"unit": "samples"},
        ), WHOLE] = None  # fmt: skip


class Answer(BaseModel):
    """The answer to a question."""

    certified: Annotated[
        bool, Field(description="Whether there is a certificate; without, nothing is claimed", examples=[True])
    ]
    claim: Annotated[
        str, Field(description="What the document proves, in words", examples=["for every admissible signal: ..."])
    ]
    value: Annotated[
        float | None, Field(gt=0, description="Decay a sample, l2 gain or radius that is certified", examples=[0.98])
    ] = None
    at_least: Annotated[
        float | None,
        Field(
            gt=0, description="The decay rate or gain of a periodic word, proved: no certificate can be below",
            examples=[0.9969887],
        ),
    ] = None  # fmt: skip
    bound: Annotated[
        float | None,
        Field(
            gt=0, description="What the synthesis inequalities gave, before the loop was analysed", examples=[3.3767]
        ),
    ] = None
    tau: Annotated[
        int | None,
        Field(
            ge=1,
            description="The smallest tau certified, where it was searched",
            examples=[3],
            json_schema_extra={"unit": "samples"},
        ),
        WHOLE,
    ] = None
    seconds: Annotated[float, Field(ge=0, description="Time it took", examples=[0.1], json_schema_extra={"unit": "s"})]
    document: Annotated[
        dict[str, Any] | None,
        Field(
            description="The certificate, or the counterproof where there is none; see docs/theory.md",
            examples=[{"format": "hrs-certificate"}],
        ),
    ] = None
