"""What estimates say of a station's health: sound, failing, or not known."""

from __future__ import annotations

import pytest

from api.twins.health import KELVIN_KNOWN, MASS_KNOWN, WIDTH, health_of, unknown_in
from api.twins.measurement_schemas import EstimatedQuantity
from station.estimation.detection_memory import FACTOR_LIMIT, LEAK_LIMIT, SETTLING, SIGNIFICANT, WARMER_LIMIT


def _of(name, value, deviation, seq=SETTLING):
    quantities = {name: EstimatedQuantity(value=value, deviation=deviation, unit="")}
    return health_of(quantities, seq).get(name), unknown_in(quantities, seq)


LOSS = 1 - FACTOR_LIMIT


@pytest.mark.parametrize(
    ("value", "deviation", "verdict"),
    [
        (0.0, LEAK_LIMIT / WIDTH * 0.99, "sound"),
        (0.0, LEAK_LIMIT / WIDTH * 1.01, "unknown"),
        (LEAK_LIMIT * 1.01, LEAK_LIMIT / SIGNIFICANT, "failing"),
        (LEAK_LIMIT * 0.99, LEAK_LIMIT / SIGNIFICANT / 2, "sound"),
        (0.5, 0.5 / SIGNIFICANT * 1.01, "unknown"),
        (0.5, 0.5 / SIGNIFICANT * 0.99, "failing"),
        (None, None, "unknown"),
    ],
)
def test_a_buffer_leaks_or_not_or_nobody_knows(value, deviation, verdict):
    found, unknown = _of("leak_high", value, deviation)
    assert found == verdict
    assert unknown == (["leak_high"] if verdict == "unknown" else [])


def test_nobody_knows_of_a_buffer_whose_volume_is_not_known():
    leak = EstimatedQuantity(value=1.0, deviation=0.01, unit="g/s")
    mass = EstimatedQuantity(value=20_000.0, deviation=1.0, unit="g")
    quantities = {"mass_low": mass, "mass_high": mass, "leak_low": leak, "leak_high": leak}
    found = health_of(quantities, SETTLING, unknown_buffers=["low"])
    assert found == {"leak_low": "unknown", "leak_high": "failing"}
    assert unknown_in(quantities, SETTLING, unknown_buffers=["low"]) == ["mass_low", "leak_low"]


@pytest.mark.parametrize(
    ("value", "deviation", "verdict"),
    [
        (1.0, LOSS / WIDTH * 0.99, "sound"),
        (1.3, LOSS / WIDTH * 0.99, "sound"),
        (1.0, LOSS / WIDTH * 1.01, "unknown"),
        (FACTOR_LIMIT - 0.01, LOSS / SIGNIFICANT, "failing"),
    ],
)
def test_a_factor_is_judged_by_what_is_lost(value, deviation, verdict):
    assert _of("compressor_factor", value, deviation)[0] == verdict


@pytest.mark.parametrize(
    ("value", "deviation", "verdict"),
    [
        (0.0, WARMER_LIMIT / WIDTH * 0.99, "sound"),
        (-5.0, WARMER_LIMIT / WIDTH * 0.99, "sound"),
        (0.0, WARMER_LIMIT / WIDTH * 1.01, "unknown"),
        (WARMER_LIMIT * 1.01, WARMER_LIMIT / SIGNIFICANT, "failing"),
        (WARMER_LIMIT * 0.99, WARMER_LIMIT / SIGNIFICANT, "sound"),
    ],
)
def test_a_precooler_is_judged_by_how_much_warmer_the_gas_leaves_it(value, deviation, verdict):
    assert _of("precooler_deviation", value, deviation)[0] == verdict


def test_nothing_is_said_while_the_filter_learns():
    assert _of("leak_high", 5.0, 0.01, SETTLING - 1) == ("unknown", ["leak_high"])
    assert _of("leak_high", 5.0, 0.01, SETTLING) == ("failing", [])


@pytest.mark.parametrize(
    ("name", "value", "limit"),
    [
        ("mass_high", 4000.0, MASS_KNOWN * 4000),
        ("temperature_low", 20.0, KELVIN_KNOWN),
        ("ambient_deviation", 0.0, KELVIN_KNOWN),
    ],
)
def test_a_deviation_says_when_nothing_is_known(name, value, limit):
    assert _of(name, value, limit / WIDTH * 0.99)[1] == []
    assert _of(name, value, limit / WIDTH * 1.01)[1] == [name]


def test_of_a_vehicle_that_is_not_there_nothing_is_to_be_known():
    assert _of("mass_vehicle", None, None)[1] == []
    assert _of("mass_high", None, None)[1] == ["mass_high"]
