"""The objective (7.20)-(7.24), once for every engine."""

from __future__ import annotations

from typing import Any, NamedTuple

from station.compiled import formula

Number = Any


class Objective(NamedTuple):
    """Weights of one stage's cost [bar2]; c_eng, c_b and c_v of Eq. (7.24) are already multiplied in."""

    compressor: float  # an open inlet for one stage, c_eng c_e_in
    precooler: float  # an open outlet for one stage, c_eng c_e_out
    buffers: float  # c_b
    vehicle: float  # c_v
    target: float  # x_pmax [bar]


@formula
def energy_cost(inlets: Number, outlets: Number, objective: Objective) -> Number:
    """c_eng J_1 of one stage with so many open inlets and outlets, Eqs (7.20) and (7.21)."""
    return objective.compressor * inlets + objective.precooler * outlets


@formula
def buffer_cost(pressure: Number, objective: Objective) -> Number:
    """One buffer's term of c_b J_2, Eq. (7.22)."""
    return objective.buffers * (pressure - objective.target) ** 2


@formula
def vehicle_cost(pressure: Number, objective: Objective) -> Number:
    """c_v J_3, Eq. (7.23)."""
    return objective.vehicle * (pressure - objective.target) ** 2
