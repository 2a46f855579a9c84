"""What the tests of the real gas share: measured data where they are, and tanks that are made quickly."""

from __future__ import annotations

import json
import os
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from station.plants.real_gas.tables import gas_tables
from station.plants.real_gas.tank import Shape, fill_state, state_length, tank_of

FOLDER = os.environ.get("HRS_MEASURED", "")
measured = pytest.mark.skipif(not FOLDER, reason="HRS_MEASURED names no folder of measured cases")


@cache
def coolprop():
    """CoolProp, whose import takes three seconds: not where tests are only collected."""
    import CoolProp.CoolProp

    return CoolProp.CoolProp


def references():
    """The exact answers."""
    return json.loads((Path(FOLDER) / "references.json").read_text())


def adiabatic(volume):
    """A tank without heat transfer."""
    return tank_of(Shape(volume, 0.3, volume / 0.0707), [], 0.0, 1.0)


def filled(tank, pressure, kelvin):
    """The state of a tank."""
    state = np.zeros(state_length(tank))
    fill_state(state, 0, tank, pressure, kelvin, kelvin, gas_tables())
    return state
