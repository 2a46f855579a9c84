"""Subject of a proof of service: the reserve rule itself, or a controller whose guard falls back to it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from controllers.certified.claim import Claim
from controllers.certified.proof import Enclosure, States
from controllers.guarded.controller import Guarded
from controllers.guarded.settings import Promise, promise_of
from controllers.reserve.controller import Reserve
from controllers.reserve.enclosures import COLDEST
from controllers.reserve.recovery import KELVINS, kelvin_of
from station.geometry import BUFFERS, KELVIN, LOW
from station.parameters import Station
from station.plants.thesis import gas_pressure

ROUNDED = 1e-9
"""Relative widening of the ready states, for the rounding of what the controller compares."""


@dataclass(frozen=True)
class ReducedClaim:
    """A claim of service brought back to the reserve rule."""

    rule: Reserve
    ready: States | None = None  # what the guard takes for states from which it does
    flaw: str = ""  # why that would not do
    promise: Promise | None = None
    held: float = 0.0  # a vehicle waits at most so long before its fill begins [s]

    def longest(self, proved: Enclosure) -> float:
        """No vehicle is connected longer [s]: none under the rule, none that the guard lets `switched` fill."""
        within = 0.0 if self.promise is None else self.promise.within
        return self.held + max(within, np.inf if proved.longest is None else float(proved.longest))

    def driest(self, proved: Enclosure, claim: Claim, station: Station) -> float:
        """No vehicle gets nothing for longer [s].

        A vehicle held back is given gas in the second in which its fill begins where low, in every state that is
        proved, lies far enough above every vehicle; what was dry before does not add to what is dry later.
        """
        gap = max(self.rule.settings_for(station).gap_bar, station.dispenser.outlet_gap_min_bar)
        at_once = proved.states.floors[LOW].min() >= claim.vehicles.starts[1] * (1.0 + ROUNDED) + gap
        return max(self.held, self.longest(proved) - self.held) if at_once else self.longest(proved)

    def as_document(self) -> dict[str, Any] | None:
        """Promise of the guard, as JSON holds it; None where there is no guard."""
        if self.promise is None:
            return None
        return {
            "within_s": self.promise.within, "ready_s": self.promise.ready,
            "ready_mass_g": dict(zip(BUFFERS, self.promise[2:5], strict=True)), "cold_c": self.promise.cold,
            "top_bar": self.promise.top,
        }  # fmt: skip


def reduced_claim(actor: Any, station: Station, claim: Claim) -> ReducedClaim | None:
    """Claim to be proved of a controller; None where there is no way to."""
    if isinstance(actor, Reserve):
        space = actor.settings_for(station).space_s
        return ReducedClaim(actor, flaw=_bursting(space, station, claim), held=float(space) if claim.burst > 1 else 0.0)
    if not isinstance(actor, Guarded):
        return None
    rule = actor.rule(station)
    promise = promise_of(actor.settings_for(station), rule.settings_for(station), station)
    return ReducedClaim(rule, _ready_states(promise, station), _flaw(promise, station, claim), promise)


def _ready_states(promise: Promise, station: Station) -> States:
    """The ready states as sets: at each temperature the pressure that goes with the least mass."""
    plant, floors = station.constants(), np.full((3, KELVINS), np.inf)
    last = kelvin_of(plant.limits.buffer_temperature_max * (1.0 + ROUNDED))
    for buffer, least in enumerate((promise.high, promise.medium, promise.low)):
        for place in range(kelvin_of(promise.cold - ROUNDED * KELVIN), last + 1):
            floors[buffer, place] = gas_pressure(least, COLDEST + place, plant.buffer_volume[buffer]) * (1.0 - ROUNDED)
    return States(floors, np.full(3, promise.top * (1.0 + ROUNDED)))


def _bursting(space: int, station: Station, claim: Claim) -> str:
    """Why what is proved of fills that begin s apart does not make the claim true, or nothing.

    A vehicle that waits connected for its fill meets the buffers as one that comes then; it must be as warm as one.
    """
    if space > claim.spacing:
        return f"fills begin {space} s apart, and vehicles may come each {claim.spacing} s"
    if claim.burst > 1 and space < claim.spacing:
        return f"bursts need fills that begin s apart; try reserve:space_s={claim.spacing}, given {space}"
    if claim.burst > 1 and station.vehicle.start_temperature_c != station.thermal.ambient_temperature_c:
        return "a vehicle that waits does not keep its temperature: it is not that of the surroundings"
    return ""


def _flaw(promise: Promise, station: Station, claim: Claim) -> str:
    """Why the guard's promise would not make the claim true, or nothing.

    Ready buffers stay ready while nobody is connected and the rule fills them: they lose no mass, their temperature
    stays between its ends, and their pressure once they have warmed, `promise.top` at most, grows only by filling,
    which does not lead above that.
    """
    plant = station.constants()
    if claim.burst > 1:
        return "bursts are proved of the reserve rule alone: a guard does not hold a vehicle back"
    if promise.within > claim.within:
        return f"the guard lets a fill take {promise.within:g} s, longer than T"
    if promise.ready > claim.spacing:
        return f"the guard asks for ready buffers after {promise.ready:g} s, later than s"
    if plant.ambient_temperature >= plant.limits.buffer_temperature_max:
        return "the surroundings are as warm as a buffer may become"
    return ""
