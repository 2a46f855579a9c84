"""Controllers as lists show them."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, Field

from api.controllers.certificates import Making


class ControllerSummary(BaseModel):
    """A controller that is installed."""

    name: Annotated[str, Field(description="What requests call it", examples=["minlp1"])]
    about: Annotated[
        str, Field(description="One line on it", examples=["MINLP with c_eng = c_b = c_v = 1 (Table 7.2)"])
    ]
    ready: Annotated[
        bool,
        Field(
            description="Whether it can be used; while it is being compiled, once for a version, nothing more is said",
            examples=[True],
        ),
    ]
    options: Annotated[
        dict[str, Any],
        Field(
            description="JSON schema of its options, given as `name:option=value`; a station's preset sets most",
            examples=[{"properties": {"horizon": {"type": "integer", "minimum": 1, "maximum": 20, "default": 1}}}],
        ),
    ]


class ServiceCertificateState(BaseModel):
    """How far a certificate of service is, and what it says once it is made."""

    state: Annotated[Making, Field(description="`none`: nobody has had it made since the start", examples=["made"])]
    verdict: Annotated[
        str | None, Field(description="certified, tested or not certified; null until made", examples=["certified"])
    ] = None
    claim: Annotated[
        str | None, Field(description="What it says; null until made", examples=["from every state of the box ..."])
    ] = None


class ServiceVerification(BaseModel):
    """The result of computing a certificate of service again."""

    verified: Annotated[bool, Field(description="Whether everything in the document came out equal", examples=[True])]
    claim: Annotated[
        str,
        Field(
            description="Verdict and claim, or the first field that differs",
            examples=["certified: from every state of the box ..."],
        ),
    ]
