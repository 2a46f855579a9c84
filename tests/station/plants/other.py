"""Runs a day at the thesis's plant and at another one that is registered before any kernel is compiled."""

from __future__ import annotations

import json
from dataclasses import replace
from hashlib import sha256
from typing import NamedTuple

from station.compiled import merged
from station.limit_figures import LimitFigures
from station.plants import interface, thesis


class Other(NamedTuple):
    """Constants of a plant of the test: those of the thesis's, and one more."""

    buffer_volume: tuple[float, float, float]
    compressor_pressure: float
    inlet_coefficient: float
    outlet_coefficient: float
    inlet_heating: tuple[float, float, float]
    outlet_cooling: tuple[float, float, float]
    vehicle_heating: float
    heat_exchange: float
    ambient_temperature: float
    limits: LimitFigures
    compressor_count: int
    unfilled: tuple[float, float, float]
    buffer_pressure_min: tuple[float, float, float]
    leak: float


@merged
def advance(state, volume, command, period, plant):
    """The thesis's equations, and a count of the seconds advanced in an entry of the state of its own."""
    state[interface.OWN] += period
    return thesis.advance(state, volume, command, period, plant)


OTHER = replace(
    thesis.THESIS, name="other", constants=Other, sample=Other(*thesis.THESIS.sample, 0.0), own=1, advance=advance,
    constants_of=lambda station, *, communication: Other(*station.constants(), 0.0),
)  # fmt: skip

if __name__ == "__main__":
    interface.register(OTHER)
    from controllers import create
    from station import load_scenario, load_station, simulate
    from station.live import AtEnd, LiveRun, SlotState

    usual = load_scenario("S1")
    station = load_station("thesis-fit").model_copy(update={"plant": "other"})
    bytes_of = {
        name: sha256(simulate(scenario, create("logic")).to_bytes()).hexdigest()
        for name, scenario in (("thesis", usual), ("same", usual.on(station)))
    }
    actor = create("logic")
    actor.start(station)
    run = LiveRun(usual.on(station), AtEnd.IDLE)
    for _ in range(100):
        run.step(SlotState(actor.decide, actor.obeys_hold))
    print(json.dumps({**bytes_of, "seconds": 100.0, "advanced": float(run._run.state[interface.OWN])}))
