"""Settings of the MINLP controllers."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from controllers.base import Settings
from station.quantities import Pressure
from station.whole import WHOLE

HORIZON_MAX = 20
"""Beyond it even the beam of a later controller looks at blocks, not seconds."""


NODES = 20_000
"""Default end of a search [nodes]: some 40 ms, and far beyond what t <= 3 needs."""


Weight = Annotated[float, Field(ge=0, le=1e9, allow_inf_nan=False)]


class MinlpSettings(Settings):
    """Settings of a MINLP controller; the station's preset gives target and weights."""

    target_pressure_bar: Annotated[Pressure, Field(description="x_pmax of Eqs (7.22) and (7.23)")]
    compressor_weight_bar2: Annotated[Weight, Field(description="c_e_in of Eq. (7.21)")]
    precooler_weight_bar2: Annotated[Weight, Field(description="c_e_out of Eq. (7.21)")]
    liveness: Annotated[
        bool,
        Field(description="Ours: fill the lowest buffer when a vehicle is connected and nothing else would happen"),
    ] = False
    horizon: Annotated[
        int, Field(ge=1, le=HORIZON_MAX, description="t of Eq. (7.24): t + 1 stages of one second"), WHOLE
    ] = 1
    engine: Annotated[
        Literal["exact", "pyomo", "casadi"],
        Field(description="exact search; SCIP through Pyomo; Bonmin through CasADi"),
    ] = "exact"
    node_limit: Annotated[
        int, Field(ge=1, le=10**9, description="Nodes after which a search stops, ours or a solver's"), WHOLE
    ] = NODES
