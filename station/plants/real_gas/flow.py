"""Flow through an orifice: real choked flux, nearly an ellipse below it, implicit in the pressures that it changes."""

from __future__ import annotations

import math

from station.compiled import uncounted
from station.plants.real_gas.gas import choked
from station.plants.real_gas.tables import GasTables

KV_AREA = 19.6e-6
"""Effective area of a valve with a flow coefficient Kv of 1 m3/h [m2]: water at 1 bar, m3/h / sqrt(2 bar / rho)."""

_IDEAL_RATIO = 0.519
_BLUNTER = 1.95
"""The exponent of the subsonic curve is 2, an ellipse, at this critical ratio, and falls so much with it: fitted to the
exact flux of Leachman's equation up to 90 MPa, which it meets within 1.5 %."""


@uncounted
def orifice_flow(area: float, p: float, kelvin: float, back: float, gas: GasTables) -> float:
    """Flow [kg/s] out of a stagnation state through an effective area [m2] against a back pressure [Pa].

    Subsonic flux = choked (1 - y^n)^(1/2), y from 0 at the critical ratio to 1 at equal pressures. With n = 2 this is
    the ellipse of ISO 6358-1; dense hydrogen has n down to 1.8.
    """
    if back >= p:
        return 0.0
    flux, critical = choked(p, kelvin, gas)
    ratio = back / p
    if ratio > critical:
        place = (ratio - critical) / (1.0 - critical)
        flux *= math.sqrt(max(1.0 - place ** (2.0 + _BLUNTER * (critical - _IDEAL_RATIO)), 0.0))
    return area * flux


@uncounted
def implicit_flow(explicit: float, gap: float, stiffness: float, period: float) -> float:
    """Flow [kg/s] over a period that closes a gap of pressures [Pa] it is driven by; never past its end.

    With flow2 proportional to the gap, and the gap falling by `stiffness` [Pa/kg] times what has flown:
    flow2 = explicit2 (gap - stiffness period flow) / gap, solved for the flow.
    """
    if explicit <= 0.0 or gap <= 0.0:
        return 0.0
    half = 0.5 * explicit * stiffness * period / gap  # a / (2 explicit)
    return explicit / (math.sqrt(half * half + 1.0) + half)
